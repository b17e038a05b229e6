"""Texts that describe settings for the page, the command's help and the documentation. They affect no sample's colour."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING
from typing import Any

from renderer.setting_declaration import DeclaredSetting, number_text, whole
from renderer.settings import SETTINGS, VIEW
from renderer.work import DEFAULT_SIZE, DEFAULT_SPP, SHOT, WORK

__all__ = ["LARGE", "described", "sentences", "values"]

LARGE = 1e6  # larger bounds are not shown


def values(each: DeclaredSetting) -> str:
    """Returns the accepted values of a setting as a short text, such as "1 to 64" or the list of accepted names."""
    setting = each.setting
    if setting.names is not None:
        return f"up to {setting.names} names, separated by commas"
    if setting.choices is not None:
        return ", ".join(filter(None, setting.choices))
    assert setting.low is not None
    assert setting.high is not None
    said = []
    if setting.high < LARGE:
        said.append(f"{number_text(setting.low)} to {number_text(setting.high)}")
    elif -LARGE < setting.low != setting.off:
        said.append(f"from {number_text(setting.low)}")
    if setting.off is not None:
        said.append(f"{number_text(setting.off)}: {each.shown.off}")
    return "; ".join(said)


def sentences(each: DeclaredSetting) -> str:
    """Returns the description of a setting, with the names it accepts or the value that switches it off."""
    if each.setting.choices is not None:
        return f"{each.shown.help.rstrip('.')}: {values(each)}."
    if each.setting.off is None:
        return each.shown.help
    taken = values(each)
    return f"{each.shown.help} {taken[0].upper()}{taken[1:]}."


def described(settings: Mapping[str, DeclaredSetting] = SETTINGS) -> dict[str, Any]:
    """Describes the settings of requests as JSON, in groups (settings, view, work, shot), for the page and other forms.

    `defaults` has size and samples of pictures whose scene file has none.
    """
    return {
        "defaults": {"width": DEFAULT_SIZE[0], "height": DEFAULT_SIZE[1], "spp": DEFAULT_SPP},
        "settings": [_described(each) for each in settings.values() if each.setting.of],
        "view": [_described(each) for each in VIEW.values()],
        "work": [_described(each) for each in WORK.values()],
        "shot": [_described(each) for each in SHOT.values()],
    }


def _described(each: DeclaredSetting) -> dict[str, Any]:
    setting, shown, choices = each.setting, each.shown, each.setting.choices
    return {
        "name": each.name,
        "label": shown.label,
        "help": shown.help,
        "type": _type(each),
        "default": None if each.default is MISSING else each.default,
        "minimum": whole(setting.low),
        "maximum": whole(setting.high),
        "off": {"value": whole(setting.off), "label": shown.off} if shown.off else None,
        "unit": shown.unit,
        "choices": choices and [{"name": name, "label": c.label, "help": c.help} for name, c in choices.shown.items()],
        "group": shown.group,
        "section": shown.section,
        "of": setting.of,
        "integrators": list(shown.integrators) or None,
        "projections": list(shown.projections) or None,
        "digest": setting.digest,
        "option": f"--{each.option}",
        "usual": None if shown.usual is None else [whole(bound) for bound in shown.usual],
        "phrase": shown.phrase or ("{}" if choices else f"{shown.label.lower()} {{}}"),
    }


def _type(each: DeclaredSetting) -> str:
    if each.kind is tuple:
        return "color" if each.shown.unit == "radiance" else "vector"
    if each.setting.names is not None:
        return "names"
    return "choice" if each.setting.choices is not None else "integer" if each.kind is int else "number"
