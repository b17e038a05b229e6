"""Finds out by photons where a scene's caustics are: a function of the compiled scene alone.

Manifold sampling then leaves out most walks where hardly any light would be found, starts the others towards places that photons
have left, and takes over those long chains that photons have found: all other long chains stay with BSDF sampling.
"""

from __future__ import annotations

import threading
import weakref
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.arrays.scene import CompiledScene, flat
from renderer.bvh.traverse import new_stack
from renderer.kernel.manifold.brightness import BUCKETS, LEVELS, LONG_BUCKETS, LONG_KEY, LONG_LIGHT_COLUMNS, REFINEMENT, SEEDS
from renderer.kernel.manifold.photons import (
    ALL,
    CASTER,
    FLUX,
    INTERFACE,
    KIND,
    LONG_COLUMNS,
    PHOTON_COLUMNS,
    REFLECTS,
    follow_caustic_photons,
    follow_long_photons,
    photon_buckets,
)
from renderer.kernel.manifold.walk import CODES, LONG
from renderer.scene.caustics import CausticTables
from renderer.scene.lights import cumulative

__all__ = [
    "PHOTONS",
    "brightness_of",
    "greatest_irradiance",
    "seeds_of",
    "warm_up_photons",
    "with_long_chains",
    "with_photons",
]

PHOTONS, LONG_PHOTONS = 1 << 16, 1 << 16
_MOST_LONG = 64  # long kinds that are sampled by walks: those that bring most light
_LEAST_LONG = 4  # photons of such a kind
_MOST_SHARE = 1.5  # greatest ratio of rates of walks for long and for short chains, over that of their light
_UNIFORM = 0.1  # part of the probability of a long kind that does not depend on its light
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
        tables = _with_brightness(prepared, PHOTONS, LONG_PHOTONS)
        _kept[:] = [*_kept[1 - _MOST_KEPT :], ([*map(weakref.ref, arrays)], tables)]
    return prepared._replace(caustics=tables)


def warm_up_photons(scene: CompiledScene) -> None:
    """Compiles or loads the kernels of photons. scene: an empty one, as `with_photons` expects it."""
    _with_brightness(scene, 0, 0)


def _with_brightness(scene: CompiledScene, count: int, long_count: int) -> CausticTables:
    tables: CausticTables = scene.caustics
    photons = np.zeros((count, PHOTON_COLUMNS), np.float32)
    photons = photons[: follow_caustic_photons(scene, new_stack(), count, photons)]
    long = np.zeros((long_count, LONG_COLUMNS), np.float32)
    long = long[: follow_long_photons(scene, new_stack(), long_count, long)]
    if count and not len(photons):  # which gives no reason to leave out walks
        return tables
    radius = tables.bound[:, 3].astype(np.float64)
    size = _COARSEST * float(radius.max(initial=0)) or 1.0
    scale = np.float32(REFINEMENT ** (LEVELS - 1) / size)
    buckets = np.zeros((LEVELS, len(photons)), np.int32)
    photon_buckets(photons, scale, buckets)
    unit = greatest_irradiance(photons, radius)
    made = tables._replace(
        brightness=brightness_of(photons, buckets, size, unit),
        brightness_scale=np.array([scale], np.float32),
        seed=seeds_of(buckets),
        seed_place=np.ascontiguousarray(photons[:, INTERFACE : INTERFACE + 3]),
    )
    made = with_long_chains(made, long, _places(long, scale), size, unit * long_count / max(count, 1))
    made = with_long_share(made, photons, _places(photons, scale), size, unit)
    for array in made:
        array.flags.writeable = False
    return made


