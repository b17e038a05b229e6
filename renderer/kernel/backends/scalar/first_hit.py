"""Stores a path's first hit in an array, because in the integrator's loop its values would occupy registers."""

from __future__ import annotations

import numpy as np

from renderer.bvh.simd import load_int
from renderer.film import ALPHA_PLANES, POSITION
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.fixed_point import fixed
from renderer.kernel.light_groups import GROUP_ROW
from renderer.kernel.steps import catch_reflections
from renderer.kernel.steps.record_first_hit import (
    DEEP,
    IDS,
    MEANS,
    FirstHit,
    no_hit,
    record_direct_light,
    record_reflection,
)
from renderer.wide.fields import Layout, accessors

__all__ = [
    "FIRST_GROUP",
    "FIRST_HIT_SLOTS",
    "add_alpha",
    "add_first_hit",
    "catches_light_alone",
    "forget_first_hit",
    "is_finite_first_hit",
    "is_from_catcher",
    "store_direct_light",
    "store_first_hit",
    "store_record",
    "store_reflection",
    "store_shadow",
]

_LAYOUT = Layout(FirstHit)
FIRST_HIT_SLOTS = _LAYOUT.width
FIRST_GROUP = np.uint32(FIRST_HIT_SLOTS // GROUP_ROW)  # in the array of a first hit: the first row of the light by group
assert FIRST_HIT_SLOTS % GROUP_ROW == 0
_gather, _scatter = accessors(_LAYOUT)
_ONLY = np.uintp(0)
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
_CAUGHT, _SHADOWED = _LAYOUT.column(FirstHit, "caught"), _LAYOUT.column(FirstHit, "shadowed")
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
def store_record(records, number, first, radiance):
    """Stores what is recorded of a sample in row `number` of `records` (Output in renderer/kernel/accumulate.py).

    first: the array with its FirstHit. radiance: what the film adds.
    """
    for k in range(len(IDS)):
        records[number, k] = load_int(first, IDS[k, 0])
    if records.shape[1] > len(IDS):
        for k in range(3):
            records[number, len(IDS) + k] = np.float32(radiance[k]).view(np.uint32)
        for k in range(len(DEEP)):
            records[number, len(IDS) + 3 + k] = load_int(first, DEEP[k])


@device
def is_finite_first_hit(first):
    """Returns True if no real number of the FirstHit stored in `first` is NaN or infinite."""
    zero = _ZERO
    for k in range(ALPHA_PLANES):
        zero += first[_UNCOVERED + np.uintp(k)] * _ZERO
    for k in range(len(MEANS)):
        zero += first[MEANS[k, 0]] * _ZERO
    return zero == _ZERO


@device
def catches_light_alone(first):
    """Returns True if the vertex of the FirstHit stored in `first` is on a catcher, and its path has met no object after it."""
    return first[_CAUGHT] > _ZERO and first[_SHADOWED] < _ZERO


@device
def is_from_catcher(scene, first, path, options):
    """Returns True if the path's ray is the first one from a catcher of reflections."""
    found = np.bool_(False)
    if scene.has.reflections is not None:
        found = options.has_mattes and catch_reflections.is_from_catcher(path, first[_CAUGHT])
    return found


@device
def store_shadow(first, radiance):
    """Stores in `first` the radiance that a sample on a shadow catcher has found."""
    first[_SHADOWED] = vec.luminance(radiance)


@device
def store_direct_light(first, light):
    """Adds direct light at a catcher, its luminance before occlusion, to the FirstHit stored in `first`."""
    _scatter(first, _ONLY, record_direct_light(_gather(first, _ONLY, FirstHit), light))


@device
def store_reflection(first, light):
    """Stores in `first` that the path has met an object after a catcher. light: as for `record_reflection`."""
    _scatter(first, _ONLY, record_reflection(_gather(first, _ONLY, FirstHit), light))


@device
def add_alpha(sums, y, x, first, scale):
    """Adds the sample's alpha to the last planes of pixel (x, y), by the FirstHit stored in `first`."""
    plane = sums.shape[0] - ALPHA_PLANES
    sums[plane, y, x] += fixed(_ONE, scale) - fixed(first[_UNCOVERED], scale)
    for k in range(1, ALPHA_PLANES):
        sums[plane + k, y, x] += fixed(first[_UNCOVERED + np.uintp(k)], scale)


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
