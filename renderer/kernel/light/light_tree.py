"""One light of many, chosen at the point lit: a walk down a tree of lights, at each node by what either side could send there.

Conty Estevez & Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", 2018; pbrt 4ed, 12.6.3. Lights are
numbered in the tree's order, so that a light's number tells its way down, and its chance can be had for any point. Four
children a node instead of two cost no more (twice as many on half as many levels) and are judged by closer bounds.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device, subroutine
from renderer.kernel import vec

__all__ = ["choose_from_tree", "importance", "tree_chance"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_BELOW_ONE = np.float32(1.0 - 2.0**-24)
_TINY = np.float32(1e-20)


@device
def _sine(cosine):
    return math.sqrt(max(_ZERO, _ONE - cosine * cosine))


@device
def _less(sin_a, cos_a, sin_b, cos_b):
    """(sin, cos) of max(0, a - b), for angles within 0 ... pi."""
    if cos_a >= cos_b:
        return _ZERO, _ONE
    return sin_a * cos_b - cos_a * sin_b, cos_a * cos_b + sin_a * sin_b


@device
def importance(node, i, p, n):
    """About the most irradiance that the lights of node i give at p, facing n (zero: all sides). 0 only where they give none."""
    squared_radius = node[i, 3]
    axis = (node[i, 4], node[i, 5], node[i, 6])
    cos_spread = node[i, 7]
    intensity = node[i, 9]
    facing = n[0] != _ZERO or n[1] != _ZERO or n[2] != _ZERO
    if squared_radius < _ZERO:  # infinitely far: all within the spread about -axis
        if facing:
            cosine = -vec.dot(n, axis)
            _, cosine = _less(_sine(cosine), cosine, _sine(cos_spread), cos_spread)
            intensity *= max(_ZERO, cosine)
        return intensity
    d = (p[0] - node[i, 0], p[1] - node[i, 1], p[2] - node[i, 2])
    square = vec.dot(d, d)
    if square <= squared_radius:  # among them
        return intensity / max(squared_radius, _TINY)
    away = vec.scale(d, _ONE / math.sqrt(square))
    sine2 = squared_radius / square
    sin_bound = math.sqrt(sine2)  # the angle under which p sees the node's sphere
    cos_bound = math.sqrt(_ONE - sine2)
    cosine = vec.dot(axis, away)
    if node[i, 10] != _ZERO:  # shines to both sides
        cosine = abs(cosine)
    sine, cosine = _less(_sine(cosine), cosine, _sine(cos_spread), cos_spread)
    _, cosine = _less(sine, cosine, sin_bound, cos_bound)
    if cosine < node[i, 8]:
        return _ZERO
    intensity *= max(_ZERO, cosine)
    if facing:
        cosine = -vec.dot(n, away)
        _, cosine = _less(_sine(cosine), cosine, sin_bound, cos_bound)
        intensity *= max(_ZERO, cosine)
    return intensity / max(square, _TINY)


@device
def _weights(node, child, i, p, n):
    """The importances of node i's two to four children; 0 for those that it has not."""
    first, count = np.int64(child[i, 0]), child[i, 1]
    a = importance(node, first, p, n)
    b = importance(node, first + 1, p, n)
    c = importance(node, first + 2, p, n) if count > 2 else _ZERO
    d = importance(node, first + 3, p, n) if count > 3 else _ZERO
    return a, b, c, d, a + b + c + d


@subroutine
def choose_from_tree(node, child, p, n, choice):
    """The light that `choice` in [0, 1) picks: (its number, its chance). The chance is 0 where the way ends at a node none of
    whose children reaches p."""
    chance = _ONE
    i = 0
    while child[i, 0] >= 0:
        a, b, c, d, total = _weights(node, child, i, p, n)
        if not total > _ZERO:
            return 0, _ZERO
        at = choice * total
        i = child[i, 0]
        weight = a
        if at >= weight:
            at -= weight
            weight = b
            i += 1
            if at >= weight:
                at -= weight
                weight = c
                i += 1
                if at >= weight:
                    at -= weight
                    weight = d
                    i += 1
        if not weight > _ZERO:  # only where `at` was rounded up
            return 0, _ZERO
        chance *= weight / total
        choice = min(at / weight, _BELOW_ONE)
    return child[i, 2], chance


@subroutine
def tree_chance(node, child, p, n, light):
    """The chance with which `choose_from_tree` picks `light`, to the bit."""
    chance = _ONE
    i = 0
    while child[i, 0] >= 0:
        a, b, c, d, total = _weights(node, child, i, p, n)
        if not total > _ZERO:
            return _ZERO
        first, count = np.int64(child[i, 0]), child[i, 1]
        if light < child[first + 1, 2]:
            i, weight = first, a
        elif count < 3 or light < child[first + 2, 2]:
            i, weight = first + 1, b
        elif count < 4 or light < child[first + 3, 2]:
            i, weight = first + 2, c
        else:
            i, weight = first + 3, d
        chance *= weight / total
    return chance
