"""Command line options generated from the setting declarations in renderer/settings.py: name, type, range, help."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import MISSING
from typing import Annotated, Any

import typer

from rayfarm import options
from renderer.setting_declaration import DeclaredSetting
from renderer.setting_docs import LARGE, sentences

__all__ = ["parameter", "typed_settings"]

_METAVARS = {"s": "S", "°": "DEG", "px": "PIXELS", "scene units": "LENGTH", "fraction": "FRACTION", "radiance": "RADIANCE"}


def parameter(each: DeclaredSetting) -> inspect.Parameter:
    """Returns the option for a setting, as a parameter of a command's signature. Its value is None if it is not given."""
    setting, shown = each.setting, each.shown
    inside = setting.off is None or each.lowest == setting.low  # otherwise a range would exclude the value for off
    ranged = each.kind in (int, float) and setting.choices is None and inside
    option = typer.Option(
        f"--{each.option}",
        help=_help(each),
        rich_help_panel=options.METHODS if shown.group == "lab" else shown.section,
        metavar=_metavar(each),
        min=_bound(setting.low) if ranged else None,
        max=_bound(setting.high) if ranged else None,
        show_default=False,
    )
    kind: Any = str if each.kind is tuple else each.kind
    return inspect.Parameter(
        each.option.replace("-", "_"),
        inspect.Parameter.KEYWORD_ONLY,
        default=None,
        annotation=Annotated[kind | None, option],
    )


def typed_settings(settings: Mapping[str, DeclaredSetting], given: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the settings' values by the renderer's names. given: the options' values; None if not given."""
    found = {name: given.get(each.option.replace("-", "_")) for name, each in settings.items()}
    for name, value in found.items():
        if settings[name].kind is tuple and isinstance(value, str):
            found[name] = options.parse_vec3(value, f"--{settings[name].option}")
    return found


def _metavar(each: DeclaredSetting) -> str | None:
    if each.setting.choices is not None:
        return "NAME"
    if each.setting.names is not None:
        return "NAME,..."
    if each.kind is tuple:
        return "R,G,B" if each.shown.unit == "radiance" else "X,Y,Z"
    return _METAVARS.get(each.shown.unit)


def _bound(value: float | None) -> float | None:
    return None if value is None or abs(value) >= LARGE else value


def _help(each: DeclaredSetting) -> str:
    """Returns the help text of a setting's option, with its default; camera settings have none."""
    if each.default in (MISSING, None, "", each.setting.off) or each.kind is tuple or each.shown.section == "View":
        return sentences(each)
    if each.setting.choices is not None:
        names = [f"{name} (default)" if name == each.default else name for name in each.setting.choices if name]
        return f"{each.shown.help.rstrip('.')}: {', '.join(names)}."
    return f"{sentences(each)} By default {each.default:g}."
