"""What shines: the list of emitting primitives and punctual lights, and the tables by which one of them is chosen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays.light_rows import LIGHT_ROWS, LIGHT_WIDTH
from renderer.arrays.scene import CompiledScene
from renderer.scene.description import F32, I32
from renderer.scene.geometry import Geometry
from renderer.scene.light_tree import LightBounds, build_light_tree
from renderer.scene.punctual import Punctual

__all__ = ["TREE_FROM", "Emitters", "LightList", "chosen_by", "cumulative", "list_lights", "luminance"]

TREE_FROM = 3  # lights; of the two triangles that most lamps are, the walk costs more than it saves (docs/performance.md)
_SPREAD = 0.01  # of the choices by power fall on all lights evenly


def luminance(rgb: np.ndarray) -> np.ndarray:
    """Rec.709 luminance of (..., 3)."""
    return rgb @ np.array([0.2126, 0.7152, 0.0722])


class Emitters(NamedTuple):
    """The triangles that emit."""

    triangle: npt.NDArray[np.int64]  # (n,) ascending
    material: I32  # (n,)
    emitted: np.ndarray  # (n,) mean luminance, float64, of both sides where both shine


class LightList(NamedTuple):
    """As in CompiledScene, and the sum of all powers in units of luminance."""

    primitive: I32  # (L,)
    cdf: F32  # (L + 1,)
    area: F32  # (L,)
    triangle_light: I32  # (T,), or no rows where no triangle emits
    sphere_light: I32  # (S,)
    node: F32  # (Y, LIGHT_ROWS, 8)
    power: float


def list_lights(
    emitted: np.ndarray,
    emitters: Emitters,
    double_sided: np.ndarray,
    geometry: Geometry,
    sphere: F32,
    sphere_material: I32,
    punctual: Punctual,
) -> LightList:
    """The primitives whose material emits, and the punctual lights, numbered in the order of the tree if there is one.

    emitted: (M,) mean luminance of all sides of each material; double_sided: (M,) bool. By power, the chance of choosing a light
    is its own (a primitive's: pi * area * radiance) over the sum of all, but for one choice in a hundred: else float32 would
    never choose a candle under a stadium's lamps.
    """
    emitters = _with_area(emitters, geometry)
    triangles, brightness = emitters.triangle, emitters.emitted
    spheres = np.flatnonzero(emitted[sphere_material] > 0) if len(sphere) else np.zeros(0, np.int64)
    corners = geometry.position[geometry.triangle[triangles]].astype(np.float64)
    radiance = np.concatenate([brightness, emitted[sphere_material[spheres]]])
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    triangle_area = 0.5 * np.linalg.norm(cross, axis=1)
    sphere_area = 4 * np.pi * sphere[spheres, 3].astype(np.float64) ** 2

    rest = len(geometry.triangle) + len(sphere) + np.arange(len(punctual.power))
    primitive = np.concatenate([triangles, len(geometry.triangle) + spheres, rest])
    area = np.concatenate([triangle_area, sphere_area])
    power = np.concatenate([np.pi * area * radiance, punctual.power])
    area = np.concatenate([area, np.zeros(len(rest))])
    node = np.zeros((0, LIGHT_ROWS, LIGHT_WIDTH), np.float32)
    if len(primitive) >= TREE_FROM or (len(primitive) == 2 and len(triangles) < 2):
        both = double_sided[emitters.material]
        bounds = (
            _triangle_bounds(corners, cross, triangle_area * radiance[: len(triangles)], both),
            _sphere_bounds(sphere[spheres], sphere_area / 4 * radiance[len(triangles) :]),
            punctual.bounds,
        )
        order, node = build_light_tree(LightBounds(*(np.concatenate(column) for column in zip(*bounds, strict=True))))
        primitive, area, power = primitive[order], area[order], power[order]
    chance = (1 - _SPREAD) * power / max(power.sum(), 1e-300) + _SPREAD / max(len(power), 1)
    bodies = len(geometry.triangle) if len(triangles) else 0  # where none emits, none is asked
    light = np.full(bodies + len(sphere) + len(rest), -1, np.int32)
    light[primitive - (len(geometry.triangle) - bodies)] = np.arange(len(primitive))
    return LightList(
        primitive.astype(np.int32),
        cumulative(chance),
        area.astype(np.float32),
        light[:bodies],
        light[bodies : bodies + len(sphere)],
        node,
        float(power.sum()),
    )


def _with_area(emitters: Emitters, geometry: Geometry) -> Emitters:
    """Without triangles that have no area, as those of what deforms may have at a moment."""
    a, b, c = (geometry.position[geometry.triangle[emitters.triangle, k]].astype(np.float64) for k in range(3))
    solid = np.cross(b - a, c - a).any(axis=1)
    return emitters if solid.all() else Emitters(emitters.triangle[solid], emitters.material[solid], emitters.emitted[solid])


def chosen_by(scene: CompiledScene, light_choice: str) -> CompiledScene:
    """The scene with its lights chosen as RenderSettings.light_choice says.

    The environment keeps its share where lights are chosen by power, and is one light among the others where uniformly.
    """
    if light_choice == "tree":
        return scene
    scene = scene._replace(light_node=scene.light_node[:0])
    if light_choice == "power":
        return scene
    count = len(scene.light_primitive)
    cdf = np.linspace(0, 1, count + 1).astype(np.float32)
    frame = scene.environment_frame.copy()
    if frame[3] > 0:
        frame[3] = 1 / (count + 1)
    cdf.flags.writeable = frame.flags.writeable = False
    return scene._replace(light_cdf=cdf, environment_frame=frame)


def _triangle_bounds(corners: np.ndarray, cross: np.ndarray, intensity: np.ndarray, both: np.ndarray) -> LightBounds:
    center = (corners.min(axis=1) + corners.max(axis=1)) / 2
    radius = np.linalg.norm(corners - center[:, None], axis=2).max(axis=1)
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    axis = np.where(length > 0, cross / np.maximum(length, 1e-300), (0.0, 0.0, 1.0))
    quarter = np.full(len(corners), np.pi / 2)
    return LightBounds(center, radius, axis, np.zeros(len(corners)), quarter, np.where(both, 0.5, 1.0) * intensity, both)


def _sphere_bounds(sphere: np.ndarray, intensity: np.ndarray) -> LightBounds:
    up = np.broadcast_to((0.0, 0.0, 1.0), (len(sphere), 3))
    all_around, quarter = np.full(len(sphere), np.pi), np.full(len(sphere), np.pi / 2)
    return LightBounds(sphere[:, :3], sphere[:, 3], up, all_around, quarter, intensity, np.zeros(len(sphere)))


def cumulative(weights: np.ndarray) -> F32:
    """The cdf over the last axis, with a 0 in front and exactly 1 at the end; uniform where all weights are 0."""
    count = weights.shape[-1]
    total = weights.sum(axis=-1, keepdims=True)
    weights = np.where(total > 0, weights, 1.0)
    sums = np.cumsum(weights, axis=-1)
    cdf = np.zeros((*weights.shape[:-1], count + 1), np.float32)
    if count:
        cdf[..., 1:] = sums / sums[..., -1:]
        cdf[..., -1] = 1.0
    return cdf
