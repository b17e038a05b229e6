"""Hashed grid of the irradiance by caster that photons have measured, and the probability of beginning a walk.

The grid has levels of cubes. A bucket holds the transmitted and the reflected irradiance in one cube by one caster, relative to
that of the casters themselves; it is found by a hash of cube and caster. It is 0 where too few photons have arrived.

Buckets also list a few photons, as starts for walks: from near a solution, Newton's method is likely to find it.

Light of all long chains together has a grid of its own. Its buckets also hold which long chain is the strongest there, and a
point where that leaves its caster, as a start for walks.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.fetch import row
from renderer.kernel.light.environment import sample_cdf
from renderer.kernel.manifold.walk import NO_CHAIN
from renderer.kernel.polynomial import floor

__all__ = [
    "BUCKETS",
    "LEVELS",
    "LONG_BUCKETS",
    "LONG_KEY",
    "LONG_LIGHT_COLUMNS",
    "REFINEMENT",
    "SEEDS",
    "ChosenChain",
    "bucket_of",
    "choose_chain",
    "long_bucket",
    "sampling_rates",
    "seed_bucket",
]

LEVELS = 5
REFINEMENT = 3.0  # ratio of the sizes of a level's cubes to those of the next finer one
BUCKETS, LONG_BUCKETS = 1 << 18, 1 << 16
SEEDS = 8  # photons listed in a bucket
LONG_KEY = 64  # in place of a caster's number
LONG_LIGHT_COLUMNS = 6  # of a bucket: irradiance, greatest sampling rate, number of the strongest chain, and a point
_MASK, _LONG_MASK = BUCKETS - 1, LONG_BUCKETS - 1
_X, _Y, _Z, _KEY = 73856093, 19349663, 83492791, 40503  # Teschner et al., "Optimized Spatial Hashing" (2003)
_SHIFT = 15
_FINER = np.float32(1 / REFINEMENT)
_PI = np.float32(math.pi)
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_NONE = np.int32(-1)
_GAIN = np.float32(12.0)  # sampling rate over relative irradiance
_LEAST_RATE = np.float32(0.06)
_LONG_GAIN, _LEAST_LONG_RATE, _UNKNOWN_LONG_RATE = np.float32(40.0), np.float32(0.006), np.float32(0.003)
_HALF, _TWO = np.float32(0.5), np.float32(2.0)


class ChosenChain(NamedTuple):
    """A choice of the chains that a walk looks for."""

    caster: Any  # -1: none
    kind: Any  # a long kind (walk.py), or NO_CHAIN for all short ones
    chance: Any  # the probability of this choice
    is_seeded: Any  # whether `seed` is known
    seed: Any  # a point on the caster near which walks should start


@device
def bucket_of(p, caster, level, scale):
    """Returns the bucket of a point p and a caster. level: from 0, the finest. scale: its cubes per unit length."""
    x, y, z = floor(p[0] * scale), floor(p[1] * scale), floor(p[2] * scale)
    key = ((x * _X) ^ (y * _Y) ^ (z * _Z)) + (np.int64(caster) * LEVELS + level) * _KEY
    return (key ^ (key >> _SHIFT)) & _MASK


@device
def long_bucket(p, level, scale):
    """Returns the bucket of a point in the grid of long chains. level, scale: as for `bucket_of`."""
    return bucket_of(p, np.int32(LONG_KEY), level, scale) & _LONG_MASK


@device
def _rate(irradiance, importance, rivalry):
    """Returns a sampling rate. rivalry: density of photons at relative irradiance 1, over that of paths like this one."""
    return min(max(_GAIN * importance * irradiance / (_ONE + rivalry * irradiance), _LEAST_RATE), _ONE)


@device
def sampling_rates(scene, p, caster, importance, rivals):
    """Returns the probabilities with which transmitted and reflected light by a caster is worth a walk from the point p.

    They grow with the light that photons have brought there, by the finest level that any have reached, and with the vertex's
    importance, up to 1. They are never 0, since photons may be missing. rivals: 0, or if photons, too, bring this light to where
    this path has come from (renderer/kernel/manifold/meeting.py), the reciprocal of the density of such paths here, per area.
    """
    tables = scene.caustics
    if len(tables.brightness) == 0:
        return _ONE, _ONE
    scale, transmitted, reflected = tables.brightness_scale[0], _ZERO, _ZERO
    for level in range(LEVELS):
        bucket = bucket_of(p, caster, level, scale)
        if transmitted == _ZERO:
            transmitted = tables.brightness[bucket, 0]
        if reflected == _ZERO:
            reflected = tables.brightness[bucket, 1]
        if transmitted > _ZERO and reflected > _ZERO:
            break
        scale = scale * _FINER
    radius = row(tables.bound, caster, 4)[3]
    rivalry = rivals / (_PI * radius * radius * np.float32(len(tables.caster)))
    return _rate(transmitted, importance, rivalry), _rate(reflected, importance, rivalry)


@device
def seed_bucket(scene, p, caster):
    """Returns the finest bucket at the point p that lists photons of this caster, or -1."""
    tables = scene.caustics
    if len(tables.seed) == 0:
        return -1
    scale = tables.brightness_scale[0]
    for level in range(LEVELS):
        bucket = bucket_of(p, caster, level, scale)
        if tables.seed[bucket, 0] >= 0:
            return bucket
        scale = scale * _FINER
    return -1


@device
def _is_below(scene, number, p, n):
    """Returns True if a caster lies below the horizon of the point p. n: the normal; zero if light from all sides counts."""
    x, y, z, radius = row(scene.caustics.bound, number, 4)
    return vec.dot(vec.sub((x, y, z), p), n) <= -radius


@device
def _caster_rate(scene, number, p, n, importance, rivals):
    """Returns the greater sampling rate of a caster for the point p; 0 if it lies below the horizon.

    n: as for `_is_below`. importance, rivals: as for `sampling_rates`.
    """
    if _is_below(scene, number, p, n):
        return _ZERO
    transmitted, reflected = sampling_rates(scene, p, number, importance, rivals)
    return max(transmitted, reflected)


@device
def _long_rate(scene, p, importance):
    """Returns (the probability with which light of long chains is worth a walk from the point p, its bucket or -1)."""
    tables = scene.caustics
    if len(tables.long_kind) == 0:
        return _ZERO, -1
    scale = tables.brightness_scale[0]
    for level in range(LEVELS):
        bucket = long_bucket(p, level, scale)
        irradiance = tables.long_light[bucket, 0]
        if irradiance > _ZERO:
            wanted = min(_LONG_GAIN * importance * irradiance, tables.long_light[bucket, 1])
            return max(wanted, _LEAST_LONG_RATE), bucket
        scale = scale * _FINER
    return _UNKNOWN_LONG_RATE, -1


@device
def _choose_long(scene, p, n, bucket, u):
    """Chooses a long chain for the point p; returns a ChosenChain. bucket: from `_long_rate`. u: a random number in [0, 1)."""
    tables = scene.caustics
    main, place, chance, share = _NONE, p, _ZERO, _ONE
    if bucket >= 0:
        _, _, kept, x, y, z = row(tables.long_light, bucket, LONG_LIGHT_COLUMNS)
        main, place, share = np.int32(kept), (x, y, z), _HALF
    number = main
    if bucket < 0 or u >= _HALF:
        left = u if bucket < 0 else _TWO * u - _ONE
        drawn, _, _ = sample_cdf(tables.long_cdf, left)
        number = np.int32(drawn)
    chance = share * (tables.long_cdf[number + 1] - tables.long_cdf[number]) + (_HALF if number == main else _ZERO)
    caster, kind = tables.long_kind[number, 0], tables.long_kind[number, 1]
    if _is_below(scene, caster, p, n):
        caster = _NONE
    return ChosenChain(caster, kind, chance, number == main, place)


@device
def choose_chain(scene, p, n, importance, rivals, u):
    """Chooses the chains that a walk from the point p looks for: all short ones of a caster, one long kind, or none.

    Returns a ChosenChain. A caster's probability is its greater sampling rate; if the sum of all rates exceeds 1, it is in
    proportion to that. n: as for `_is_below`. importance, rivals: as for `sampling_rates`. u: a random number in [0, 1).
    """
    long, bucket = _long_rate(scene, p, importance)
    total = long
    count = len(scene.caustics.caster)
    for k in range(count):
        total += _caster_rate(scene, k, p, n, importance, rivals)
    share = max(total, _ONE)
    left, found, rate = u * share, _NONE, _ZERO
    if left < long:
        chosen = _choose_long(scene, p, n, bucket, left / long)
        return ChosenChain(chosen.caster, chosen.kind, chosen.chance * long / share, chosen.is_seeded, chosen.seed)
    if left < total:
        left -= long
        for k in range(count):
            own = _caster_rate(scene, k, p, n, importance, rivals)
            if own > _ZERO:
                found, rate = np.int32(k), own
                if left < own:
                    break
            left -= own
    return ChosenChain(found, NO_CHAIN, rate / share, False, p)
