"""Keyword arguments of render(), checked like the command line's options."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rayfarm import options
from rayfarm.errors import CommandError
from rayfarm.graphics_card import check_device
from rayfarm.options import Env, Placement
from rayfarm.picture import ENVIRONMENT_OPTIONS, LIMIT_OPTIONS, SETTINGS_OPTIONS, Picture
from renderer import aovs
from renderer.errors import SettingsError
from renderer.scene.animation import Moment
from renderer.setting_declaration import DeclaredSetting
from renderer.settings import VIEW

__all__ = ["RenderArguments", "parse_arguments"]

_LIBRARY_ARGUMENTS = (
    *("width", "height", "camera", "environment", "frame", "fps", "clip", "variant", "up_axis", "floor", "aovs", "denoise"),
    *("threads", "device", "distortion"),
)
_FLOORS = {None: None, False: None, True: "on", options.AUTO: options.AUTO}
_TABLES: tuple[Mapping[str, DeclaredSetting], ...] = (LIMIT_OPTIONS, VIEW, SETTINGS_OPTIONS, ENVIRONMENT_OPTIONS)


class _LibraryPicture(Picture):
    """A Picture whose size and environment are given as values instead of text."""

    def _size(self) -> tuple[int, int] | None:
        size: tuple[int, int] | None = self.given.get("size")
        return size

    def environment(self) -> Env:
        light: Env = self.given["env"]
        return light

    def placement(self) -> Placement:
        """Returns the requested up axis and floor. By default there is no floor: a program's scene is rendered as given."""
        floor = self.given.get("floor")
        if not isinstance(floor, bool | str | None) or floor not in _FLOORS:
            raise SettingsError(f"floor is {floor!r}; it is True, False, or 'auto': if the scene has no light")
        try:
            return Placement(options.parse_up_axis(_text(self.given.get("up_axis"))), _FLOORS[floor])
        except CommandError as error:
            raise SettingsError(str(error).replace("--up-axis", "up_axis")) from None


@dataclass(frozen=True)
class RenderArguments:
    """The parsed keyword arguments: the picture, the scene's moment, and the requested outputs."""

    picture: Picture
    moment: Moment = field(default_factory=Moment)
    variant: str | None = None
    aovs: tuple[str, ...] = aovs.AOVS
    denoise: bool = False
    threads: int | None = None
    device: str = "cpu"  # cpu, cuda or cuda:NUMBER


def parse_arguments(given: Mapping[str, Any]) -> RenderArguments:
    """Parses the keywords of `render`. Raises TypeError for an unknown one, SettingsError for an invalid value."""
    names = {_keyword(each): each for table in _TABLES for each in table.values()}
    for name in given:
        if name not in names and name not in _LIBRARY_ARGUMENTS:
            near = difflib.get_close_matches(name, [*names, *_LIBRARY_ARGUMENTS], 1)
            raise TypeError(f"{name!r} is not a setting of a picture" + (f"; did you mean {near[0]!r}?" if near else ""))
    values = {each.option.replace("-", "_"): _to_builtin(given[name]) for name, each in names.items() if name in given}
    for name, each in names.items():
        if given.get(name) is not None:
            each.check(_to_builtin(given[name]))
    camera = given.get("camera")
    picture = _LibraryPicture(
        {
            **values,
            "size": _size(given),
            "env": _light(given.get("environment")),
            "camera": None if camera is None else str(camera),
            "up_axis": given.get("up_axis"),
            "floor": given.get("floor"),
            "distortion": given.get("distortion"),
        }
    )
    picture.placement()
    wanted = given.get("aovs")
    named = [wanted] if isinstance(wanted, str) else wanted or ()
    if aovs.CRYPTOMATTE in named:
        raise SettingsError(
            "aovs has cryptomatte, which is written to files only: by `rayfarm render --aov`, or by a farm's image.exr"
        )
    planes = ["all"] if wanted is None else aovs.parse_names((name for name in named if name != "color"), None)  # always present
    moment = Moment(float(given.get("frame") or 0), given.get("fps"), _text(given.get("clip")))
    device = check_device(given.get("device"))
    return RenderArguments(
        picture, moment, _text(given.get("variant")), tuple(planes), bool(given.get("denoise")), given.get("threads"), device
    )


def _keyword(setting: DeclaredSetting) -> str:
    """Returns a setting's keyword: its name, or its option's where the name is taken (`height`, which is in pixels here)."""
    return setting.option.replace("-", "_") if setting.name in _LIBRARY_ARGUMENTS else setting.name


def _text(value: Any) -> str | None:
    return None if value is None else str(value)


def _to_builtin(value: Any) -> Any:
    """Converts numpy arrays and scalars to Python values, and lists to tuples."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else tuple(value) if isinstance(value, list) else value


def _size(given: Mapping[str, Any]) -> tuple[int, int] | None:
    width, height = given.get("width"), given.get("height")
    if (width is None) != (height is None):
        raise SettingsError("width and height go together: give both, or neither for the scene's own")
    return None if width is None or height is None else (int(width), int(height))


def _light(environment: Any) -> Env:
    if environment is None:
        return Env()
    if isinstance(environment, Path):
        if not environment.expanduser().is_file():
            raise SettingsError(f"environment: there is no file {environment}")
        return Env(image=environment.expanduser())
    if isinstance(environment, str):
        try:
            return options.environment_of(environment)
        except CommandError as error:
            raise SettingsError(str(error).replace("--env ", "").removeprefix("is ")) from None
    color = _to_builtin(environment)
    color = (color,) * 3 if isinstance(color, int | float) else color
    wrong = SettingsError("environment is a name, a colour of three numbers from 0, sky:ELEVATION,AZIMUTH, or an image's Path")
    try:
        r, g, b = (float(part) for part in color)
    except (TypeError, ValueError):
        raise wrong from None
    if not all(0 <= part < np.inf for part in (r, g, b)):
        raise wrong
    return Env(color=(r, g, b))
