"""Lists the small lamps towards which distances in scattering media are sampled (renderer/kernel/medium/equiangular.py)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays import rows
from renderer.arrays.light_rows import PIVOT_CDF, PIVOT_CENTER, PIVOT_COLUMNS, PIVOT_RADIUS
from renderer.arrays.scene import CompiledScene
from renderer.kernel.light.punctual import DIRECTIONAL, SUN, SUN_UNSEEN
from renderer.luminance import REC_709
from renderer.scene.description import F32

__all__ = ["MAX_PIVOTS", "list_pivots"]

MAX_PIVOTS = 32  # the strongest; a flight chooses one of them
_SMALL = 0.1  # greatest radius of a lamp, in units of the scene's radius or of the mean free path, whichever is longer
_LEAST_SHARE = 0.01  # of the lamps' power together, to be listed

F64 = npt.NDArray[np.float64]


class _Lamps(NamedTuple):
    """Spheres about lamps, and the lamps' powers as luminance."""

    center: F64  # (n, 3)
    radius: F64  # (n,)
    power: F64  # (n,)


def list_pivots(scene: CompiledScene) -> F32:
    """Returns the scene's small lamps, (p, PIVOT_COLUMNS) f32, the strongest first; no rows if no medium scatters light.

    These are points, spots, spheres and meshes that emit. Moving lamps are listed where they are as the shutter opens: any point
    gives unbiased pictures.
    """
    table = np.zeros((0, PIVOT_COLUMNS), np.float32)
    if not scene.medium[:, rows.SIGMA_S : rows.SIGMA_S + 3].any():
        return table
    found = _Lamps(*map(np.concatenate, zip(_points(scene), _spheres(scene), _meshes(scene), strict=True)))
    chosen = np.flatnonzero((found.radius <= _SMALL * _scale(scene)) & (found.power > 0))
    if not len(chosen):
        return table
    order = chosen[np.argsort(-found.power[chosen], kind="stable")][:MAX_PIVOTS]
    order = order[found.power[order] >= _LEAST_SHARE * found.power[chosen].sum()]
    table = np.zeros((len(order), PIVOT_COLUMNS), np.float32)
    table[:, PIVOT_CENTER : PIVOT_CENTER + 3] = found.center[order]
    table[:, PIVOT_RADIUS] = found.radius[order]
    table[:, PIVOT_CDF] = np.cumsum(found.power[order]) / found.power[order].sum()
    table[-1:, PIVOT_CDF] = 1.0
    return table


def _scale(scene: CompiledScene) -> float:
    """Returns the scene's radius, or the mean free path in the clearest medium that scatters if that is longer."""
    sigma_s = scene.medium[:, rows.SIGMA_S : rows.SIGMA_S + 3].astype(np.float64)
    sigma_t = sigma_s + scene.medium[:, rows.SIGMA_A : rows.SIGMA_A + 3]
    free_path = 1 / float(sigma_t[sigma_s.any(axis=1)].mean(axis=1).min())
    return max(float(np.linalg.norm(scene.bounds[1].astype(np.float64) - scene.bounds[0])) / 2, free_path)


def _points(scene: CompiledScene) -> _Lamps:
    is_near = ~np.isin(scene.punctual_kind, (DIRECTIONAL, SUN, SUN_UNSEEN))
    row = scene.punctual[is_near].astype(np.float64)
    value, extent = row[:, 6:9] @ REC_709, np.abs(row[:, 9])
    return _Lamps(row[:, :3], extent, 4 * np.pi * value * np.where(extent > 0, np.pi * extent**2, 1.0))


def _radiance(scene: CompiledScene) -> F64:
    emission = scene.material[:, rows.EMISSION : rows.EMISSION + 3].astype(np.float64)
    return np.asarray(emission @ REC_709)


def _spheres(scene: CompiledScene) -> _Lamps:
    ball = scene.sphere[scene.sphere_light >= 0].astype(np.float64)
    radiance = _radiance(scene)[scene.sphere_material[scene.sphere_light >= 0]]
    return _Lamps(ball[:, :3], ball[:, 3], 4 * np.pi**2 * ball[:, 3] ** 2 * radiance)


def _meshes(scene: CompiledScene) -> _Lamps:
    """Returns the emissive meshes of the world, one lamp each."""
    first = np.searchsorted(scene.triangle[:, 3], np.arange(len(scene.part) + 1))
    shines = (scene.part[:, rows.PART_SHINES] != 0) & (scene.part[:, rows.PART_OBJECT] >= 0) & (np.diff(first) > 0)
    radiance, sides = _radiance(scene), 1 + scene.material[:, rows.DOUBLE_SIDED]
    center, radius, power = [], [], []
    for part in np.flatnonzero(shines):
        corner = scene.position[scene.triangle[first[part] : first[part + 1], :3]].astype(np.float64)
        low, high = corner.min(axis=(0, 1)), corner.max(axis=(0, 1))
        area = float(np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1).sum()) / 2
        material = scene.part[part, rows.PART_MATERIAL]
        center.append((low + high) / 2)
        radius.append(float(np.linalg.norm(high - low)) / 2)
        power.append(float(np.pi * area * radiance[material] * sides[material]))
    return _Lamps(np.array(center).reshape(-1, 3), np.array(radius, np.float64), np.array(power, np.float64))
