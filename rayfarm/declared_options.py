"""Command line options made from the declarations of renderer/settings.py: name, type, range, help."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import MISSING
from typing import Annotated, Any

import typer

from rayfarm import options
from renderer.declared import Declared
from renderer.described import LARGE, sentences

__all__ = ["parameter", "typed"]

_METAVARS = {"s": "S", "°": "DEG", "px": "PIXELS", "scene units": "LENGTH", "fraction": "FRACTION", "radiance": "RADIANCE"}


def parameter(each: Declared) -> inspect.Parameter:
    """The option, for a command's signature. None where it is not given."""
    setting, shown = each.setting, each.shown
    inside = setting.off is None or each.lowest == setting.low  # else a range would not say it
    ranged = each.kind is not tuple and setting.choices is None and inside
    option = typer.Option(
        f"--{each.option}",
        help=sentences(each),
        rich_help_panel=shown.section,
        metavar=_metavar(each),
        min=_bound(setting.low) if ranged else None,
        max=_bound(setting.high) if ranged else None,
        show_default=_default(each),
    )
    kind: Any = str if each.kind is tuple else each.kind
    return inspect.Parameter(
        each.option.replace("-", "_"),
        inspect.Parameter.KEYWORD_ONLY,
        default=None,
        annotation=Annotated[kind | None, option],
    )


def typed(settings: Mapping[str, Declared], given: Mapping[str, Any]) -> dict[str, Any]:
    """The settings' values by the renderer's names, out of those of the options; None where nothing is asked for."""
    found = {name: given.get(each.option.replace("-", "_")) for name, each in settings.items()}
    for name, value in found.items():
        if settings[name].kind is tuple and isinstance(value, str):
            found[name] = options.parse_vec3(value, f"--{settings[name].option}")
    return found


def _metavar(each: Declared) -> str | None:
    if each.setting.choices is not None:
        return "NAME"
    if each.kind is tuple:
        return "R,G,B" if each.shown.unit == "radiance" else "X,Y,Z"
    return _METAVARS.get(each.shown.unit)


def _bound(value: float | None) -> float | None:
    return None if value is None or abs(value) >= LARGE else value


def _default(each: Declared) -> str | bool:
    """What it is where it is not given: of a camera as it has it, of what a scene file may ask for as that says."""
    if each.default in (MISSING, None, "", each.setting.off) or each.kind is tuple or each.shown.section == "View":
        return False
    default = f"{each.default:g}" if isinstance(each.default, float) else str(each.default)
    return f"the scene's, else {default}" if each.setting.of == "job" else default
