"""Formats `--help`: moves examples to the top, refills paragraphs, shows arguments in capitals, and omits types of flags."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

__all__ = ["set_help_format"]

# Placeholders of values without a metavar, by typer's name of the type.
_VALUES = {
    "<int range>": "N",
    "<int>": "N",
    "<float range>": "X",
    "<float>": "X",
    "<str>": "TEXT",
    "<path>": "PATH",
    "<file>": "FILE",
    "<dir>": "DIR",
    "<bool>": None,
}


def set_help_format(command: Any) -> None:
    """Changes the help format of this command and its subcommands."""
    for each in getattr(command, "commands", {}).values():
        set_help_format(each)
    command.help = command.help and _join_paragraph_lines(command.help)
    get_params = command.get_params

    def params(ctx: Any) -> list[Any]:
        return [_set_metavar(each) for each in get_params(ctx)]  # including --help, which is created on each call

    command.get_params = params


def _set_metavar(parameter: Any) -> Any:
    if parameter.param_type_name == "argument":
        if parameter.metavar is None:
            parameter.metavar = parameter.name.upper()
        parameter.display_type_rich = _do_nothing
    elif parameter.metavar is None:
        parameter.display_type_rich = _value(parameter.display_type_rich)
    return parameter


def _do_nothing(ctx: Any) -> None:
    """Does nothing; replaces the function that adds to the names of arguments."""


def _value(text_of: Callable[[Any], str | None]) -> Callable[[Any], str | None]:
    def value(ctx: Any) -> str | None:
        label = text_of(ctx)
        return _VALUES.get(label, label) if label else None

    return value


def _join_paragraph_lines(text: str) -> str:
    """Joins the lines of each paragraph. Indented text is unchanged. Examples follow the first paragraph."""
    first, *others = inspect.cleandoc(text).split("\n\n")
    at = next((i for i, each in enumerate(others) if each.startswith("[bold]Example")), 0)
    return "\n\n".join(_paragraph(each) for each in (first, *others[at : at + 2], *others[:at], *others[at + 2 :]))


def _paragraph(text: str) -> str:
    if text.startswith(" "):
        return f"[dim][/dim]{text}"  # keeps typer from removing the common indentation
    return text if text.startswith(("\b", "[bold]")) else text.replace("\n", " ")
