"""The option --log-format of commands that start processes. In its own module, since they import nothing else of options.py."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from rayfarm.errors import CommandError
from telemetry.log_lines import FORMAT_VARIABLE, FORMATS

__all__ = ["LogFormat", "use_log_format"]

LogFormat = Annotated[
    str | None,
    typer.Option(
        "--log-format",
        metavar="NAME",
        help="text, or json: each line of the logs an object, for programs. [dim]$RAYFARM_LOG_FORMAT[/dim]",
    ),
]


def use_log_format(name: str | None) -> None:
    """Sets the log format of processes that the command starts. Raises CommandError."""
    if name is not None:
        if name not in FORMATS:
            raise CommandError(f"--log-format is {name!r}; there are {', '.join(FORMATS)}")
        os.environ[FORMAT_VARIABLE] = name
