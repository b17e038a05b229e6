"""Lists the objects (casters) and the lamps between which specular manifold sampling is used (renderer/kernel/manifold/).

Casters are meshes and spheres of smooth glass or mirrors. Lamps are small ones: points, spots and suns, and emissive meshes and
spheres that look small from every caster. All other light stays with BSDF sampling.
"""

from __future__ import annotations

import weakref
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays import rows
from renderer.arrays.scene import CompiledScene
from renderer.kernel.light.punctual import DIRECTIONAL, SUN, SUN_UNSEEN
from renderer.kernel.manifold.brightness import LONG_LIGHT_COLUMNS, SEEDS
from renderer.kernel.manifold.walk import CODES
from renderer.luminance import REC_709
from renderer.scene.lights import cumulative

__all__ = ["MOST_CASTERS", "CausticTables", "caustic_tables", "example_tables", "with_caustics"]

MOST_CASTERS = 32  # the largest ones
_SMALL = 0.25  # greatest radius of a lamp in units of its distance from the nearest caster
_SMALL_SUN = 0.004  # 1 - cos of the greatest half angle: 5 degrees
_LEAST_INDEX = 1.01  # glass with an index nearer to 1 hardly refracts
_FLAGS = (
    rows.TEXTURED
    | rows.NORMAL_MAPPED
    | rows.TRANSPARENT
    | rows.THIN
    | rows.DISPERSIVE
    | rows.SCATTERS_WITHIN
    | rows.LAMP
    | rows.UNSEEN
    | rows.SHADELESS
    | rows.FACING
)  # fmt: skip -- materials with one of these are neither casters nor lamps


class CausticTables(NamedTuple):
    """The casters C and lamps n of a scene. All arrays are read-only.

    A closed caster encloses a volume: light from outside enters and leaves it, through two interfaces. The first primitive and
    the number of primitives of a caster are those of a mesh's triangles, or one sphere.
    """

    caster: npt.NDArray[np.int32]  # (C, 4): first primitive, number of primitives, 1 if closed, 1 if it transmits
    bound: npt.NDArray[np.float32]  # (C, 4): centre and radius of a bounding sphere
    part_caster: npt.NDArray[np.int32]  # (P,): the caster of a part's triangles, -1 for none
    sphere_caster: npt.NDArray[np.int32]  # (S,): likewise
    lamp: npt.NDArray[np.int32]  # (n,): primitives, as in `light_primitive`, but both triangles of a parallelogram
    lamp_cdf: npt.NDArray[np.float32]  # (n + 1,): by power
    is_covered: npt.NDArray[np.int32]  # (L,): 1 for a light that is among the lamps
    # From photons (renderer/guiding/caustic_photons.py), and empty while these are followed.
    brightness: npt.NDArray[
        np.float32
    ]  # (buckets,): relative irradiance of the buckets of renderer/kernel/manifold/brightness.py
    brightness_scale: npt.NDArray[np.float32]  # (1,): cubes per unit length of the grid's finest level
    seed: npt.NDArray[np.int32]  # (buckets, SEEDS): photons of a bucket as rows of `seed_place`; -1 for none
    seed_place: npt.NDArray[np.float32]  # (n, 3): where these have left their casters
    # Chains of more interfaces (renderer/kernel/manifold/walk.py) that are sampled by walks, likewise from photons.
    long_kind: npt.NDArray[np.int32]  # (K, 2): the first caster from the receiver, and the kind
    long_cdf: npt.NDArray[np.float32]  # (K + 1,): by flux; one number if there are none
    is_long: npt.NDArray[np.int32]  # (C, CODES): 1 for the sequences of interfaces among them, by their first caster
    long_light: npt.NDArray[np.float32]  # (buckets, LONG_LIGHT_COLUMNS), as in renderer/kernel/manifold/brightness.py


# The arrays of a scene that its tables depend on. Frames of a shot may share some of them and differ in others.
_USED_ARRAYS = (
    *("position", "triangle", "part", "color", "triangle_light", "sphere", "sphere_material", "sphere_light", "material"),
    *("material_kind", "material_flags", "medium", "light_primitive", "punctual", "punctual_kind", "emission_frame", "bounds"),
    *("key_position", "key_sphere", "key_punctual"),
)
_MOST_KEPT = 4
_kept: list[tuple[tuple[weakref.ref[Any], ...], CausticTables | None]] = []


def with_caustics(scene: CompiledScene) -> CompiledScene:
    """Returns the scene with its CausticTables, or unchanged if it has no caster, no small lamp, media, or motion.

    The tables of the last scenes are kept, since each batch of a frame needs them again.
    """
    arrays = [getattr(scene, name) for name in _USED_ARRAYS]
    for references, tables in list(_kept):
        if all(each() is array for each, array in zip(references, arrays, strict=True)):
            return scene._replace(caustics=tables)
    made = caustic_tables(scene)
    alive = [entry for entry in _kept if all(each() is not None for each in entry[0])]
    _kept[:] = [*alive[1 - _MOST_KEPT :], (tuple(map(weakref.ref, arrays)), made)]
    return scene._replace(caustics=made)


