"""Meshes of the scenes of hard light. Imports NumPy only, since Python environments of peers build the same scenes.

Y is up, lengths are in metres. Fronts are counter-clockwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["Point", "Shape", "ball", "box", "joined", "moved", "rectangle", "revolved", "turned", "wall_with_holes", "waves"]

Point = tuple[float, float, float]
F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


class Shape(NamedTuple):
    """A triangle mesh. positions: (V, 3). triangles: (T, 3). normals: (V, 3) unit vectors, or None for flat shading."""

    positions: F64
    triangles: I64
    normals: F64 | None = None


def rectangle(center: Point, u: Point, v: Point) -> Shape:
    """Returns the rectangle with corners center +- u +- v. Its front faces along u x v."""
    c, a, b = (np.array(x, float) for x in (center, u, v))
    return Shape(np.array([c - a - b, c + a - b, c + a + b, c - a + b]), np.array([[0, 1, 2], [0, 2, 3]]))


def box(low: Point, high: Point, inwards: bool = False) -> Shape:
    """Returns a box between two corners, with the fronts outside, or inside if `inwards`."""
    middle, half = (np.add(low, high) / 2, np.subtract(high, low) / 2)
    sides = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal, u, v = (np.roll(np.eye(3), -axis, axis=0)[k] * half for k in range(3))
            order = sign if not inwards else -sign
            sides.append(rectangle(tuple(middle + sign * normal), tuple(u), tuple(order * v)))
    return joined(*sides)


def joined(*shapes: Shape) -> Shape:
    """Returns flat shapes as one mesh."""
    before = np.cumsum([0, *(len(shape.positions) for shape in shapes)])
    triangles = [shape.triangles + first for shape, first in zip(shapes, before, strict=False)]
    return Shape(np.concatenate([shape.positions for shape in shapes]), np.concatenate(triangles))


def turned(shape: Shape, degrees: float, about: Point, axis: str = "y") -> Shape:
    """Returns the shape rotated counter-clockwise about an axis through the point `about`."""
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    k = "xyz".index(axis)
    turn = np.eye(3)
    a, b = (k + 1) % 3, (k + 2) % 3
    turn[[a, a, b, b], [a, b, a, b]] = cos, -sin, sin, cos
    normals = None if shape.normals is None else shape.normals @ turn.T
    return Shape((shape.positions - about) @ turn.T + about, shape.triangles, normals)


def moved(shape: Shape, by: Point) -> Shape:
    """Returns the translated shape."""
    return shape._replace(positions=shape.positions + by)


def wall_with_holes(low: Point, high: Point, holes: Sequence[tuple[float, float, float, float]], axis: int) -> Shape:
    """Returns a wall, a box between two corners, with rectangular holes through its whole thickness, as boxes.

    axis: the direction of its thickness. holes: (from, to) along the first of the other two axes in the order x, y, z, which
    increase and do not overlap, then (from, to) along the second.
    """
    a, b = (k for k in range(3) if k != axis)

    def block(a0: float, a1: float, b0: float, b1: float) -> Shape:
        first, last = list(low), list(high)
        first[a], last[a], first[b], last[b] = a0, a1, b0, b1
        return box((first[0], first[1], first[2]), (last[0], last[1], last[2]))

    blocks, at = [], low[a]
    for a0, a1, b0, b1 in holes:
        blocks += [block(at, a0, low[b], high[b])] if a0 > at else []
        blocks += [block(a0, a1, low[b], b0)] if b0 > low[b] else []
        blocks += [block(a0, a1, b1, high[b])] if b1 < high[b] else []
        at = a1
    blocks += [block(at, high[a], low[b], high[b])] if at < high[a] else []
    return joined(*blocks)


def ball(center: Point, radius: float, levels: int) -> Shape:
    """Returns a smooth sphere of 20 * 4**levels triangles."""
    golden = (1 + 5**0.5) / 2
    corners = np.array([np.roll((0.0, s, t * golden), k) for k in range(3) for s in (-1, 1) for t in (-1, 1)])
    corners /= np.linalg.norm(corners[0])
    near = np.isclose(corners @ corners.T, 5**-0.5)
    found = [(i, j, k) for i in range(12) for j in range(i) for k in range(j) if near[i, j] and near[j, k] and near[i, k]]
    triangles = np.array([f if np.linalg.det(corners[list(f)]) > 0 else f[::-1] for f in found])
    points = corners
    for _ in range(levels):
        edges = np.sort(np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
        ends, number = np.unique(edges, axis=0, return_inverse=True)
        middles = points[ends].sum(1)
        middles /= np.linalg.norm(middles, axis=1, keepdims=True)
        ab, bc, ca = (number.reshape(3, -1) + len(points))[:3]
        a, b, c = triangles.T
        triangles = np.concatenate([np.stack(corner, 1) for corner in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
        points = np.concatenate([points, middles])
    return Shape(points * radius + center, triangles, points)


def waves(half: float, cells: int, height: float, terms: Sequence[tuple[float, float, float, float]]) -> Shape:
    """Returns the surface of water over the square -half ... half, y = height * sum of a sin(kx x + kz z + phase).

    terms: (kx, kz, phase, a) of each.
    """
    x, z = np.meshgrid(*[np.linspace(-half, half, cells + 1)] * 2, indexing="ij")
    y, along_x, along_z = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
    for kx, kz, phase, a in terms:
        angle = kx * x + kz * z + phase
        y += height * a * np.sin(angle)
        along_x += height * a * kx * np.cos(angle)
        along_z += height * a * kz * np.cos(angle)
    normals = np.stack([-along_x, np.ones_like(x), -along_z], -1).reshape(-1, 3)
    i = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, 1:].ravel(), i[1:, :-1].ravel()
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Shape(np.stack([x, y, z], -1).reshape(-1, 3), triangles, normals)


def revolved(center: Point, profile: F64, normals: F64, around: int) -> Shape:
    """Returns a closed smooth surface of revolution about the y axis through `center`.

    profile: (N, 2) radius and height, which begins and ends on the axis, in the order that has the outside on the right. normals:
    (N, 2) unit vectors to the outside, along the axis at both ends.
    """
    angles = np.arange(around) * (2 * np.pi / around)
    turn = np.stack([np.cos(angles), -np.sin(angles)], 1)

    def ring(values: F64) -> F64:
        return np.column_stack([values[0] * turn[:, 0], np.full(around, values[1]), values[0] * turn[:, 1]])

    inner = range(1, len(profile) - 1)
    ends = [0, len(profile) - 1]
    points = np.concatenate([*(ring(profile[i]) for i in inner), [[0, profile[i, 1], 0] for i in ends]])
    outwards = np.concatenate([*(ring(normals[i]) for i in inner), [[0, normals[i, 1], 0] for i in ends]])
    i = np.arange(around)
    j = (i + 1) % around
    first, last = len(points) - 2, len(points) - 1
    faces = [np.stack([np.full(around, first), j, i], 1)]
    for row in range(len(inner) - 1):
        low, high = row * around, (row + 1) * around
        faces += [np.stack([low + i, low + j, high + j], 1), np.stack([low + i, high + j, high + i], 1)]
    top = (len(inner) - 1) * around
    faces.append(np.stack([top + i, top + j, np.full(around, last)], 1))
    return Shape(points + center, np.concatenate(faces), outwards)
