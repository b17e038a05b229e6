"""Spheres, cylinders and disks, complete or partial, as meshes in object space; v of the UVs is measured from the top."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Mesh
from renderer.scene.readers.pbrt.parameters import Parameters
from renderer.sentences import Sentence

__all__ = ["QUADRICS", "Quadric", "quadric", "shape_key", "whole_sphere"]

F64 = npt.NDArray[np.float64]
QUADRICS = ("sphere", "cylinder", "disk")
_AROUND = 192
_ALONG = 96


class Quadric(NamedTuple):
    """A quadric's mesh, and the quadric's area in object space, which pbrt uses whatever the transformation."""

    mesh: Mesh
    area: float


def whole_sphere(source: Parameters) -> float | None:
    """Returns the radius of a complete sphere; None for partial spheres and other shapes."""
    if source.type != "sphere":
        return None
    radius = _radius(source)
    low, high = source.number("zmin", -radius), source.number("zmax", radius)
    return radius if min(low, high) <= -radius and max(low, high) >= radius and source.number("phimax", 360.0) >= 360 else None


def shape_key(source: Parameters) -> tuple[object, ...]:
    """Returns a key that is equal for quadrics of the same type and dimensions."""
    names = ("radius", "phimax", *(("height", "innerradius") if source.type == "disk" else ("zmin", "zmax")))
    return (source.type, *((name, source.number(name, math.inf)) for name in names))


def quadric(source: Parameters, coarser: int = 1) -> Quadric:
    """Returns the mesh of a quadric. coarser: divisor of the number of segments. Raises SceneError if the shape is empty."""
    radius = _radius(source)
    all_around, along = _AROUND // coarser, _ALONG // coarser
    turn = math.radians(min(max(source.number("phimax", 360.0), 0.0), 360.0))
    around = np.linspace(0, turn, max(int(all_around * turn / (2 * math.pi)), 3) + 1)
    if source.type == "disk":
        return _disk(source, radius, turn, around)
    default = radius if source.type == "sphere" else 1.0
    ends = sorted((source.number("zmin", -default), source.number("zmax", default)))
    if source.type == "sphere":
        low, high = (min(max(z, -radius), radius) for z in ends)
        theta = np.linspace(math.acos(low / radius), math.acos(high / radius), along + 1)
        ring, height = np.sin(theta), np.cos(theta)
        ring[np.abs(height) == 1] = 0
        normals = _surface(ring, height, around)
        positions = normals * radius
    else:
        low, high = ends
        ring, height = np.ones(2), np.array([low, high])
        normals = _surface(ring, np.zeros(2), around)
        positions = _surface(ring * radius, height, around)
    if not high > low or not turn > 0:
        raise source.place.error(
            Sentence(
                "pbrt-quadric-cut-away",
                "zmin, zmax or phimax of {source} leave nothing of it; correct them",
                source=source,
            )
        )
    return Quadric(_mesh(source.type, positions, normals), radius * turn * (high - low))


def _disk(source: Parameters, radius: float, angle: float, around: F64) -> Quadric:
    inner = min(max(source.number("innerradius", 0.0), 0.0), radius)
    height = source.number("height", 0.0)
    if not inner < radius or not angle > 0:
        raise source.place.error(
            Sentence(
                "pbrt-disk-cut-away",
                "innerradius or phimax of {source} leave nothing of it; correct them",
                source=source,
            )
        )
    positions = _surface(np.array([radius, inner]), np.full(2, height), around)
    normals = np.broadcast_to(np.array([0.0, 0.0, 1.0]), positions.shape)
    return Quadric(_mesh("disk", positions, normals), angle / 2 * (radius**2 - inner**2))


def _radius(source: Parameters) -> float:
    radius = source.number("radius", 1.0)
    if not 0 < radius < 1e15:
        raise source.place.error(
            Sentence(
                "pbrt-radius-invalid", "{source} has the radius {radius}; it must be above 0", source=source, radius=f"{radius:g}"
            )
        )
    return radius


def _surface(ring: F64, height: F64, around: F64) -> F64:
    """Returns (R, C, 3) points of a surface of revolution about Z.

    ring, height: (R,) radius and z of each circle of points; around: (C,) angles of the points on each circle.
    """
    x, y = ring[:, None] * np.cos(around), ring[:, None] * np.sin(around)
    return np.stack([x, y, np.broadcast_to(height[:, None], x.shape)], axis=-1)


def _mesh(name: str, positions: F64, normals: F64) -> Mesh:
    rows, columns = positions.shape[:2]
    u, v = np.meshgrid(np.linspace(0, 1, columns), 1 - np.linspace(0, 1, rows))
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1)
    above = corner + columns
    triangles = np.concatenate([np.stack([corner, corner + 1, above + 1], axis=1), np.stack([corner, above + 1, above], axis=1)])
    points = positions.reshape(-1, 3).astype(np.float32)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    solid = (a != b).any(axis=1) & (b != c).any(axis=1) & (c != a).any(axis=1)
    uvs = np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float32)
    shown = np.ascontiguousarray(normals.reshape(-1, 3), np.float32)
    return Mesh(name, points, np.ascontiguousarray(triangles[solid], np.int32), shown, uvs)