def example_tables() -> CausticTables:
    """Returns empty tables, with the types for which kernels are compiled."""
    return _read_only_tables([], np.zeros((0, 4)), np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(1), np.zeros(0))


def _read_only_tables(*arrays: object) -> CausticTables:
    """Returns tables without brightness and long chains."""
    casters = len(np.asarray(arrays[0]).reshape(-1, 4))
    shapes: list[Any] = [(0, 2), 1, (0, SEEDS), (0, 3), (0, 2), 1, (casters, CODES), (0, LONG_LIGHT_COLUMNS)]
    unknown = [np.zeros(shape) for shape in shapes]
    kinds: list[Any] = [np.int32, np.float32, np.int32, np.int32, np.int32, np.float32, np.int32, np.float32, np.float32]
    kinds += [np.int32, np.float32, np.int32, np.float32, np.int32, np.float32]
    made: list[Any] = [np.array(array, kind) for array, kind in zip((*arrays, *unknown), kinds, strict=True)]
    made[0] = made[0].reshape(-1, 4)
    for array in made:
        array.flags.writeable = False
    return CausticTables(*made)


class _Parts(NamedTuple):
    """The parts of a scene that lie in the world, not in instances: their numbers, and first and end triangles."""

    number: npt.NDArray[np.int64]
    first: npt.NDArray[np.int64]
    end: npt.NDArray[np.int64]


def _world_parts(scene: CompiledScene) -> _Parts:
    first = np.searchsorted(scene.triangle[:, 3], np.arange(len(scene.part) + 1))
    number = np.flatnonzero((scene.part[:, rows.PART_OBJECT] >= 0) & (np.diff(first) > 0))
    return _Parts(number, first[number], first[number + 1])


def caustic_tables(scene: CompiledScene) -> CausticTables | None:
    """Returns the tables of a scene; None if it has no caster, no small lamp, scattering media, motion, light links,
    or visibility by kind of ray."""
    if len(scene.key_position) or len(scene.key_sphere) or len(scene.key_punctual) or len(scene.bvh.motion):
        return None
    if len(scene.medium) > 1 or scene.medium.any() or len(scene.object_links) or len(scene.bvh.ray_roots) > 2:
        return None
    parts = _world_parts(scene)
    found = _casters(scene, parts)
    if not found:
        return None
    found = sorted(found, key=lambda each: -each.radius)[:MOST_CASTERS]
    part_caster = np.full(len(scene.part), -1)
    sphere_caster = np.full(len(scene.sphere), -1)
    for number, each in enumerate(found):
        (part_caster if each.is_mesh else sphere_caster)[each.number] = number
    lamps, powers, is_covered = _lamps(scene, parts, found)
    if not len(lamps):
        return None
    caster = [(each.first, each.count, each.closed, each.transmits) for each in found]
    bound = [(*each.center, each.radius) for each in found]
    chance = 0.99 * powers / powers.sum() + 0.01 / len(powers)
    return _read_only_tables(caster, bound, part_caster, sphere_caster, lamps, cumulative(chance), is_covered)


class _Caster(NamedTuple):
    is_mesh: bool
    number: int  # of the part, or of the sphere
    first: int
    count: int  # type: ignore[assignment]  # hides tuple.count, which is not used
    closed: bool
    transmits: bool
    low: np.ndarray
    high: np.ndarray
    center: np.ndarray
    radius: float


def _is_plain(scene: CompiledScene) -> np.ndarray:
    return (scene.material_flags & _FLAGS) == 0


def _casters(scene: CompiledScene, parts: _Parts) -> list[_Caster]:
    kind = scene.material_kind
    is_dark = ~scene.material[:, rows.EMISSION : rows.EMISSION + 3].any(axis=1)
    index = scene.material[:, rows.IOR]
    refracts = (kind == rows.GLASS) & (np.maximum(index, 1 / np.maximum(index, 1e-6)) >= _LEAST_INDEX)
    casts = _is_plain(scene) & is_dark & (refracts | (kind == rows.MIRROR))
    found = []
    for part, first, end in zip(*parts, strict=True):
        material = scene.part[part, rows.PART_MATERIAL]
        if not casts[material]:
            continue
        corner = scene.triangle[first:end, :3]
        if len(scene.color) and (scene.color[corner.reshape(-1)] != 1).any():
            continue
        points = scene.position[corner.reshape(-1)].astype(np.float64)
        low, high = points.min(axis=0), points.max(axis=0)
        center = (low + high) / 2
        radius = float(np.linalg.norm(points - center, axis=1).max())
        closed = bool(refracts[material]) and _is_closed(points)
        found.append(_Caster(True, part, first, end - first, closed, bool(refracts[material]), low, high, center, radius))
    for number, ball in enumerate(scene.sphere):
        material = scene.sphere_material[number]
        if casts[material]:
            center, radius = ball[:3].astype(np.float64), float(ball[3])
            refracting, low, high = bool(refracts[material]), center - radius, center + radius
            place = len(scene.triangle) + number
            found.append(_Caster(False, number, place, 1, refracting, refracting, low, high, center, radius))
    return found


