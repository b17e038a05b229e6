"""Builds the tree of renderer/kernel/light_tree.py: every light a leaf, split where both sides stay small, dim and narrow.

Conty Estevez & Kulla 2018, section 4.4: the surface area orientation heuristic, binned.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from renderer.jit import builder, device
from renderer.kernel.polynomial import acos, sincos_turns
from renderer.scene.description import F32, I32

__all__ = ["LightBounds", "LightTree", "build_light_tree"]

_BINS = 12
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_HALF = np.float32(0.5)
_PI = np.float32(math.pi)
_HALF_PI = np.float32(math.pi / 2)
_INV_2PI = np.float32(0.5 / math.pi)
_INF = np.float32(np.inf)
_SLACK = np.float32(1e-3)  # what float32 cannot tell of small angles, in radians
_ROUNDING = np.float32(1e-5)
_WIDER = np.float32(1.0 + 1e-5)


class LightBounds(NamedTuple):
    """Where each of L lights is, where to it shines, and how much. All float32."""

    center: F32  # (L, 3); of a distant light, its axis
    radius: F32  # (L,): it lies within that sphere; -1: infinitely far
    axis: F32  # (L, 3) unit: normals or directions in which it shines
    spread: F32  # (L,) radians that they differ from the axis by, at most
    reach: F32  # (L,) radians that light leaves them by, at most
    intensity: F32  # (L,) radiant intensity along the axis, luminance; of a distant light, irradiance
    both: F32  # (L,) 1 where it shines to the other side as well


class LightTree(NamedTuple):
    """The order in which lights are to be numbered, and the arrays of CompiledScene, of 2 L - 1 nodes."""

    order: np.ndarray  # (L,) int64: the light that becomes number i
    node: F32  # (N, 12): centre, squared radius (-1: distant), axis, cos spread, cos reach, intensity, both sides, 0
    child: I32  # (N, 2): the first of two children, beside each other, and the second one's first light; or -1 and the light


def build_light_tree(bounds: LightBounds) -> LightTree:
    """The tree of at least one light; distant ones come first."""
    distant = bounds.radius < 0
    order = np.argsort(~distant, kind="stable").astype(np.int64)
    count = len(order)
    node = np.zeros((2 * count - 1, 12), np.float32)
    child = np.full((2 * count - 1, 2), -1, np.int32)
    arrays = (np.ascontiguousarray(array, np.float32) for array in bounds)
    _build(*arrays, int(distant.sum()), order, node, child)
    return LightTree(order, node, child)


@device
def _angle(a0, a1, a2, b0, b1, b2):
    return acos(a0 * b0 + a1 * b1 + a2 * b2)


@device
def _orientation(spread, reach):
    """M_omega of Conty Estevez & Kulla: the solid angle reached, weighted by the cosine beyond the spread."""
    spread = min(spread, _PI)
    whole = min(spread + reach, _PI)
    sine, cosine = sincos_turns(spread * _INV_2PI)
    _, beyond = sincos_turns((spread - _TWO * whole) * _INV_2PI)
    return _TWO * _PI * (_ONE - cosine) + _HALF_PI * (_TWO * whole * sine - beyond - _TWO * spread * sine + cosine)


@device
def _cost(count, power, low, high, axis_sum, spread, reach):
    """What it costs to keep these lights together: power, extent and orientation.

    Their axes' mean has length R; spread evenly over a cap of half angle a, it would be (1 + cos a) / 2.
    """
    if count == _ZERO:
        return _ZERO
    length = math.sqrt(axis_sum[0] * axis_sum[0] + axis_sum[1] * axis_sum[1] + axis_sum[2] * axis_sum[2]) / count
    cap = acos(_TWO * min(length, _ONE) - _ONE)
    x, y, z = high[0] - low[0], high[1] - low[1], high[2] - low[2]
    return power * _orientation(cap + spread, reach) * (x * x + y * y + z * z)


@device
def _fit(center, radius, axis, spread, reach, intensity, both, order, begin, end, row):
    """Fills a node's row with the bounds of the lights order[begin:end]."""
    low = np.empty(3, np.float32)
    high = np.empty(3, np.float32)
    mean = np.zeros(3, np.float32)
    low[:] = _INF
    high[:] = -_INF
    first = order[begin]
    total = _ZERO
    two_sided = _ZERO
    most_reach = _ZERO
    for at in range(begin, end):
        i = order[at]
        total += intensity[i]
        two_sided = max(two_sided, both[i])
        most_reach = max(most_reach, reach[i])
        along = axis[i, 0] * axis[first, 0] + axis[i, 1] * axis[first, 1] + axis[i, 2] * axis[first, 2]
        sign = -_ONE if both[i] != _ZERO and along < _ZERO else _ONE
        for k in range(3):
            low[k] = min(low[k], center[i, k] - max(_ZERO, radius[i]))
            high[k] = max(high[k], center[i, k] + max(_ZERO, radius[i]))
            mean[k] += sign * axis[i, k]
    length = math.sqrt(mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2])
    for k in range(3):
        row[k] = (low[k] + high[k]) * _HALF
        row[4 + k] = mean[k] / length if length > _ZERO else axis[first, k]
    reached = _ZERO
    widest = _ZERO
    for at in range(begin, end):
        i = order[at]
        x, y, z = center[i, 0] - row[0], center[i, 1] - row[1], center[i, 2] - row[2]
        reached = max(reached, math.sqrt(x * x + y * y + z * z) + max(_ZERO, radius[i]))
        cosine = axis[i, 0] * row[4] + axis[i, 1] * row[5] + axis[i, 2] * row[6]
        if two_sided != _ZERO:
            cosine = abs(cosine)
        widest = max(widest, acos(cosine) + spread[i])
    reached *= _WIDER
    row[3] = reached * reached if radius[first] >= _ZERO else -_ONE
    _, row[7] = sincos_turns(min(widest + _SLACK, _PI) * _INV_2PI)
    _, cos_reach = sincos_turns(most_reach * _INV_2PI)
    row[8] = cos_reach - _ROUNDING
    row[9] = total
    row[10] = two_sided


