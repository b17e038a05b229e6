"""glTF cameras (specification 3.10), which look along their node's -Z with +Y up."""

from __future__ import annotations

import math

import numpy as np

from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.transforms import Matrix, unit_vector, vec3
from renderer.scene.readers.number_ranges import clamped
from renderer.sentences import Sentence
from renderer.settings import View

__all__ = ["read_camera"]

_FAR = 1e9


def read_camera(source: Json, world: Matrix) -> View:
    """Returns the view of a camera on a node; the node's scale is ignored. Raises SettingsError if the view is invalid."""
    eye, forward, up = world[:3, 3], unit_vector(-world[:3, 2]), unit_vector(world[:3, 1])
    target = eye + forward * max(1.0, float(np.abs(eye).max()))
    orthographic = source.object("orthographic")
    if source.text("type", "perspective") == "orthographic" and orthographic:
        height = 2 * abs(orthographic.number("ymag", 1.0))
        near = _near_distance(orthographic)
        return View(vec3(eye), vec3(target), vec3(up), projection="orthographic", height=height, near=near)
    perspective = source.object("perspective")
    if perspective is None or "yfov" not in perspective:
        source.replace("perspective.yfov", Sentence("gltf-fov-missing", "missing and replaced by 40 degrees"))
    fov = math.degrees(perspective.number("yfov", math.radians(40)) if perspective else math.radians(40))
    return View(vec3(eye), vec3(target), vec3(up), fov, near=_near_distance(perspective))


def _near_distance(source: Json | None) -> float:
    """Returns the near clipping distance, which is applied as in other glTF viewers; 0 if absent."""
    return 0.0 if source is None else clamped(source.number("znear", 0.0), 0.0, _FAR)
