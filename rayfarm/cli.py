"""Assembles the program `rayfarm` from its commands, and maps errors to exit codes."""

from __future__ import annotations

import logging
import math
import os
import sys
from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Annotated, Any

import typer

from rayfarm.console import err
from rayfarm.errors import EXIT_FAILED, EXIT_INTERRUPTED
from rayfarm.help_pages import set_help_format
from renderer import __version__
from renderer.errors import RayfarmError
from renderer.printable import LogRecord

__all__ = ["COMMANDS", "main"]

# In the order of the help. A command's module has its name.
COMMANDS = (
    "up",
    "worker",
    "site",
    "render",
    "husk",
    "submit",
    "openjd",
    "dataset",
    "jobs",
    "workers",
    "shares",
    "watch",
    "notes",
    "mcp",
    "user",
    "project",
    "quota",
    "token",
    "info",
    "ocio",
    "compare",
    "blender_addon",
    "backup",
    "doctor",
    "gc",
    "bench",
)
SHARED_MODULES = {"restore": "backup"}  # commands defined in another command's module

HELP = """A render farm that starts with one command.

[bold]On this machine[/bold]   rayfarm up                                the farm and its page
[bold]On another[/bold]        rayfarm worker --join URL                 adds its cores to the farm
[bold]Without a farm[/bold]    rayfarm render scene.glb -o out.png       in this process
[bold]With one[/bold]          rayfarm submit scene.glb --wait -o out.exr
[bold]To watch it[/bold]       rayfarm watch                             in the terminal
[bold]To keep it[/bold]        rayfarm backup /mnt/nas/rayfarm           even while it runs
[bold]Trouble?[/bold]          rayfarm doctor                            what is wrong here, in sentences
"""


def _program(commands: Iterable[str]) -> typer.Typer:
    """Returns the Typer program that consists of these commands."""
    app = typer.Typer(
        name="rayfarm",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode="rich",
        context_settings={"help_option_names": ["-h", "--help"]},
        help=HELP,
        callback=_global_options,
    )
    for name in commands:
        import_module(f"rayfarm.commands.{name}").register(app)
    return app


def _refuse_nan_and_infinity(command: Any) -> None:
    """Makes numeric options reject NaN, which passes every range check, and infinity, which passes a range with only one end."""
    commands = getattr(command, "commands", {}).values()
    for each in commands:
        _refuse_nan_and_infinity(each)
    if not commands:
        command.invoke = _with_finite_numbers(command.invoke)


def _with_finite_numbers(invoke: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def checked(context: Any) -> Any:
        for name, value in context.params.items():
            if isinstance(value, float) and not math.isfinite(value):
                raise typer.BadParameter(f"{value} is not a finite number.", param_hint=f"--{name.replace('_', '-')}")
        return invoke(context)

    return checked


def _version(is_requested: bool) -> None:
    """Prints the version and exits."""
    if is_requested:
        print(f"rayfarm {__version__}")
        raise typer.Exit


def _global_options(
    debug: Annotated[bool, typer.Option("--debug", help="Show where in the program an error came from.")] = False,
    version: Annotated[bool, typer.Option("--version", help="Show the version.", callback=_version, is_eager=True)] = False,
) -> None:
    if debug:
        os.environ["RAYFARM_DEBUG"] = "1"


def _commands_to_import() -> Iterable[str]:
    """Returns the commands to import: only the one on the command line, since importing all is slow; else all of them."""
    words = [word for word in sys.argv[1:] if word != "--debug"]
    name = words[0].replace("-", "_") if words else ""
    name = SHARED_MODULES.get(name, name)
    return (name,) if name in COMMANDS else COMMANDS


def main() -> None:
    """Runs the command line. An error that users can fix is printed as one sentence on standard error, with exit code 1."""
    logging.setLogRecordFactory(LogRecord)
    try:
        command = typer.main.get_command(_program(_commands_to_import()))
        _refuse_nan_and_infinity(command)
        set_help_format(command)
        command()
    except RayfarmError as error:
        if os.environ.get("RAYFARM_DEBUG"):
            raise
        err.print(f"rayfarm: {error}", markup=False, soft_wrap=True)
        sys.exit(EXIT_FAILED)
    except OSError as error:
        if os.environ.get("RAYFARM_DEBUG"):
            raise
        what = f"{error.filename}: " if error.filename else ""
        err.print(f"rayfarm: {what}{error.strerror or error}", markup=False, soft_wrap=True)
        sys.exit(EXIT_FAILED)
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)
