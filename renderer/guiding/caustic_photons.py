"""Finds out by photons where a scene's caustics are: a function of the compiled scene alone.

Manifold sampling then leaves out most walks where hardly any light would be found.
"""

from __future__ import annotations

import threading
import weakref
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.arrays.scene import CompiledScene, flat
from renderer.bvh.traverse import new_stack
from renderer.kernel.manifold.brightness import BUCKETS, LEVELS, REFINEMENT
from renderer.kernel.manifold.photons import (
    ALL,
    CASTER,
    FLUX,
    PHOTON_COLUMNS,
    REFLECTS,
    follow_caustic_photons,
    photon_buckets,
)
from renderer.scene.caustics import CausticTables

__all__ = ["PHOTONS", "brightness_of", "warm_up_photons", "with_photons"]

PHOTONS = 1 << 16
_COARSEST = 0.5  # size of the grid's largest cubes, in radii of the largest caster
_LEAST_PHOTONS = 6  # of one kind in a cube, except of the coarsest level
_MOST_KEPT = 4

F32 = npt.NDArray[np.float32]
_kept: list[tuple[list[weakref.ref[Any]], CausticTables]] = []
_lock = threading.Lock()


def with_photons(stored: CompiledScene, prepared: CompiledScene) -> CompiledScene:
    """Returns the scene `prepared`, whose `caustics` have no brightness yet, with that.

    stored: the scene from which `prepared` was made. The tables of the last scenes are kept, since each batch needs them.
    """
    if prepared.caustics is None:
        return prepared
    arrays = list(flat(stored).values())
    with _lock:
        for references, tables in _kept:
            if all(each() is array for each, array in zip(references, arrays, strict=True)):
                return prepared._replace(caustics=tables)
        tables = _with_brightness(prepared, PHOTONS)
        _kept[:] = [*_kept[1 - _MOST_KEPT :], ([*map(weakref.ref, arrays)], tables)]
    return prepared._replace(caustics=tables)


def warm_up_photons(scene: CompiledScene) -> None:
    """Compiles or loads the kernels of photons. scene: an empty one, as `with_photons` expects it."""
    _with_brightness(scene, 0)


def _with_brightness(scene: CompiledScene, count: int) -> CausticTables:
    tables: CausticTables = scene.caustics
    photons = np.zeros((count, PHOTON_COLUMNS), np.float32)
    photons = photons[: follow_caustic_photons(scene, new_stack(), count, photons)]
    if count and not len(photons):  # which gives no reason to leave out walks
        return tables
    radius = tables.bound[:, 3].astype(np.float64)
    size = _COARSEST * float(radius.max(initial=0)) or 1.0
    scale = np.float32(REFINEMENT ** (LEVELS - 1) / size)
    buckets = np.zeros((LEVELS, len(photons)), np.int32)
    photon_buckets(photons, scale, buckets)
    made = tables._replace(
        brightness=brightness_of(photons, buckets, size, radius), brightness_scale=np.array([scale], np.float32)
    )
    for array in made:
        array.flags.writeable = False
    return made


def brightness_of(photons: F32, buckets: npt.NDArray[np.int32], size: float, radius: npt.NDArray[np.float64]) -> F32:
    """Returns (BUCKETS, 2): transmitted and reflected irradiance, over the greatest at a caster's bounding sphere.

    photons: (n, PHOTON_COLUMNS). buckets: (LEVELS, n) of them. size: of the coarsest cubes. radius: of the casters.
    """
    caster = photons[:, CASTER].astype(np.int64)
    sent = np.bincount(caster, photons[:, ALL], len(radius)) / np.maximum(np.pi * radius * radius, 1e-30)
    kind = photons[:, REFLECTS].astype(np.int64)
    found = np.zeros(2 * BUCKETS)
    for level, bucket in enumerate(buckets):
        own = 2 * bucket.astype(np.int64) + kind
        count, flux = np.bincount(own, minlength=2 * BUCKETS), np.bincount(own, photons[:, FLUX], 2 * BUCKETS)
        least = 1 if level == LEVELS - 1 else _LEAST_PHOTONS
        side = size * REFINEMENT ** (level + 1 - LEVELS)
        found = np.maximum(found, np.where(count >= least, flux / (side * side), 0.0))
    return (found / max(float(sent.max(initial=0)), 1e-30)).astype(np.float32).reshape(BUCKETS, 2)