@device
def _best_split(center, radius, axis, spread, reach, intensity, both, order, begin, end):
    """(axis, plane) that parts order[begin:end] at the least cost; axis -1 where all centres are one."""
    best = _INF
    best_axis = -1
    best_plane = _ZERO
    count = np.zeros(_BINS, np.float32)
    power = np.zeros(_BINS, np.float32)
    low = np.zeros((_BINS, 3), np.float32)
    high = np.zeros((_BINS, 3), np.float32)
    total_axis = np.zeros((_BINS, 3), np.float32)
    most_spread = np.zeros(_BINS, np.float32)
    most_reach = np.zeros(_BINS, np.float32)
    right = np.zeros(_BINS, np.float32)
    side_low = np.zeros(3, np.float32)
    side_high = np.zeros(3, np.float32)
    side_axis = np.zeros(3, np.float32)
    extent = np.zeros(3, np.float32)
    least = np.zeros(3, np.float32)
    for k in range(3):
        smallest = _INF
        greatest = -_INF
        for at in range(begin, end):
            smallest = min(smallest, center[order[at], k])
            greatest = max(greatest, center[order[at], k])
        least[k] = smallest
        extent[k] = greatest - smallest
    longest = max(extent[0], max(extent[1], extent[2]))
    first = order[begin]
    for dimension in range(3):
        width = extent[dimension] / np.float32(_BINS)
        if not width > _ZERO:
            continue
        count[:] = _ZERO
        power[:] = _ZERO
        low[:] = _INF
        high[:] = -_INF
        total_axis[:] = _ZERO
        most_spread[:] = _ZERO
        most_reach[:] = _ZERO
        for at in range(begin, end):
            i = order[at]
            b = min(max(int((center[i, dimension] - least[dimension]) / width), 0), _BINS - 1)
            along = axis[i, 0] * axis[first, 0] + axis[i, 1] * axis[first, 1] + axis[i, 2] * axis[first, 2]
            sign = -_ONE if both[i] != _ZERO and along < _ZERO else _ONE
            count[b] += _ONE
            power[b] += intensity[i]
            most_spread[b] = max(most_spread[b], spread[i])
            most_reach[b] = max(most_reach[b], reach[i])
            for k in range(3):
                low[b, k] = min(low[b, k], center[i, k] - max(_ZERO, radius[i]))
                high[b, k] = max(high[b, k], center[i, k] + max(_ZERO, radius[i]))
                total_axis[b, k] += sign * axis[i, k]
        for way in range(2):  # the costs of all right sides, then of left sides
            side_low[:] = _INF
            side_high[:] = -_INF
            side_axis[:] = _ZERO
            n = phi = wide = far = _ZERO
            for step in range(_BINS - 1):
                b = _BINS - 1 - step if way == 0 else step
                n += count[b]
                phi += power[b]
                wide = max(wide, most_spread[b])
                far = max(far, most_reach[b])
                for k in range(3):
                    side_low[k] = min(side_low[k], low[b, k])
                    side_high[k] = max(side_high[k], high[b, k])
                    side_axis[k] += total_axis[b, k]
                cost = _cost(n, phi, side_low, side_high, side_axis, wide, far)
                if way == 0:
                    right[b - 1] = cost if n > _ZERO else _INF
                elif n > _ZERO:
                    cost = (cost + right[b]) * longest / extent[dimension]
                    if cost < best:
                        best = cost
                        best_axis = dimension
                        best_plane = np.float32(b + 1)
    return best_axis, best_plane, least, extent


@builder
def _build(center, radius, axis, spread, reach, intensity, both, distant, order, node, child):
    todo = np.empty((len(order) + 1, 3), np.int64)
    todo[0, 0], todo[0, 1], todo[0, 2] = 0, 0, len(order)
    waiting = 1
    used = 1
    while waiting > 0:
        waiting -= 1
        row, begin, end = todo[waiting, 0], todo[waiting, 1], todo[waiting, 2]
        mixed = begin < distant < end
        _fit(center, radius, axis, spread, reach, intensity, both, order, begin, end, node[row])
        if mixed:  # only the root: nobody asks for its bounds
            node[row, 3] = -_ONE
        if end - begin == 1:
            child[row, 1] = begin
            continue
        middle = begin
        if mixed:
            middle = distant
        else:
            dimension, plane, least, extent = _best_split(
                center, radius, axis, spread, reach, intensity, both, order, begin, end
            )
            if dimension >= 0:
                width = extent[dimension] / np.float32(_BINS)
                for at in range(begin, end):
                    i = order[at]
                    if np.float32(min(max(int((center[i, dimension] - least[dimension]) / width), 0), _BINS - 1)) < plane:
                        order[at] = order[middle]
                        order[middle] = i
                        middle += 1
        if middle == begin or middle == end:
            middle = (begin + end) // 2
        child[row, 0] = used
        child[row, 1] = middle
        todo[waiting, 0], todo[waiting, 1], todo[waiting, 2] = used, begin, middle
        todo[waiting + 1, 0], todo[waiting + 1, 1], todo[waiting + 1, 2] = used + 1, middle, end
        waiting += 2
        used += 2
