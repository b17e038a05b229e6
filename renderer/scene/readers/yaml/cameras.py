"""Reads the cameras of a scene file."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from renderer.errors import SettingsError
from renderer.scene.readers.yaml.lines import Path, Yaml
from renderer.scene.readers.yaml.values import vec3
from renderer.sentences import Sentence
from renderer.settings import View

__all__ = ["read_view"]

_HALF_SENSOR = 0.012  # metres: half the height of a 36 x 24 mm picture


def read_view(source: dict[str, Any], document: Yaml, path: Path) -> View:
    """Returns the view of a camera of the scene file. Raises SceneError if the camera is invalid.

    path: the camera's path in the document, for errors.
    """
    if "aperture" in source and "f_stop" in source:
        raise document.error(path, Sentence("camera-aperture-and-f-stop", "has both aperture and f_stop; give one of them"))
    fields: dict[str, Any] = {key: vec3(source[key]) for key in ("eye", "target", "up") if key in source}
    fields |= {key: float(source[key]) for key in ("fov", "height", "aperture", "near", "shift_x", "shift_y") if key in source}
    fields |= {key: source[key] for key in ("projection",) if key in source}
    try:
        view = View(**fields)
        if "f_stop" in source:
            # The lens of a full-frame camera with this field of view, in a scene in metres: its radius is f / (2 N).
            focal_length = _HALF_SENSOR / np.tan(np.radians(view.fov / 2))
            view = replace(view, aperture=float(focal_length / (2 * source["f_stop"])))
        return replace(view, focus=_focus(source["focus"], view)) if "focus" in source else view
    except SettingsError as error:
        raise document.error(path, str(error)) from error


def _focus(value: Any, view: View) -> float:
    if not isinstance(value, list):
        return float(value)
    eye, forward = np.array(view.eye), np.subtract(view.target, view.eye)
    return float((np.array(value, np.float64) - eye) @ forward / np.linalg.norm(forward))
