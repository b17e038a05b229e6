"""Camera moves: turntables, and paths through other cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from renderer.errors import SettingsError
from renderer.scene.animation import smooth
from renderer.scene.animation.orbit import orbit
from renderer.scene.readers.yaml.lines import Path, Yaml
from renderer.scene.readers.yaml.values import vec3
from renderer.sentences import Sentence
from renderer.settings import View

__all__ = ["animated_view", "interpolated_view"]

_NUMBERS = ("fov", "height", "aperture", "near", "shift_x", "shift_y")


def animated_view(view: View, source: dict[str, Any], time: float) -> View:
    """Returns the view of a camera at a time in seconds, rotated about its target if the camera is on a turntable."""
    return orbit(view, time / source["turntable"]) if "turntable" in source else view


def interpolated_view(views: Sequence[View], seconds: float, time: float, document: Yaml, path: Path) -> View:
    """Returns the view, at a time, of a camera that moves smoothly through several views.

    The first view is at 0, the last at `seconds`. time: in seconds; path: of the camera in the document, for errors. Raises
    SceneError if the views cannot be interpolated.
    """
    first = views[0]
    if any(view.projection != first.projection for view in views):
        raise document.error(
            (*path, "through"),
            Sentence(
                "camera-move-projections-differ",
                "names cameras with different projections, which cannot be interpolated; use one projection",
            ),
        )
    rows = np.array([_row(view) for view in views])
    x = smooth(np.linspace(0.0, seconds, len(views)), rows).values_at(time)
    try:
        numbers: dict[str, Any] = dict(zip(_NUMBERS, x[9:], strict=False))
        focus = None if all(view.focus is None for view in views) else x[-1]
        return replace(first, eye=vec3(x[:3]), target=vec3(x[3:6]), up=vec3(x[6:9]), focus=focus, **numbers)
    except SettingsError as error:
        raise document.error(
            (*path, "through"),
            Sentence(
                "camera-move-sees-nothing",
                "leads to a view of nothing after {time} s: {error}",
                time=f"{time:g}",
                error=error,
            ),
        ) from error


def _row(view: View) -> list[float]:
    focus = view.focus
    if focus is None:
        focus = float(np.linalg.norm(np.subtract(view.target, view.eye)))
    return [*view.eye, *view.target, *view.up, *(getattr(view, name) for name in _NUMBERS), focus]
