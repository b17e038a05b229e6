"""Builds the light tree: each leaf is one light, and each split minimises the power, extent and orientation of both sides.

Conty Estevez & Kulla 2018, section 4.4: the surface area orientation heuristic, binned. The eight children of a node result from
seven binary splits.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.arrays.light_rows import (
    AXIS,
    CHILD,
    COS_REACH,
    COS_SPREAD,
    END,
    INTENSITY,
    LIGHT_WIDTH,
    MIRROR,
    NEAR,
    NO_END,
    PLACE,
    RADIUS,
    SIN_SPREAD,
)
from renderer.jit import builder, device
from renderer.kernel.polynomial import acos, sincos_turns

__all__ = ["build"]

_BINS = 12
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_HALF = np.float32(0.5)
_PI = np.float32(math.pi)
_HALF_PI = np.float32(math.pi / 2)
_INV_2PI = np.float32(0.5 / math.pi)
_INF = np.float32(np.inf)
_SLACK = np.float32(1e-3)  # float32 error of small angles, in radians
_ROUNDING = np.float32(1e-5)
_WIDER = np.float32(1.0 + 1e-5)


@device
def _orientation(spread, reach):
    """Returns M_omega of Conty Estevez & Kulla: the solid angle reached, weighted by the cosine beyond the spread.

    spread, reach: radians.
    """
    spread = min(spread, _PI)
    whole = min(spread + reach, _PI)
    sine, cosine = sincos_turns(spread * _INV_2PI)
    _, beyond = sincos_turns((spread - _TWO * whole) * _INV_2PI)
    return _TWO * _PI * (_ONE - cosine) + _HALF_PI * (_TWO * whole * sine - beyond - _TWO * spread * sine + cosine)


@device
def _cost(count, power, low, high, axis_sum, spread, reach):
    """Returns the split heuristic's cost of a group of lights: power times orientation times the squared diagonal of its box.

    The spread of the axes is estimated from the length R of their mean: axes uniform over a cap of half angle a have
    R = (1 + cos a) / 2.
    """
    if count == _ZERO:
        return _ZERO
    length = math.sqrt(axis_sum[0] * axis_sum[0] + axis_sum[1] * axis_sum[1] + axis_sum[2] * axis_sum[2]) / count
    cap = acos(_TWO * min(length, _ONE) - _ONE)
    x, y, z = high[0] - low[0], high[1] - low[1], high[2] - low[2]
    return power * _orientation(cap + spread, reach) * (x * x + y * y + z * z)


@builder
def _write_bounds(center, radius, axis, spread, reach, intensity, both, order, begin, end, row, lane):
    """Writes the bounds of the lights order[begin:end] into lane `lane` of the node whose table rows begin at `row`."""
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
        low[k] = (low[k] + high[k]) * _HALF
        mean[k] = mean[k] / length if length > _ZERO else axis[first, k]
    reached = _ZERO
    widest = _ZERO
    for at in range(begin, end):
        i = order[at]
        x, y, z = center[i, 0] - low[0], center[i, 1] - low[1], center[i, 2] - low[2]
        reached = max(reached, math.sqrt(x * x + y * y + z * z) + max(_ZERO, radius[i]))
        cosine = axis[i, 0] * mean[0] + axis[i, 1] * mean[1] + axis[i, 2] * mean[2]
        if two_sided != _ZERO:
            cosine = abs(cosine)
        widest = max(widest, acos(cosine) + spread[i])
    widest = min(widest + _SLACK, _PI)
    sine, cosine = sincos_turns(widest * _INV_2PI)
    sine = max(sine, _ZERO)
    near = radius[first] >= _ZERO
    row[NEAR, lane] = _ONE if near else _ZERO
    row[RADIUS, lane] = reached * _WIDER if near else (sine if cosine > _ZERO else _TWO)
    for k in range(3):
        row[PLACE + k, lane] = -low[k] if near else mean[k]
        row[AXIS + k, lane] = mean[k] if near else _ZERO
    row[MIRROR, lane] = -_ONE if two_sided != _ZERO else _ONE
    row[COS_SPREAD, lane] = cosine if near else -_ONE
    row[SIN_SPREAD, lane] = sine if near else _ZERO
    _, cosine = sincos_turns(most_reach * _INV_2PI)
    row[COS_REACH, lane] = max(cosine - _ROUNDING, _ZERO)
    row[INTENSITY, lane] = total


@builder
def _best_split(center, radius, axis, spread, reach, intensity, both, order, begin, end):
    """Finds the binned split of order[begin:end] with the lowest cost; returns (axis, plane, box minimum, box extent).

    axis: -1 if no plane separates the lights. plane: number of bins before it.
    """
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
        for way in range(2):  # costs of all right sides, then of all left sides
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
def _partition(center, radius, axis, spread, reach, intensity, both, distant, order, begin, end):
    """Reorders the lights order[begin:end] into two parts by the best split; returns the index where the second begins.

    Distant lights are separated from the others first. Where no plane separates the lights, the list is halved.
    """
    if begin < distant < end:
        return distant
    dimension, plane, least, extent = _best_split(center, radius, axis, spread, reach, intensity, both, order, begin, end)
    middle = begin
    if dimension >= 0:
        width = extent[dimension] / np.float32(_BINS)
        for at in range(begin, end):
            i = order[at]
            if np.float32(min(max(int((center[i, dimension] - least[dimension]) / width), 0), _BINS - 1)) < plane:
                order[at] = order[middle]
                order[middle] = i
                middle += 1
    return (begin + end) // 2 if middle in (begin, end) else middle


@device
def _sum(intensity, order, begin, end):
    total = _ZERO
    for at in range(begin, end):
        total += intensity[order[at]]
    return total


@device
def _part_to_split(border, strength, parts):
    """Returns the index of the part (group of lights) to split next; -1 if each part is a single light.

    Chooses the strongest part among those with more lights than a node has children, or the strongest of all if no
    part has more. Splitting by strength places frequently sampled lights near the root; splitting large parts first fills the
    last nodes.
    """
    for fitting in (LIGHT_WIDTH, 1):
        chosen = -1
        for k in range(parts):
            if border[k + 1] - border[k] > fitting and (chosen < 0 or strength[k] > strength[chosen]):
                chosen = k
        if chosen >= 0:
            return chosen
    return -1


@builder
def build(center, radius, axis, spread, reach, intensity, both, distant, order, node):
    """Builds the tree: reorders `order`, fills `node` and returns the number of nodes.

    The first `distant` lights of `order` are infinitely distant and are separated from the others. The other arrays are those of
    LightBounds and LightTree (renderer/scene/light_tree.py).
    """
    todo = np.empty((len(order) + 1, 3), np.int64)
    todo[0, 0], todo[0, 1], todo[0, 2] = 0, 0, len(order)
    border = np.empty(LIGHT_WIDTH + 1, np.int64)
    strength = np.empty(LIGHT_WIDTH, np.float32)
    number = node.view(np.int32)
    waiting = 1
    used = 1
    while waiting > 0:
        waiting -= 1
        parent, begin, end = todo[waiting, 0], todo[waiting, 1], todo[waiting, 2]
        parts = 1
        border[0] = begin
        border[1] = end
        strength[0] = _ZERO
        while parts < LIGHT_WIDTH:
            chosen = _part_to_split(border, strength, parts)
            if chosen < 0:
                break
            first, last = border[chosen], border[chosen + 1]
            middle = _partition(center, radius, axis, spread, reach, intensity, both, distant, order, first, last)
            for k in range(parts, chosen, -1):
                border[k + 1] = border[k]
                strength[k] = strength[k - 1]
            border[chosen + 1] = middle
            strength[chosen] = _sum(intensity, order, first, middle)
            strength[chosen + 1] = _sum(intensity, order, middle, last)
            parts += 1
        for k in range(parts):
            first, last = border[k], border[k + 1]
            _write_bounds(center, radius, axis, spread, reach, intensity, both, order, first, last, node[parent], k)
            number[parent, END, k] = last
            if last - first == 1:
                number[parent, CHILD, k] = ~first
            else:
                number[parent, CHILD, k] = used
                todo[waiting, 0], todo[waiting, 1], todo[waiting, 2] = used, first, last
                waiting += 1
                used += 1
        for k in range(parts, LIGHT_WIDTH):
            number[parent, CHILD, k] = ~0
            number[parent, END, k] = NO_END
            node[parent, COS_SPREAD, k] = -_ONE
    return used
