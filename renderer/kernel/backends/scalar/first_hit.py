"""Stores a path's first hit in an array, because in the integrator's loop its values would occupy registers."""

from __future__ import annotations

import numpy as np

from renderer.bvh.simd import load_int
from renderer.film import POSITION
from renderer.jit import device
from renderer.kernel.fixed_point import fixed
from renderer.kernel.light_groups import GROUP_ROW
from renderer.kernel.steps.record_first_hit import IDS, MEANS, FirstHit, no_hit
from renderer.wide.fields import Layout, accessors

__all__ = [
    "FIRST_GROUP",
    "FIRST_HIT_SLOTS",
    "add_first_hit",
    "alpha_of",
    "forget_first_hit",
    "is_finite_first_hit",
    "store_first_hit",
    "store_ids",
]

_LAYOUT = Layout(FirstHit)
FIRST_HIT_SLOTS = _LAYOUT.width
FIRST_GROUP = np.uint32(FIRST_HIT_SLOTS // GROUP_ROW)  # in the array of a first hit: the first row of the light by group
assert FIRST_HIT_SLOTS % GROUP_ROW == 0
_, _scatter = accessors(_LAYOUT)
_ONLY = np.uintp(0)
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
_DISTANCE, _UNCOVERED = _LAYOUT.column(FirstHit, "distance"), _LAYOUT.column(FirstHit, "uncovered")
_X, _Y, _Z = range(POSITION.start, POSITION.stop)


@device
def forget_first_hit(first):
    """Sets the array, (FIRST_HIT_SLOTS,) float32, to the values of a path that hits nothing."""
    _scatter(first, _ONLY, no_hit(_ZERO))


@device
def store_first_hit(first, hit):
    """Stores a FirstHit in the array `first`, (FIRST_HIT_SLOTS,) float32."""
    _scatter(first, _ONLY, hit)


@device
def store_ids(ids, number, first):
    """Stores the ids of the FirstHit stored in `first` in row `number` of `ids`, (n, 2) uint32."""
    for k in range(len(IDS)):
        ids[number, k] = load_int(first, IDS[k, 0])


@device
def is_finite_first_hit(first):
    """Returns True if no real number of the FirstHit stored in `first` is NaN or infinite."""
    zero = first[_UNCOVERED] * _ZERO
    for k in range(len(MEANS)):
        zero += first[MEANS[k, 0]] * _ZERO
    return zero == _ZERO


@device
def alpha_of(first, scale):
    """Returns the sample's alpha in the film's fixed point, by the FirstHit stored in `first`."""
    return fixed(_ONE, scale) - fixed(first[_UNCOVERED], scale)


@device
def add_first_hit(sums, y, x, first, sample, scale, origin):
    """Adds the FirstHit stored in `first` to the sums of pixel (x, y). origin: see Batch (renderer/kernel/accumulate.py)."""
    for k in range(len(MEANS)):
        sums[MEANS[k, 1], y, x] += fixed(first[MEANS[k, 0]], scale)
    if first[_DISTANCE] > _ZERO:
        sums[_X, y, x] += origin[0]
        sums[_Y, y, x] += origin[1]
        sums[_Z, y, x] += origin[2]
    if sample == 0:
        for k in range(len(IDS)):
            sums[IDS[k, 1], y, x] += load_int(first, IDS[k, 0])