def seeds_of(buckets: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """Returns (BUCKETS, SEEDS): photons of each bucket, evenly chosen from its list; -1 where too few have arrived.

    buckets: (LEVELS, n) of the photons. A photon may be listed several times.
    """
    seeds = np.full((BUCKETS, SEEDS), -1, np.int32)
    for level, bucket in enumerate(buckets):
        order = np.argsort(bucket, kind="stable")
        used, first, count = np.unique(bucket[order], return_index=True, return_counts=True)
        least = 1 if level == LEVELS - 1 else _LEAST_PHOTONS
        used, first, count = (each[count >= least] for each in (used, first, count))
        chosen = first[:, None] + np.arange(SEEDS) * count[:, None] // SEEDS
        seeds[used] = order[chosen] if len(order) else -1
    return seeds


def _places(photons: F32, scale: np.float32) -> npt.NDArray[np.int32]:
    """Returns the buckets of photons, (LEVELS, n), in the grid of long chains."""
    keyed, buckets = photons[:, : CASTER + 1].copy(), np.zeros((LEVELS, len(photons)), np.int32)
    keyed[:, CASTER] = LONG_KEY
    photon_buckets(keyed, scale, buckets)
    return buckets & (LONG_BUCKETS - 1)


def greatest_irradiance(photons: F32, radius: npt.NDArray[np.float64]) -> float:
    """Returns the greatest irradiance at a caster's bounding sphere times the number of photons sent.

    photons: (n, PHOTON_COLUMNS). radius: of the casters.
    """
    caster = photons[:, CASTER].astype(np.int64)
    sent = np.bincount(caster, photons[:, ALL], len(radius)) / np.maximum(np.pi * radius * radius, 1e-30)
    return max(float(sent.max(initial=0)), 1e-30)


def with_long_chains(
    tables: CausticTables, photons: F32, buckets: npt.NDArray[np.int32], size: float, unit: float
) -> CausticTables:
    """Returns tables with the long kinds of which enough photons, (n, LONG_COLUMNS), have arrived.

    buckets: (LEVELS, n) of the photons. size: of the coarsest cubes. unit: the irradiance that counts as 1.
    """
    pairs = photons[:, CASTER].astype(np.int64) * (2 * CODES) + photons[:, KIND].astype(np.int64)
    kinds, own, counts = np.unique(pairs, return_inverse=True, return_counts=True)
    flux = np.bincount(own, photons[:, FLUX], len(kinds))
    kept = np.flatnonzero(counts >= _LEAST_LONG)
    kept = np.sort(kept[np.argsort(-flux[kept], kind="stable")[:_MOST_LONG]])
    if not len(kept):
        return tables
    number = np.full(len(kinds), -1)
    number[kept] = np.arange(len(kept))
    is_kept = number[own] >= 0
    photons, buckets, own = photons[is_kept], buckets[:, is_kept], number[own][is_kept]
    long_kind = np.stack([kinds[kept] // (2 * CODES), kinds[kept] % (2 * CODES)], 1).astype(np.int32)
    is_long = np.zeros_like(tables.is_long)
    is_long[long_kind[:, 0], long_kind[:, 1] - int(LONG)] = 1
    chance = (1 - _UNIFORM) * flux[kept] / np.cumsum(flux[kept])[-1] + _UNIFORM / len(kept)
    found = np.zeros((LONG_BUCKETS, LONG_LIGHT_COLUMNS), np.float32)
    brightest = np.argsort(-photons[:, FLUX], kind="stable")
    for level, bucket in enumerate(buckets):
        bucket = bucket.astype(np.int64)
        side = size * REFINEMENT ** (level + 1 - LEVELS)
        irradiance = np.bincount(bucket, photons[:, FLUX], LONG_BUCKETS) / (side * side * unit)
        least = 1 if level == LEVELS - 1 else _LEAST_PHOTONS
        enough = np.bincount(bucket, minlength=LONG_BUCKETS) >= least
        by_kind, place = np.unique(bucket * len(kept) + own, return_inverse=True)
        strength = np.bincount(place, photons[:, FLUX])
        order = np.argsort(-strength, kind="stable")
        where, first = np.unique(by_kind[order] // len(kept), return_index=True)
        strongest = np.full(LONG_BUCKETS, -1)
        strongest[where] = by_kind[order[first]] % len(kept)
        own_bucket, index = np.unique(np.where(own == strongest[bucket], bucket, -1)[brightest], return_index=True)
        chosen = brightest[index][own_bucket >= 0]
        is_new = enough[bucket[chosen]] & (irradiance[bucket[chosen]] > found[bucket[chosen], 0])
        chosen = chosen[is_new]
        found[bucket[chosen], 0] = irradiance[bucket[chosen]]
        found[bucket[chosen], 2] = own[chosen]
        found[bucket[chosen], 3:] = photons[chosen, INTERFACE : INTERFACE + 3]
    return tables._replace(
        long_kind=long_kind, long_cdf=np.array(cumulative(chance), np.float32), is_long=is_long, long_light=found
    )


def with_long_share(
    tables: CausticTables, photons: F32, buckets: npt.NDArray[np.int32], size: float, unit: float
) -> CausticTables:
    """Returns tables with the greatest rate of walks for long chains in each bucket, since these take the place of others.

    photons, buckets, size, unit: as for `brightness_of`, in the grid of long chains.
    """
    light = tables.long_light.copy()
    if not len(light):
        return tables
    short = np.zeros(LONG_BUCKETS)
    for level, bucket in enumerate(buckets):
        side = size * REFINEMENT ** (level + 1 - LEVELS)
        short = np.maximum(short, np.bincount(bucket, photons[:, FLUX], LONG_BUCKETS) / (side * side * unit))
    light[:, 1] = np.minimum(_MOST_SHARE * light[:, 0] / np.maximum(short, 1e-30), 1)
    return tables._replace(long_light=light)


def brightness_of(photons: F32, buckets: npt.NDArray[np.int32], size: float, unit: float) -> F32:
    """Returns (BUCKETS, 2): transmitted and reflected irradiance.

    photons: (n, PHOTON_COLUMNS). buckets: (LEVELS, n) of them. size: of the coarsest cubes. unit: the irradiance that counts
    as 1.
    """
    kind = photons[:, REFLECTS].astype(np.int64)
    found = np.zeros(2 * BUCKETS)
    for level, bucket in enumerate(buckets):
        own = 2 * bucket.astype(np.int64) + kind
        count, flux = np.bincount(own, minlength=2 * BUCKETS), np.bincount(own, photons[:, FLUX], 2 * BUCKETS)
        least = 1 if level == LEVELS - 1 else _LEAST_PHOTONS
        side = size * REFINEMENT ** (level + 1 - LEVELS)
        found = np.maximum(found, np.where(count >= least, flux / (side * side), 0.0))
    return (found / unit).astype(np.float32).reshape(BUCKETS, 2)
