"""`rayfarm mcp`: serves a farm's scenes, jobs and pictures to an assistant."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rayfarm import options
from rayfarm.errors import CommandError
from rayfarm.login import farm_client

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("mcp")(mcp)


def mcp(
    server: options.Server = None,
    folder: Annotated[
        list[Path] | None,
        typer.Option(metavar="DIR", help="A folder whose scenes may be uploaded, none by default; may be given several times."),
    ] = None,
) -> None:
    """Serve a farm to an assistant by the Model Context Protocol, over standard input and output.

    An assistant's program starts it. Its tools do what the token in $RAYFARM_API_TOKEN may do: with a viewer's they only look.
    Needs the extra `mcp`.

    [bold]Examples[/bold]

      rayfarm mcp
      rayfarm mcp --server http://studio:8000 --folder ~/scenes
    """
    try:
        from rayfarm.mcp_server import create_server
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "mcp":
            raise
        raise CommandError('`rayfarm mcp` needs the package mcp: pip install "rayfarm[mcp]"') from None
    for each in folder or ():
        if not each.is_dir():
            raise CommandError(f"--folder is {each}, which is not a folder")
    with farm_client(server) as farm:
        create_server(farm, folder or ()).run("stdio")
