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

from rayfarm.command_advice import sentence
from rayfarm.console import err
from rayfarm.errors import EXIT_FAILED, EXIT_INTERRUPTED
from rayfarm.help_pages import set_help_format
from rayfarm.option_advice import advise_on_options
from renderer import __version__
from renderer.errors import RayfarmError
from renderer.printable import LogRecord

__all__ = ["COMMANDS", "main"]

# Commands by what they are for, in the order of the help. A command's module has its name.
GROUPS = {
    "Render": ("render", "submit", "watch", "jobs", "notes", "info", "dataset", "ocio"),
    "Run a farm": ("up", "worker", "workers", "shares", "site"),
    "Maintain a farm": ("doctor", "backup", "gc", "bench"),
    "Let people in": ("user", "token", "project", "quota"),
    "Work with other programs": ("blender_addon", "husk", "openjd", "mcp", "compare"),
}
COMMANDS = tuple(name for names in GROUPS.values() for name in names)
SHARED_MODULES = {"restore": "backup"}  # commands defined in another command's module

HELP = """A render farm that starts with one command.

[bold]Examples[/bold]

  rayfarm up                              start a farm here, and its page
  rayfarm worker --join URL               add this machine to a farm
  rayfarm render scene.glb -o out.png     render here, without a farm
  rayfarm submit scene.glb -o out.exr     render on the farm
  rayfarm watch                           see the newest job grow
  rayfarm doctor                          find out what is wrong

`rayfarm COMMAND --help` has the examples of a command. A running farm shows its guides at /docs/guides/ of its page.
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


def _set_panels(program: Any) -> None:
    """Shows the commands of each group in a panel of its own."""
    modules = {name: SHARED_MODULES.get(name, name.replace("-", "_")) for name in program.commands}
    panels = {name: panel for panel, names in GROUPS.items() for name in names}
    for name, command in program.commands.items():
        command.rich_help_panel = panels[modules[name]]


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
        advise_on_options(command)
        set_help_format(command)
        _set_panels(command)
        command()
    except RayfarmError as error:
        if os.environ.get("RAYFARM_DEBUG"):
            raise
        err.print(f"rayfarm: {sentence(error)}", markup=False, soft_wrap=True)
        sys.exit(EXIT_FAILED)
    except OSError as error:
        if os.environ.get("RAYFARM_DEBUG"):
            raise
        what = f"{error.filename}: " if error.filename else ""
        err.print(f"rayfarm: {what}{error.strerror or error}", markup=False, soft_wrap=True)
        sys.exit(EXIT_FAILED)
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)
