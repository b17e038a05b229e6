"""Lights and cameras of FBX files.

FBX gives lights a colour and a percentage, without a unit. Blender writes watts (for a sun, watts per square metre), which are
used as such. In other files, a directional light of 100 % makes a white surface white; a light with quadratic decay does so at a
distance of one unit of the file, and a light without decay, which is not physical, at the centre of the scene.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Light, Material, Vec3
from renderer.scene.readers.number_ranges import blended_cone, clamped
from renderer.settings import View
from renderer.view import MAX_SHIFT

__all__ = ["AREA_SIDE", "area_material", "is_area", "read_camera", "read_light", "upright_square"]

F64 = npt.NDArray[np.float64]

POINT, DIRECTIONAL, SPOT, AREA, VOLUME = range(5)
_QUADRATIC = 2
_MAX = 1e12
_FAR = 1e9
_INCH = 25.4  # millimetres
AREA_SIDE = 1.0  # units of the file, of an unscaled area light; FBX does not store the size


def is_area(light: Any) -> bool:
    """Returns True if a light is an area light."""
    return bool(light.kind == AREA)


def _color(light: Any, scale: float) -> Vec3:
    r, g, b = (clamped(float(np.nan_to_num(c)) * float(np.nan_to_num(light.intensity)) * scale, 0.0, _MAX) for c in light.color)
    return r, g, b


def read_light(light: Any, name: str, world: F64, by_blender: bool, unit: float, middle: F64) -> Light:
    """Returns a point, spot or directional light.

    world: (4, 4) transform of its node; by_blender: whether Blender wrote the file; unit: metres per unit of the file; middle:
    centre of the visible geometry.
    """
    towards = world[:3, :3] @ np.array(light.direction)
    length = float(np.linalg.norm(towards))
    x, y, z = (float(c) for c in (towards / length if length > 0 else (0.0, -1.0, 0.0)))
    position = (float(world[0, 3]), float(world[1, 3]), float(world[2, 3]))
    if light.kind == DIRECTIONAL:
        return Light("directional", _color(light, 1.0 if by_blender else math.pi), position, (x, y, z), name=name)
    if by_blender:
        scale = 1 / (4 * math.pi)
    elif light.decay == _QUADRATIC:
        scale = math.pi * unit**2
    else:
        scale = math.pi * max(float(np.linalg.norm(world[:3, 3] - middle)), 1e-3) ** 2
    if light.kind != SPOT:
        return Light("point", _color(light, scale), position, (x, y, z), name=name)
    outer = clamped(light.outer_angle / 2, 0.01, 90.0)
    inner = clamped(light.inner_angle / 2, 0.0, outer)
    spot = Light("spot", _color(light, scale), position, (x, y, z), inner_cone=inner, outer_cone=outer, name=name)
    if by_blender:  # its exporter stores the blend as a fraction of the angle; it is one of the cosine
        spot.inner_cone, spot.falloff = blended_cone(outer, 1 - inner / outer), "smooth"
    return spot


def area_material(light: Any, name: str, world: F64, by_blender: bool) -> Material:
    """Returns the emissive material of the square that represents an area light."""
    side = upright_square(light, world)[:3, :2]
    area = float(np.linalg.norm(np.cross(side[:, 0], side[:, 1]))) * 4
    emission = _color(light, 1 / (math.pi * max(area, 1e-12)) if by_blender else 1.0)
    # Blender's area lights are invisible to its camera by default, and rays pass through them.
    return Material(name, base_color=(0.0, 0.0, 0.0), emission=emission, lamp=by_blender, unseen=by_blender)


def upright_square(light: Any, world: F64) -> F64:
    """Returns the transform of the square that represents an area light: -1..1 in x and y, emitting along +Z.

    world: (4, 4) transform of the light's node.
    """
    z = np.array(light.direction, np.float64)
    x = np.cross((0.0, 0.0, 1.0) if abs(z[2]) < 0.9 else (1.0, 0.0, 0.0), z)
    x /= max(float(np.linalg.norm(x)), 1e-12)
    turn = np.eye(4)
    turn[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    half = np.diag([AREA_SIDE / 2, AREA_SIDE / 2, 1.0, 1.0])
    # `world` includes the root's scale from units of the file to metres, unless the node undoes it, as Blender's do.
    return np.asarray(world @ turn @ half, np.float64)


def read_camera(
    camera: Any, world: F64, film_offset: tuple[float, float] = (0.0, 0.0), near: float = 0.0, tall: float = 1.0
) -> View:
    """Returns the view of a camera, which looks along its node's +X with +Y up; the node's scale is ignored.

    film_offset: in inches; near: distance of the near clipping plane in metres; tall: height of an orthographic view in metres.
    Raises SettingsError if the view is invalid.
    """
    near = clamped(float(np.nan_to_num(near)), 0.0, _FAR)
    eye, forward, up = world[:3, 3], _unit(world[:3, 0]), _unit(world[:3, 1])
    target = eye + forward * max(1.0, float(np.abs(eye).max()))
    points = (tuple(float(c) for c in v) for v in (eye, target, up))
    a, b, c = points
    if camera.projection == 1:
        return View(a, b, c, projection="orthographic", height=abs(tall), near=near)  # type: ignore[arg-type]
    fov = clamped(float(np.nan_to_num(camera.fov[1])) or 40.0, 0.01, 179.0)
    height = 2 * math.tan(math.radians(fov) / 2) * max(float(np.nan_to_num(camera.focal_mm)), 1e-6) / _INCH  # of the film, inches
    x, y = (clamped(float(np.nan_to_num(each)) / height, -MAX_SHIFT, MAX_SHIFT) for each in film_offset)
    return View(a, b, c, fov, shift_x=x, shift_y=y, near=near)  # type: ignore[arg-type]


def _unit(vector: F64) -> F64:
    return vector / max(float(np.linalg.norm(vector)), 1e-30)
