"""Bounding boxes in the builder's layout: rows of eight float32, (-lower x y z, n, upper x y z, -n).

One 8-lane maximum extends a box by another, and updates the largest and the smallest primitive number n in it. From these follow
the kinds of primitives it contains, since triangles are numbered first, then curve segments, spheres and instances. Numbers are
stored as the bits of floats from 1 up, which preserves their order and avoids denormal numbers: these are slow on some
processors.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.bvh.layout import CURVES, INSTANCE, SPHERES, TRIANGLES
from renderer.bvh.simd import extract, load, load_int, splat, store, store_int
from renderer.bvh.simd_builder import store_maximum, swapped
from renderer.jit import device

__all__ = [
    "bound",
    "clear",
    "doubled_centroid",
    "exchange",
    "first_kind",
    "grow",
    "grow_by",
    "half_area",
    "last_kind",
    "number_of",
    "numbered",
    "numbers_of",
    "set_number",
]

_NUMBER = 3  # the lane of n
_MINUS_NUMBER = 7
_ONE_BITS = np.int32(0x3F800000)  # of 1.0
_SIGN = np.int32(-(2**31))
_NOTHING = np.float32(-np.inf)


def numbered(boxes: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Returns a copy of the boxes, (N, 8) f32, with primitive numbers 0 ... N - 1."""
    number = np.arange(len(boxes), dtype=np.int32) + _ONE_BITS
    boxes.view(np.int32)[:, _NUMBER], boxes.view(np.int32)[:, _MINUS_NUMBER] = number, number | _SIGN
    return boxes


def numbers_of(boxes: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Returns the primitive numbers, (N,) i32, of the boxes, (N, 8) f32."""
    return boxes.view(np.int32)[:, _NUMBER] - _ONE_BITS


@device
def clear(boxes, i):
    """Sets row i of `boxes` to the empty box."""
    store(boxes, np.uintp(i * 8), splat(_NOTHING))


@device
def grow(boxes, i, others, j):
    """Extends box i to contain box j of `others`."""
    store_maximum(boxes, np.uintp(i * 8), load(others, np.uintp(j * 8)))


@device
def grow_by(boxes, i, other):
    """Extends box i to contain `other`, a box given as an f32x8."""
    store_maximum(boxes, np.uintp(i * 8), other)


@device
def exchange(boxes, i, j):
    """Swaps rows i and j of `boxes`."""
    a = load(boxes, np.uintp(i * 8))
    store(boxes, np.uintp(i * 8), load(boxes, np.uintp(j * 8)))
    store(boxes, np.uintp(j * 8), a)


@device
def doubled_centroid(box):
    """Returns (-c, c), an f32x8, where c is twice the centroid of a box."""
    return box - swapped(box)


@device
def half_area(box):
    """Returns half the surface area of a box, an f32x8."""
    size = box + swapped(box)
    dx, dy, dz = extract(size, np.uint32(0)), extract(size, np.uint32(1)), extract(size, np.uint32(2))
    return dx * dy + dy * dz + dz * dx


@device
def set_number(box, i, number):
    """Sets the primitive number of box i."""
    store_int(box, np.uintp(i * 8 + _NUMBER), np.int32(number) + _ONE_BITS)
    store_int(box, np.uintp(i * 8 + _MINUS_NUMBER), (np.int32(number) + _ONE_BITS) | _SIGN)


@device
def number_of(box, i):
    """Returns the primitive number of box i; the largest one if it contains several primitives."""
    return load_int(box, np.uintp(i * 8 + _NUMBER)) - _ONE_BITS


@device
def _kind(number, curves, triangles, solids):
    if number < triangles:
        return TRIANGLES if number < curves else CURVES
    return SPHERES if number < solids else INSTANCE


@device
def first_kind(box, i, curves, triangles, solids):
    """Returns the kind of the primitive of lowest number in box i: TRIANGLES, CURVES, SPHERES or INSTANCE.

    curves, triangles, solids: the first primitive number of a curve segment, of a sphere, and of an instance.
    """
    return _kind((load_int(box, np.uintp(i * 8 + _MINUS_NUMBER)) ^ _SIGN) - _ONE_BITS, curves, triangles, solids)


@device
def last_kind(box, i, curves, triangles, solids):
    """Returns the kind of the primitive of highest number in box i; see `first_kind`."""
    return _kind(number_of(box, i), curves, triangles, solids)


@device
def bound(box, first, end, whole, i, spread, j):
    """Writes the bounds of boxes[first : end] into whole[i], and the bounds of these boxes' doubled centroids into spread[j]."""
    clear(whole, i)
    clear(spread, j)
    for k in range(first, end):
        grow(whole, i, box, k)
        grow_by(spread, j, doubled_centroid(load(box, np.uintp(k * 8))))
