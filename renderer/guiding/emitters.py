"""Lists the emitters of photons with their power: area lights, point lights, spots (as points), and distant lights.

The environment emits none: most of its photons would miss what an image shows, and camera paths find its light.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays import rows
from renderer.arrays.light_rows import CORNER, CORNER_ERROR, EDGES
from renderer.arrays.scene import CompiledScene
from renderer.kernel.guiding.photons import (
    DISTANT,
    EMITTER_COLUMNS,
    EMITTER_EDGES,
    EMITTER_KIND,
    EMITTER_NORMAL,
    EMITTER_PLACE,
    EMITTER_SIDES,
    PARALLELOGRAM,
    SPHERE,
    TRIANGLE,
)
from renderer.kernel.light.punctual import DIRECTIONAL, SUN
from renderer.luminance import luminance

__all__ = ["Emitters", "emitters_of"]

F64 = npt.NDArray[np.float64]


class Emitters(NamedTuple):
    """The emitters of a scene, from which photons start."""

    table: npt.NDArray[np.float32]  # (n, EMITTER_COLUMNS)
    cdf: npt.NDArray[np.float64]  # (n,), of the choice by power; ends with 1
    power: float  # sum of the luminous powers


def emitters_of(scene: CompiledScene) -> Emitters:
    """Returns the emitters of a scene.

    Emission textures, emission maps and motion are ignored, since they affect the quality of a guide alone.
    """
    listed = [_emitter(scene, light) for light in range(len(scene.light_primitive))]
    listed = [each for each in listed if each[1] > 0]
    table = np.array([row for row, _ in listed], np.float32).reshape(-1, EMITTER_COLUMNS)
    sums = np.cumsum([power for _, power in listed])
    return Emitters(table, sums / sums[-1] if len(sums) else sums, float(sums[-1]) if len(sums) else 0.0)


def _emitter(scene: CompiledScene, light: int) -> tuple[F64, float]:
    """Returns (a light's row of the table, its power); the power is 0 if it emits nothing."""
    row = np.zeros(EMITTER_COLUMNS)
    primitive, triangles, spheres = int(scene.light_primitive[light]), len(scene.triangle), len(scene.sphere)
    if primitive >= triangles + spheres:
        return _punctual(scene, primitive - triangles - spheres, row)
    if primitive < triangles:
        *corners, part = scene.triangle[primitive]
        material = int(scene.part[part, rows.PART_MATERIAL])
        a, b, c = scene.position[corners].astype(np.float64)
        row[EMITTER_KIND], edges = TRIANGLE, np.stack((b - a, c - a))
        if len(scene.light_parallelogram) and scene.light_parallelogram[light, CORNER_ERROR] > 0:
            own = scene.light_parallelogram[light].astype(np.float64)
            row[EMITTER_KIND], a, edges = PARALLELOGRAM, own[CORNER : CORNER + 3], own[EDGES : EDGES + 6].reshape(2, 3)
        normal = np.cross(*edges)
        twice = math.sqrt(float((normal * normal).cumsum()[-1]))
        if not twice > 0:
            return row, 0.0
        row[EMITTER_PLACE : EMITTER_PLACE + 3], row[EMITTER_EDGES : EMITTER_EDGES + 6] = a, edges.reshape(-1)
        row[EMITTER_NORMAL : EMITTER_NORMAL + 3] = normal / twice
        area = twice if row[EMITTER_KIND] == PARALLELOGRAM else twice / 2
        row[EMITTER_SIDES] = 2 if scene.material[material, rows.DOUBLE_SIDED] else 1
    else:
        *center, radius = scene.sphere[primitive - triangles].astype(np.float64)
        material = int(scene.sphere_material[primitive - triangles])
        row[EMITTER_KIND], row[EMITTER_PLACE : EMITTER_PLACE + 3], row[EMITTER_EDGES] = SPHERE, center, radius
        area, row[EMITTER_SIDES] = 4 * math.pi * radius * radius, 1
    emission = scene.material[material, rows.EMISSION : rows.EMISSION + 3].astype(np.float64)
    return row, float(luminance(emission)) * math.pi * area * row[EMITTER_SIDES]


def _punctual(scene: CompiledScene, number: int, row: F64) -> tuple[F64, float]:
    """Returns the same for a punctual light."""
    own = scene.punctual[number].astype(np.float64)
    value, extent = float(luminance(own[6:9])), float(own[9])
    kind = scene.punctual_kind[number]
    if kind != DIRECTIONAL and kind < SUN:
        row[EMITTER_KIND], row[EMITTER_PLACE : EMITTER_PLACE + 3] = SPHERE, own[:3]
        row[EMITTER_EDGES] = extent
        return row, value * 4 * math.pi * (math.pi * extent * extent if extent > 0 else 1.0)
    low, high = scene.bounds.astype(np.float64)
    radius = 0.5 * math.sqrt(float(((high - low) ** 2).cumsum()[-1]))
    row[EMITTER_KIND], row[EMITTER_NORMAL : EMITTER_NORMAL + 3] = DISTANT, own[:3]
    row[EMITTER_PLACE : EMITTER_PLACE + 3] = (low + high) / 2 + 1.01 * radius * own[:3]
    row[EMITTER_EDGES] = radius
    return row, value * (2 * math.pi * extent if extent > 0 else 1.0) * math.pi * radius * radius
