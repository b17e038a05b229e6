"""Finds the distinct points of a mesh, and computes normals for meshes that have none. All arrays are allocated by the caller."""

from __future__ import annotations

import numpy as np

from renderer.jit import builder, device

__all__ = ["measure_corners", "number_points", "round_corners", "sort_corners"]

_NORMAL_PRECISION = 1e4  # normals are compared after rounding to 1 / _NORMAL_PRECISION
_MOST_KINDS = 64  # limit of comparisons per corner; beyond it, equal corners at one point may stay separate


@device
def _hash64(value):
    """Returns the 64-bit hash of a u64: the finalizer of SplitMix64 (Steele, Lea & Flood 2014)."""
    value ^= value >> np.uint64(30)
    value *= np.uint64(0xBF58476D1CE4E5B9)
    value ^= value >> np.uint64(27)
    value *= np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@builder
def number_points(bits, salt, slot, first, number):
    """Numbers the distinct rows of bits (V, 3) u32 by hashing and records the first row of each; returns their number.

    salt: u64, varies the hash so that a file cannot force collisions; the result does not depend on it. slot: the hash table,
    whose size is a power of two of at least 2 V, all -1. first, number: (V,) i32.
    """
    mask = np.uint64(len(slot) - 1)
    count = 0
    for i in range(len(bits)):
        a, b, c = bits[i, 0], bits[i, 1], bits[i, 2]
        at = _hash64(_hash64((np.uint64(a) << np.uint64(32) | np.uint64(b)) ^ salt) + np.uint64(c)) & mask
        while slot[at] >= 0:
            j = first[slot[at]]
            if bits[j, 0] == a and bits[j, 1] == b and bits[j, 2] == c:
                break
            at = (at + np.uint64(1)) & mask
        if slot[at] < 0:
            slot[at] = count
            first[count] = i
            count += 1
        number[i] = slot[at]
    return count


@builder
def sort_corners(triangle, number, start, order):
    """Fills order (3 T,) with the corners grouped by point, and start (P + 1,), initially 0, with each group's first index."""
    for i in range(len(triangle)):
        for k in range(3):
            start[number[triangle[i, k]] + 1] += 1
    for p in range(1, len(start)):
        start[p] += start[p - 1]
    for i in range(len(triangle)):
        for k in range(3):
            p = number[triangle[i, k]]
            order[start[p]] = 3 * i + k
            start[p] += 1
    for p in range(len(start) - 1, 0, -1):
        start[p] = start[p - 1]
    start[0] = 0


@builder
def measure_corners(position, triangle, unit, across, along):
    """Computes each triangle's unit normal (0 without an area), and for each corner cross and dot product of its edges.

    across: (3 T,), length of the cross product. along: (3 T,), dot product.
    """
    corner = np.empty((3, 3), np.float64)
    for i in range(len(triangle)):
        for k in range(3):
            for c in range(3):
                corner[k, c] = position[triangle[i, k], c]
        for k in range(3):
            o, n, p = corner[k], corner[(k + 1) % 3], corner[(k + 2) % 3]
            ux, uy, uz = n[0] - o[0], n[1] - o[1], n[2] - o[2]
            vx, vy, vz = p[0] - o[0], p[1] - o[1], p[2] - o[2]
            x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            size = np.sqrt(x * x + y * y + z * z)
            across[3 * i + k] = size
            along[3 * i + k] = ux * vx + uy * vy + uz * vz
            if k == 0:
                size = size if size > 0 else 1.0  # then x, y and z are 0
                unit[i, 0], unit[i, 1], unit[i, 2] = x / size, y / size, z / size


@builder
def round_corners(unit, angle, start, order, vertex, limit, most, normal, kind, kept):
    """Computes each corner's normal: the mean, weighted by angle, of the faces at its point within the crease angle of its face.

    Numbers the distinct (vertex, normal) pairs, records the normal and the first corner of each, and returns their number.

    limit: the cosine of the crease angle. most: largest number of corners at a point that are considered. vertex, kind, kept: (3
    T,) i32; kind is initially all -1. normal: (3 T, 3) f32.
    """
    some = np.empty(_MOST_KINDS, np.int64)
    count = 0
    for p in range(len(start) - 1):
        begin, degree = start[p], start[p + 1] - start[p]
        is_smooth = degree <= most and _bends_little(unit, order, begin, degree, limit)
        x, y, z = np.float32(0), np.float32(0), np.float32(0)
        found = 0
        for r in range(degree):
            here = order[begin + r]
            if r == 0 or not is_smooth:
                x, y, z = _blended(unit, angle, order, begin, degree, r, limit, most)
            for k in range(min(found, _MOST_KINDS)):
                other = some[k]
                if vertex[kept[other]] == vertex[here] and (is_smooth or _equals_normal(normal, other, x, y, z)):
                    kind[here] = other
                    break
            if kind[here] < 0:
                kind[here] = count
                kept[count] = here
                normal[count, 0], normal[count, 1], normal[count, 2] = x, y, z
                some[found % _MOST_KINDS] = count
                count += 1
                found += 1
    return count


@device
def _bends_little(unit, order, begin, degree, limit):
    """Returns True if all faces at a point are within the crease angle of each other.

    The corners at the point then share one normal.
    """
    for r in range(degree):
        a = order[begin + r] // 3
        for k in range(r + 1, degree):
            b = order[begin + k] // 3
            if not unit[a, 0] * unit[b, 0] + unit[a, 1] * unit[b, 1] + unit[a, 2] * unit[b, 2] > limit:
                return False
    return True


@device
def _blended(unit, angle, order, begin, degree, r, limit, most):
    """Returns the smoothed normal, float32, of the r-th of the `degree` corners that meet at a point.

    limit, most: as for `round_corners`.
    """
    here = order[begin + r]
    face = here // 3
    x, y, z = unit[face, 0], unit[face, 1], unit[face, 2]
    tx, ty, tz = x * angle[here], y * angle[here], z * angle[here]
    for k in range(1, min(degree, most)):
        other = order[begin + (r + k) % degree]
        f = other // 3
        if x * unit[f, 0] + y * unit[f, 1] + z * unit[f, 2] > limit:
            tx, ty, tz = tx + unit[f, 0] * angle[other], ty + unit[f, 1] * angle[other], tz + unit[f, 2] * angle[other]
    size = np.sqrt(tx * tx + ty * ty + tz * tz)
    size = size if size > 0 else 1.0
    return np.float32(tx / size), np.float32(ty / size), np.float32(tz / size)


@device
def _equals_normal(normal, i, x, y, z):
    return (
        np.rint(normal[i, 0] * _NORMAL_PRECISION) == np.rint(x * _NORMAL_PRECISION)
        and np.rint(normal[i, 1] * _NORMAL_PRECISION) == np.rint(y * _NORMAL_PRECISION)
        and np.rint(normal[i, 2] * _NORMAL_PRECISION) == np.rint(z * _NORMAL_PRECISION)
    )
