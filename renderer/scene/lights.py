"""Lists the lights (emitting primitives and punctual lights), and tabulates the probability of choosing each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays.light_rows import LIGHT_ROWS, LIGHT_WIDTH
from renderer.arrays.scene import CompiledScene
from renderer.scene.description import F32, I32
from renderer.scene.geometry import Geometry
from renderer.scene.light_tree import LightBounds, build_light_tree
from renderer.scene.parallelograms import pair, tabulate_parallelograms
from renderer.scene.punctual import Punctual

__all__ = ["TREE_FROM", "Emitters", "LightList", "cumulative", "emitters_with_area", "list_lights", "with_light_choice"]

TREE_FROM = 3  # lights; for two single triangles the tree costs more than it saves (docs/speed-notes.md)
_BETWEEN_KEYS = 0.1  # radians, by which a normal may deviate further between two keys
_UNIFORM_FRACTION = 0.01  # fraction of the choices by power that are uniform over all lights


class Emitters(NamedTuple):
    """The emitting triangles of a geometry, with the material and the emitted luminance of each."""

    triangle: npt.NDArray[np.int64]  # (n,) ascending
    material: I32  # (n,)
    emitted: np.ndarray  # (n,) mean luminance, float64, of both sides if both emit


class LightList(NamedTuple):
    """The light tables of CompiledScene, and the sum of the powers of all lights, as luminance."""

    primitive: I32  # (L,)
    cdf: F32  # (L + 1,)
    area: F32  # (L,)
    parallelogram: F32  # (L, PARALLELOGRAM), or no rows if no light is one
    second: I32  # (L,) the second triangle of a parallelogram, else -1
    triangle_light: I32  # (T,), or no rows if no triangle emits
    sphere_light: I32  # (S,)
    node: F32  # (Y, LIGHT_ROWS, 8)
    power: float


def list_lights(
    emitted: np.ndarray,
    emitters: Emitters,
    double_sided: np.ndarray,
    is_uniform: npt.NDArray[np.bool_],
    geometry: Geometry,
    sphere: F32,
    sphere_material: I32,
    punctual: Punctual,
    sphere_keys: F32 = np.zeros((0, 0, 4), np.float32),
) -> LightList:
    """Lists the primitives with emissive materials and the punctual lights, in the order of the light tree if there is one.

    emitted: (M,) mean luminance of all sides of each material. double_sided: (M,) bool. is_uniform: (M,) whether a material emits
    equally at every point; two such triangles that form a parallelogram are one light. sphere_keys: (K or 0, Z, 4) of the last
    spheres while the shutter is open; for moving lights, powers and bounds are the maxima.

    The cdf is by power (of a primitive: pi * area * radiance), mixed with a uniform choice of probability 0.01: otherwise float32
    would never choose a candle among a stadium's lamps.
    """
    lamps = _area_lights(emitters, is_uniform, geometry)
    emitters, pairs = lamps.emitters, lamps.pairs
    triangles, brightness = emitters.triangle, emitters.emitted
    spheres = np.flatnonzero(emitted[sphere_material] > 0) if len(sphere) else np.zeros(0, np.int64)
    radiance = np.concatenate([brightness, emitted[sphere_material[spheres]]])
    triangle_area = 0.5 * np.linalg.norm(
        _area_normals(geometry.position[geometry.triangle[triangles]].astype(np.float64)), axis=1
    )
    triangle_area[pairs] = lamps.most[pairs]
    sphere_area = 4 * np.pi * sphere[spheres, 3].astype(np.float64) ** 2
    balls = _spheres_over_shutter(sphere, spheres, sphere_keys)
    most_of_spheres = 4 * np.pi * balls[:, :, 3].max(axis=0, initial=0.0) ** 2

    rest = len(geometry.triangle) + len(sphere) + np.arange(len(punctual.power))
    primitive = np.concatenate([triangles, len(geometry.triangle) + spheres, rest])
    area = np.concatenate([triangle_area, sphere_area])
    power = np.concatenate([np.pi * np.concatenate([lamps.most, most_of_spheres]) * radiance, punctual.power])
    area = np.concatenate([area, np.zeros(len(rest))])
    node = np.zeros((0, LIGHT_ROWS, LIGHT_WIDTH), np.float32)
    order = np.arange(len(primitive))
    if len(primitive) >= TREE_FROM or (len(primitive) == 2 and (len(triangles) < 2 or len(pairs) > 0)):
        both = double_sided[emitters.material]
        bounds = (
            _triangle_bounds(lamps.corners, lamps.most * radiance[: len(triangles)], both),
            _sphere_bounds(balls, most_of_spheres / 4 * radiance[len(triangles) :]),
            punctual.bounds,
        )
        order, node = build_light_tree(LightBounds(*(np.concatenate(column) for column in zip(*bounds, strict=True))))
        primitive, area, power = primitive[order], area[order], power[order]
    chance = (1 - _UNIFORM_FRACTION) * power / max(power.sum(), 1e-300) + _UNIFORM_FRACTION / max(len(power), 1)
    bodies = len(geometry.triangle) if len(triangles) else 0  # nothing to look up if no triangle emits
    light = np.full(bodies + len(sphere) + len(rest), -1, np.int32)
    light[primitive - (len(geometry.triangle) - bodies)] = np.arange(len(primitive))
    of_pairs = np.argsort(order)[pairs]
    light[lamps.second] = of_pairs
    second = np.full(len(primitive), -1, np.int32)
    second[of_pairs] = lamps.second
    return LightList(
        primitive.astype(np.int32),
        cumulative(chance),
        area.astype(np.float32),
        tabulate_parallelograms(of_pairs, lamps.shapes, len(primitive)),
        second,
        light[:bodies],
        light[bodies : bodies + len(sphere)],
        node,
        float(power.sum()),
    )


class _AreaLights(NamedTuple):
    """The area lights among a scene's triangles: single emitting triangles, and pairs that form a parallelogram.

    A pair is represented by its first triangle.
    """

    emitters: Emitters
    corners: np.ndarray  # (K, n, 4, 3) at the keys of the shutter; a triangle's last one twice
    most: np.ndarray  # (n,) maximum areas while the shutter is open
    pairs: npt.NDArray[np.int64]  # (m,) indices of the emitters that are parallelograms
    second: npt.NDArray[np.int64]  # (m,) second triangles of these
    shapes: np.ndarray  # (m, 4, 3) corners of these, from `pair`


def _area_lights(emitters: Emitters, is_uniform: npt.NDArray[np.bool_], geometry: Geometry) -> _AreaLights:
    over = _corners_over_shutter(geometry, emitters.triangle)
    pairs, shapes = pair(over[0], _may_form_one_light(emitters, is_uniform, over))
    most = 0.5 * np.linalg.norm(_area_normals(over), axis=2).max(axis=0)
    most[pairs] += most[pairs + 1]
    corners = np.concatenate([over, over[:, :, 2:]], axis=2)
    corners[:, pairs, 3] = shapes[:, 3]
    kept = np.delete(np.arange(len(emitters.triangle)), pairs + 1)
    first = Emitters(emitters.triangle[kept], emitters.material[kept], emitters.emitted[kept])
    second = emitters.triangle[pairs + 1]
    return _AreaLights(first, corners[:, kept], most[kept], np.searchsorted(kept, pairs), second, shapes)


def emitters_with_area(emitters: Emitters, geometry: Geometry) -> Emitters:
    """Returns the emitting triangles whose area in this frame is not 0.

    Triangles that deform may have no area in some frames only.
    """
    a, b, c = (geometry.position[geometry.triangle[emitters.triangle, k]].astype(np.float64) for k in range(3))
    solid = np.cross(b - a, c - a).any(axis=1)
    return emitters if solid.all() else Emitters(emitters.triangle[solid], emitters.material[solid], emitters.emitted[solid])


def with_light_choice(scene: CompiledScene, light_choice: str) -> CompiledScene:
    """Returns the scene with lights chosen as specified by RenderSettings.light_choice.

    If lights are chosen by power, the environment keeps its probability; if uniformly, it has the probability of a single light.
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


