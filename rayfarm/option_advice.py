"""Suggestions for unknown options: the option of that name in other programs, or of a similar name."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any

__all__ = ["advise_on_options", "option_for"]

# Name of an option in other programs -> its names here, of which the first that the command has is suggested.
_OTHER_NAMES = {
    "--width": ("--size",),
    "--height": ("--size",),
    "--resolution": ("--size",),
    "--res": ("--size",),
    "--samples": ("--spp",),
    "--samples-per-pixel": ("--spp",),
    "--bounces": ("--max-depth",),
    "--depth": ("--max-depth",),
    "--out": ("--output",),
    "--outfile": ("--output",),
    "--environment": ("--env",),
    "--hdri": ("--env",),
    "--light": ("--env",),
    "--position": ("--eye",),
    "--look-at": ("--target",),
    "--transparent": ("--background",),
    "--animation": ("--frames",),
    "--start": ("--frames",),
    "--end": ("--frames",),
    "--cpus": ("--threads", "--slots"),
    "--cores": ("--threads", "--slots"),
    "--device": ("--gpu",),
    "--cuda": ("--gpu",),
    "--gpus": ("--gpu",),
    "--url": ("--server", "--join"),
    "--address": ("--server", "--host"),
    "--bind": ("--host",),
}
_FORMS = {"--size": "--size 1280x720", "--background": "--background transparent", "--frames": "--frames 0-99"}
_ALIKE = 0.75  # least similarity of a typing error


def option_for(wrong: str, options: Iterable[str]) -> str:
    """Returns the suggestion for an unknown option, such as "--size 1280x720"; empty if no option is similar.

    wrong: the unknown option, such as "--width". options: those of the command.
    """
    known = set(options)
    meant = {name: next((each for each in here if each in known), "") for name, here in _OTHER_NAMES.items() if name not in known}
    meant |= {name: name for name in known}
    near = get_close_matches(wrong, [name for name, here in meant.items() if here], 1, _ALIKE)
    if not near:
        return ""
    return near[0] if near[0] in known else _FORMS.get(meant[near[0]], meant[near[0]])


def advise_on_options(command: Any) -> None:
    """Adds suggestions to the errors of a command and its subcommands about unknown options."""
    for each in getattr(command, "commands", {}).values():
        advise_on_options(each)
    parse = command.parse_args

    def parse_with_advice(context: Any, arguments: list[str]) -> Any:
        try:
            return parse(context, arguments)
        except Exception as raised:
            error: Any = raised
            if not (hasattr(error, "option_name") and hasattr(error, "possibilities")):  # not about an unknown option
                raise
            names = [name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)]
            error.possibilities = None
            if meant := option_for(error.option_name, names):
                error.message = f"No such option: {error.option_name}. Use {meant}."
            raise

    command.parse_args = parse_with_advice
