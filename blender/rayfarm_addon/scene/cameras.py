"""Exports Blender's cameras: position, projection and depth of field."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from .model import Scene, to_y_up
from .view import Lens, Shot, shot_of

__all__ = ["lens_of", "shot_of_camera", "with_keys"]

F64 = npt.NDArray[np.float64]
NAME = "camera"
PANORAMA = "PANO"


def lens_of(scene: Scene | None, camera: Any) -> Lens:
    """Returns a camera object's lens data: depth of field and clipping."""
    data = camera.data
    near = float(data.clip_start)
    if not data.dof.use_dof or data.type == PANORAMA:
        return Lens(near=near)
    if data.type == "ORTHO":
        if scene is not None:
            scene.warn("Camera: depth of field of an orthographic camera is left out.")
        return Lens(near=near)
    dof = data.dof
    if scene is not None and (dof.aperture_blades or abs(dof.aperture_ratio - 1) > 1e-3):
        scene.warn("Camera: its lens is round, without blades and not stretched.")
    # As in Cycles: radius = focal length in metres / (2 f-number).
    radius = float(data.lens) * 1e-3 / (2 * max(float(dof.aperture_fstop), 1e-5))
    return Lens(radius, _focus(camera), near)


def _focus(camera: Any) -> float:
    dof = camera.data.dof
    if dof.focus_object is None:
        return float(dof.focus_distance)
    place = np.array(camera.matrix_world, np.float64)
    away = np.array(dof.focus_object.matrix_world, np.float64)[:3, 3] - place[:3, 3]
    forward = -place[:3, 2] / np.linalg.norm(place[:3, 2])
    return max(float(away @ forward), 1e-4)


def shot_of_camera(
    scene: Scene,
    camera: Any,
    place: F64,
    projection: F64,
    size: tuple[int, int],
    border: tuple[int, int, int, int] | None = None,
) -> Shot:
    """Returns the Shot (view and needed part) that shows the camera's image. Raises ValueError if its lens is not supported."""
    if camera.data.type == PANORAMA:
        kind = getattr(camera.data, "panorama_type", None) or getattr(getattr(camera.data, "cycles", None), "panorama_type", "")
        if kind != "EQUIRECTANGULAR":
            scene.warn("Camera: its panorama is taken as an equirectangular one.")
        eye = place[:3, 3]
        view = {"eye": to_y_up(eye), "target": to_y_up(eye - place[:3, 2]), "up": to_y_up(place[:3, 1]), "projection": "panorama"}
        x0, y0, x1, y1 = border or (0, 0, *size)
        return Shot(view, *size, x0, size[1] - y1, x1 - x0, y1 - y0)
    return shot_of(place, projection, size, lens_of(scene, camera), border)


def with_keys(
    scene: Scene,
    shot: Shot,
    samples: list[tuple[float, F64, F64, Lens]],
    size: tuple[int, int],
    border: tuple[int, int, int, int] | None = None,
) -> bool:
    """Adds the camera, with keys while the shutter is open, to the exported scene; returns True if the camera moves.

    samples: for each key the time in seconds, transform, projection and lens. size, border: as for `shot_of`. Raises
    ValueError if the lens is not supported.
    """
    views = [(time, shot_of(place, projection, size, lens, border).view) for time, place, projection, lens in samples]
    names = {name: value for view in (shot.view, *(view for _, view in views)) for name, value in view.items()}
    if all(_have_equal_values(view, views[0][1], names) for _, view in views):
        return False
    told = {**shot.view, "name": NAME}
    for name, value in names.items():
        keys = [[time, view.get(name, shot.view.get(name, 0.0))] for time, view in views]
        if isinstance(value, list | float) and any(key[1] != keys[0][1] for key in keys):
            told[name] = {"keys": keys}
    scene.cameras = [told]
    return True


def _have_equal_values(a: dict[str, Any], b: dict[str, Any], names: dict[str, Any]) -> bool:
    numbers = [name for name, value in names.items() if not isinstance(value, str)]
    return all(np.allclose(a.get(name, 0.0), b.get(name, 0.0), rtol=1e-7, atol=1e-7) for name in numbers)