def _is_closed(points: np.ndarray) -> bool:
    """Returns True if triangles enclose a volume: if each edge belongs to two of them, one in each direction.

    points: (3 n, 3) corners, triangle by triangle; equal positions are one vertex.
    """
    view = np.ascontiguousarray(points + 0.0).view(np.dtype((np.void, points.dtype.itemsize * 3))).reshape(-1)
    vertex = np.unique(view, return_inverse=True)[1].reshape(-1, 3).astype(np.int64)
    begin, end = vertex.reshape(-1), np.roll(vertex, -1, axis=1).reshape(-1)
    count = vertex.max() + 1
    forward, backward = np.sort(begin * count + end), np.sort(end * count + begin)
    return bool((forward == backward).all() and (np.diff(forward) > 0).all())


def _distance_to_casters(points: np.ndarray, casters: list[_Caster]) -> float:
    """Returns the least distance of points, (n, 3), from the casters' bounding boxes."""
    outside = [np.maximum(np.maximum(each.low - points, points - each.high), 0) for each in casters]
    return float(min(np.linalg.norm(each, axis=1).min() for each in outside))


def _is_small(low: np.ndarray, high: np.ndarray, casters: list[_Caster]) -> bool:
    radius = float(np.linalg.norm(high - low)) / 2
    return radius <= _SMALL * max(_distance_to_casters(((low + high) / 2)[None], casters) - radius, 0)


def _lamps(
    scene: CompiledScene, parts: _Parts, casters: list[_Caster]
) -> tuple[npt.NDArray[np.int64], np.ndarray, npt.NDArray[np.int64]]:
    """Returns (primitives of the small lamps, their powers as luminance, (L,) 1 for each light among them)."""
    radiance = scene.material[:, rows.EMISSION : rows.EMISSION + 3].astype(np.float64) @ REC_709
    sides = 1 + scene.material[:, rows.DOUBLE_SIDED]
    emits = _is_plain(scene) & (radiance > 0)
    primitives: list[npt.NDArray[np.int64]] = []
    powers: list[np.ndarray] = []
    covered = np.zeros(len(scene.light_primitive), np.int64)
    bodies = len(scene.triangle)
    if len(scene.triangle_light):
        for part, first, end in zip(*parts, strict=True):
            material = scene.part[part, rows.PART_MATERIAL]
            corners = scene.position[scene.triangle[first:end, :3]].astype(np.float64)
            flat = corners.reshape(-1, 3)
            if not emits[material] or not _is_small(flat.min(axis=0), flat.max(axis=0), casters):
                continue
            listed = np.flatnonzero(scene.triangle_light[first:end] >= 0)
            cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[listed]
            primitives.append(first + listed)
            powers.append(np.linalg.norm(cross, axis=1) / 2 * np.pi * radiance[material] * sides[material])
            covered[scene.triangle_light[first + listed]] = 1
    for number, ball in enumerate(scene.sphere):
        material, light = scene.sphere_material[number], scene.sphere_light[number]
        center, radius = ball[:3].astype(np.float64), float(ball[3])
        if light >= 0 and emits[material] and _is_small(center - radius, center + radius, casters):
            primitives.append(np.array([bodies + number]))
            powers.append(np.array([4 * np.pi**2 * radius**2 * radiance[material]]))
            covered[light] = 1
    bodies += len(scene.sphere)
    size = float(np.linalg.norm(scene.bounds[1] - scene.bounds[0])) / 2
    for light, primitive in enumerate(scene.light_primitive.astype(np.int64)):
        number = primitive - bodies
        if number < 0 or (len(scene.emission_frame) and scene.emission_frame[number, 3] >= 0):
            continue
        kind, told = scene.punctual_kind[number], scene.punctual[number].astype(np.float64)
        value, extent = float(told[6:9] @ REC_709), float(told[9])
        if kind in (DIRECTIONAL, SUN, SUN_UNSEEN):
            is_small = extent <= _SMALL_SUN
            power = np.pi * size**2 * value * (2 * np.pi * extent if extent > 0 else 1)
        else:
            is_small = extent == 0 or (extent > 0 and _is_small(told[:3] - extent, told[:3] + extent, casters))
            power = 4 * np.pi * value * (np.pi * extent**2 if extent > 0 else 1)
        if is_small and power > 0:
            primitives.append(np.array([primitive]))
            powers.append(np.array([power]))
            covered[light] = 1
    if not primitives:
        return np.zeros(0, np.int64), np.zeros(0), covered
    return np.concatenate(primitives), np.concatenate(powers), covered