def _area_normals(corners: np.ndarray) -> np.ndarray:
    """Returns the normals of triangles with (..., 3, 3) corners; their length is twice the area."""
    return np.cross(corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :])


def _may_form_one_light(emitters: Emitters, is_uniform: npt.NDArray[np.bool_], starts_group: np.ndarray) -> npt.NDArray[np.bool_]:
    """Returns a mask (n - 1,): whether an emitting triangle and the next one may form one light.

    Both must be static and have the same material, which must emit equally at every point.
    """
    still = (starts_group == starts_group[0]).all(axis=(0, 2, 3)) & is_uniform[emitters.material]
    return still[:-1] & still[1:] & (emitters.material[:-1] == emitters.material[1:])


def _corners_over_shutter(geometry: Geometry, triangles: np.ndarray) -> np.ndarray:
    """Returns the corners (K, n, 3, 3) of triangles at all keys of the shutter; K = 1 if no vertex moves."""
    corners = geometry.position[geometry.triangle[triangles]].astype(np.float64)
    if not len(geometry.keys):
        return corners[None]
    found = np.repeat(corners[None], len(geometry.keys), axis=0)
    vertex = geometry.triangle[triangles] - (len(geometry.position) - geometry.keys.shape[2])
    moves = vertex[:, 0] >= 0
    found[:, moves] = geometry.keys[:, 0][:, vertex[moves]]
    return found


