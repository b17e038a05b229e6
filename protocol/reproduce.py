"""Command lines that render a batch or trace a path again without a farm. Imports no kernel, since the service imports it."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from typing import Any

from renderer.setting_declaration import DeclaredSetting
from renderer.settings import ENVIRONMENT, OPTIONAL, SETTINGS, VIEW, RenderSettings, Tile

__all__ = ["batch_command", "sample_command"]


def batch_command(settings: RenderSettings, tile: Tile, first: int, count: int) -> str:
    """Returns the command that renders samples first ... first + count - 1 of a tile. SCENE in it is the uploaded file."""
    more = [f"--tile={_text(tile)}", f"--first={first}", f"--spp={count}", "--threads=1"]
    return shlex.join(["rayfarm", "render", "SCENE", "-o", "batch.exr", *_options(settings), *more])


def sample_command(settings: RenderSettings, x: int, y: int, sample: int, scene_options: Sequence[str] = ()) -> str:
    """Returns the command that traces one path and prints its vertices. SCENE in it stands for the uploaded file.

    scene_options: options that affect how the file is read, such as `--no-floor`.
    """
    where = [f"--pixel={x},{y}", f"--sample={sample}"]
    return shlex.join(["rayfarm", "render", "SCENE", *scene_options, *_options(settings), *where])


def _options(settings: RenderSettings) -> list[str]:
    """Returns command-line options for all settings, even for those with default values.

    Otherwise values in the scene file would replace the defaults.
    """
    view = dict(vars(settings.view))
    if view["focus"] is None:
        view["focus"] = math.dist(settings.view.eye, settings.view.target)
    if settings.view.aperture == 0.0:
        del view["focus"]
    words = [f"--size={settings.width}x{settings.height}"]
    if not settings.views:  # a camera that moves while the shutter is open is not said by a view: whoever knows its name adds it
        lens = view.pop("distortion")
        words += [_option_text(VIEW[name], value) for name, value in view.items()]
        words += [f"--distortion={_text((lens.model, *lens.coefficients))}"] if lens is not None else []
    words += [_option_text(SETTINGS[name], getattr(settings, name)) for name in OPTIONAL]
    if settings.environment is not None:
        words.append(f"--env={_text(settings.environment)}")
    for name, each in ENVIRONMENT.items():
        value = getattr(settings, each.name)
        if name != "color" and value != each.default:
            words.append(_option_text(each, value))
    return words


def _option_text(each: DeclaredSetting, value: Any) -> str:
    return f"--{each.option}={_text(value)}"


def _text(value: Any) -> str:
    if isinstance(value, (tuple, list)):
        return ",".join(_text(part) for part in value)
    return value if isinstance(value, str) else repr(value)
