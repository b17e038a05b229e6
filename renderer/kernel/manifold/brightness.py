"""Hashed grid of the irradiance by caster that photons have measured, and the probability of beginning a walk.

The grid has levels of cubes. A bucket holds the transmitted and the reflected irradiance in one cube by one caster, relative to
that of the casters themselves; it is found by a hash of cube and caster. It is 0 where too few photons have arrived.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.fetch import row
from renderer.kernel.polynomial import floor

__all__ = ["BUCKETS", "LEVELS", "REFINEMENT", "bucket_of", "choose_caster", "sampling_rates"]

LEVELS = 5
REFINEMENT = 3.0  # ratio of the sizes of a level's cubes to those of the next finer one
BUCKETS = 1 << 18
_MASK = BUCKETS - 1
_X, _Y, _Z, _KEY = 73856093, 19349663, 83492791, 40503  # Teschner et al., "Optimized Spatial Hashing" (2003)
_SHIFT = 15
_FINER = np.float32(1 / REFINEMENT)
_PI = np.float32(math.pi)
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_NONE = np.int32(-1)
_GAIN = np.float32(12.0)  # sampling rate over relative irradiance
_LEAST_RATE = np.float32(0.06)


@device
def bucket_of(p, caster, level, scale):
    """Returns the bucket of a point p and a caster. level: from 0, the finest. scale: its cubes per unit length."""
    x, y, z = floor(p[0] * scale), floor(p[1] * scale), floor(p[2] * scale)
    key = ((x * _X) ^ (y * _Y) ^ (z * _Z)) + (np.int64(caster) * LEVELS + level) * _KEY
    return (key ^ (key >> _SHIFT)) & _MASK


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
def _caster_rate(scene, number, p, n, importance, rivals):
    """Returns the greater sampling rate of a caster for the point p; 0 if it lies below the horizon.

    n: the normal at p; zero if light from all sides counts. importance, rivals: as for `sampling_rates`.
    """
    x, y, z, radius = row(scene.caustics.bound, number, 4)
    if vec.dot(vec.sub((x, y, z), p), n) <= -radius:
        return _ZERO
    transmitted, reflected = sampling_rates(scene, p, number, importance, rivals)
    return max(transmitted, reflected)


@device
def choose_caster(scene, p, n, importance, rivals, u):
    """Chooses a caster for the point p, or none; returns (its index or -1, its probability).

    A caster's probability is its greater sampling rate; if their sum exceeds 1, it is in proportion to that. n, importance,
    rivals: as for `_caster_rate`. u: a random number in [0, 1).
    """
    total = _ZERO
    count = len(scene.caustics.caster)
    for k in range(count):
        total += _caster_rate(scene, k, p, n, importance, rivals)
    share = max(total, _ONE)
    left, found, rate = u * share, _NONE, _ZERO
    if left < total:
        for k in range(count):
            own = _caster_rate(scene, k, p, n, importance, rivals)
            if own > _ZERO:
                found, rate = np.int32(k), own
                if left < own:
                    break
            left -= own
    return found, rate / share