def _spheres_over_shutter(sphere: F32, spheres: np.ndarray, keys: F32) -> np.ndarray:
    """Returns the centres and radii, (K, n, 4), of selected spheres at the K keys of the shutter; K = 1 if nothing moves.

    sphere: (S, 4), all spheres; the moving ones are the last. spheres: (n,), the numbers of the selected ones. keys: (K, M, 4):
    the moving ones at each key.
    """
    found = np.repeat(sphere[None, spheres].astype(np.float64), max(len(keys), 1), axis=0)
    if len(keys):
        number = spheres - (len(sphere) - keys.shape[1])
        found[:, number >= 0] = keys[:, number[number >= 0]]
    return found


def _triangle_bounds(corners: np.ndarray, intensity: np.ndarray, both: np.ndarray) -> LightBounds:
    """Returns the light bounds of triangles or parallelograms, over all keys of the shutter.

    The axis is the first key's normal, and `spread` is the greatest deviation from it. corners: (K, n, 4, 3); the fourth corner
    of a triangle repeats its last. both: whether both sides emit.
    """
    center = (corners.min(axis=(0, 2)) + corners.max(axis=(0, 2))) / 2
    radius = np.linalg.norm(corners - center[:, None], axis=3).max(axis=(0, 2))
    cross = _area_normals(corners)
    length = np.linalg.norm(cross, axis=2, keepdims=True)
    axes = np.where(length > 0, cross / np.maximum(length, 1e-300), (0.0, 0.0, 1.0))
    spread = np.zeros(len(center))
    if len(corners) > 1:
        strays = np.arccos(np.clip((axes * axes[0]).sum(axis=2), -1.0, 1.0)).max(axis=0)
        spread = np.where(strays > 0, np.minimum(strays + _BETWEEN_KEYS, np.pi), 0.0)
    quarter = np.full(len(center), np.pi / 2)
    return LightBounds(center, radius, axes[0], spread, quarter, np.where(both, 0.5, 1.0) * intensity, both)


def _sphere_bounds(balls: np.ndarray, intensity: np.ndarray) -> LightBounds:
    """Returns the light bounds of spheres, over all keys of the shutter. balls: (K, n, 4) centres and radii."""
    center, radius = balls[0, :, :3], balls[0, :, 3]
    if len(balls) > 1:
        center = (balls[:, :, :3].min(axis=0) + balls[:, :, :3].max(axis=0)) / 2
        radius = (np.linalg.norm(balls[:, :, :3] - center, axis=2) + balls[:, :, 3]).max(axis=0)
    up = np.broadcast_to((0.0, 0.0, 1.0), (len(center), 3))
    all_around, quarter = np.full(len(center), np.pi), np.full(len(center), np.pi / 2)
    return LightBounds(center, radius, up, all_around, quarter, intensity, np.zeros(len(center)))


def cumulative(weights: np.ndarray) -> F32:
    """Returns the cdf over the last axis, starting with 0 and ending with exactly 1; uniform if all weights are 0."""
    count = weights.shape[-1]
    total = weights.sum(axis=-1, keepdims=True)
    weights = np.where(total > 0, weights, 1.0)
    sums = np.cumsum(weights, axis=-1)
    cdf = np.zeros((*weights.shape[:-1], count + 1), np.float32)
    if count:
        cdf[..., 1:] = sums / sums[..., -1:]
        cdf[..., -1] = 1.0
    return cdf
