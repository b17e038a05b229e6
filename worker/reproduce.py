"""The command that renders the same samples without a farm. Imports no kernel: the service says it too."""

from __future__ import annotations

import math
import shlex
from typing import Any

from renderer.settings import OPTIONAL, RenderSettings, Tile

__all__ = ["batch_command", "sample_command"]

# Options whose name is not the setting's.
_NAMES = {"clamp_indirect": "clamp", "height": "ortho-height"}


def batch_command(settings: RenderSettings, tile: Tile, first: int, count: int) -> str:
    """The command for samples first ... first + count - 1 of a tile; SCENE stands for the uploaded file."""
    more = [f"--tile={_text(tile)}", f"--first={first}", f"--spp={count}", "--threads=1"]
    return shlex.join(["rayfarm", "render", "SCENE", "-o", "batch.exr", *_options(settings), *more])


def sample_command(settings: RenderSettings, x: int, y: int, sample: int) -> str:
    """The command that follows one path and prints its vertices; SCENE stands for the uploaded file."""
    return shlex.join(["rayfarm", "render", "SCENE", *_options(settings), f"--pixel={x},{y}", f"--sample={sample}"])


def _options(settings: RenderSettings) -> list[str]:
    """Every setting, said in full: the scene file's own must not take the place of one that was left out."""
    view = dict(vars(settings.view))
    if view["focus"] is None:
        view["focus"] = math.dist(settings.view.eye, settings.view.target)
    if settings.view.aperture == 0.0:
        del view["focus"]
    words = [f"--size={settings.width}x{settings.height}"]
    for name, value in [*view.items(), *((name, getattr(settings, name)) for name in OPTIONAL)]:
        if value is not None:
            words.append(f"--{_NAMES.get(name, name.replace('_', '-'))}={_text(value)}")
    if settings.environment is not None:
        words.append(f"--env={_text(settings.environment)}")
    if settings.environment_strength != 1.0:
        words.append(f"--env-strength={settings.environment_strength!r}")
    if settings.environment_rotation != 0.0:
        words.append(f"--env-rotation={settings.environment_rotation!r}")
    return words


def _text(value: Any) -> str:
    if isinstance(value, (tuple, list)):
        return ",".join(_text(part) for part in value)
    return value if isinstance(value, str) else repr(value)
