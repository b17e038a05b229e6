"""USD cameras: they look along -Z with +Y up; focal length and apertures are in tenths of a stage unit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pxr import UsdGeom

from renderer.scene.description import Vec3
from renderer.scene.matrices import Matrix
from renderer.scene.readers.number_ranges import clamped
from renderer.scene.readers.usd.notes import Notes
from renderer.sentences import Sentence
from renderer.settings import View
from renderer.view import MAX_SHIFT

__all__ = ["read_camera", "shutter_of"]

_TENTH = 0.1
_LEAST = 1e-6
_FAR = 1e9
_USUAL_LENS = (50.0, 15.2908)  # focal length and vertical aperture, by the schema
_EXPOSURE = ("time", "iso", "fStop", "responsivity")


def read_camera(prim: Any, world: Matrix, unit: float, time: Any, notes: Notes) -> View:
    """Returns the view of a camera; the scale of its transform is ignored.

    world: (4, 4) transform to metres; unit: metres per stage unit. Raises SettingsError if the camera's values give no valid
    view.
    """
    camera = UsdGeom.Camera(prim)

    def number_of(attribute: Any) -> float:
        value = attribute.Get(time)
        return float(value) if value is not None and math.isfinite(value) else 0.0

    if len(camera.GetClippingPlanesAttr().Get(time) or ()):
        notes.add(Sentence("usd-clipping-planes-ignored", "Clipping planes of cameras are ignored"), prim.GetName())
    if abs(number_of(camera.GetExposureAttr())) > 0 or any(
        attribute.HasAuthoredValue() for name in _EXPOSURE if (attribute := prim.GetAttribute(f"exposure:{name}"))
    ):
        notes.add(
            Sentence("usd-camera-exposure-ignored", "The exposure of cameras is left out: it is set when the picture is shown"),
            prim.GetName(),
        )
    eye = world[:3, 3]
    forward, up = (v / max(float(np.linalg.norm(v)), 1e-300) for v in (-world[:3, 2], world[:3, 1]))
    focus = number_of(camera.GetFocusDistanceAttr()) * unit
    target = eye + forward * (focus if focus > _LEAST else max(unit, float(np.abs(eye).max())))
    height = abs(number_of(camera.GetVerticalApertureAttr()))
    offsets = number_of(camera.GetHorizontalApertureOffsetAttr()), number_of(camera.GetVerticalApertureOffsetAttr())
    x, y = (clamped(offset / height, -MAX_SHIFT, MAX_SHIFT) if height > 0 else 0.0 for offset in offsets)
    shift: dict[str, Any] = {"shift_x": x, "shift_y": y}
    if camera.GetClippingRangeAttr().HasAuthoredValue():
        shift["near"] = clamped(float(camera.GetClippingRangeAttr().Get(time)[0]) * unit, 0.0, _FAR)
    if camera.GetProjectionAttr().Get(time) == "orthographic":
        tall = max(height * _TENTH * unit, _LEAST)
        return View(_vec3(eye), _vec3(target), _vec3(up), projection="orthographic", height=tall, **shift)
    length = number_of(camera.GetFocalLengthAttr())
    if not (length > 0 and height > 0):
        notes.add(
            Sentence("usd-camera-lens-invalid", "Cameras without a positive focal length and aperture get those of a 50 mm lens"),
            prim.GetName(),
        )
        length, height = _USUAL_LENS
    length = max(length, _LEAST)
    fov = clamped(math.degrees(2 * math.atan(height / (2 * length))), 0.01, 179.0)
    stop = number_of(camera.GetFStopAttr())
    if stop > 0 and focus > _LEAST:
        shift |= {"aperture": length * _TENTH * unit / (2 * stop), "focus": focus}
    return View(_vec3(eye), _vec3(target), _vec3(up), fov, **shift)


def shutter_of(prim: Any, time: Any, notes: Notes) -> float:
    """Returns the fraction of a frame during which the camera's shutter is open; 0 if not authored.

    The interval is centred on the frame's time; a note is added if the file's interval is not.
    """
    camera = UsdGeom.Camera(prim)
    attributes = camera.GetShutterOpenAttr(), camera.GetShutterCloseAttr()
    if not any(attribute.HasAuthoredValue() for attribute in attributes):
        return 0.0
    opens, closes = (float(attribute.Get(time) or 0.0) for attribute in attributes)
    if closes > opens and abs(opens + closes) > 0.01 * (closes - opens):
        notes.add(
            Sentence("usd-shutter-recentred", "Shutters that are not centred on the frame are centred"),
            prim.GetName(),
        )
    return clamped(closes - opens, 0.0, 1.0)


def _vec3(v: Any) -> Vec3:
    return float(v[0]), float(v[1]), float(v[2])
