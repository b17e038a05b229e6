"""Converts USD's analytic shapes to meshes: spheres, cubes, cylinders, cones, capsules and planes."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import UsdGeom

from renderer.scene.description import Mesh
from renderer.scene.readers.shapes import cube, lathe, quad

__all__ = ["is_shape", "shape_of"]

_SEGMENTS = 96
_ARC = 32  # segments per arc
_COLUMNS = {"X": [1, 2, 0], "Y": [0, 1, 2], "Z": [2, 0, 1]}  # axis permutations from Y, the axis of `lathe`


def is_shape(prim: Any) -> bool:
    """Returns True if a prim is an analytic shape."""
    kinds = UsdGeom.Sphere, UsdGeom.Cube, UsdGeom.Cylinder, UsdGeom.Cylinder_1, UsdGeom.Cone, UsdGeom.Capsule, UsdGeom.Capsule_1
    return any(prim.IsA(kind) for kind in (*kinds, UsdGeom.Plane))


def shape_of(prim: Any, time: Any) -> Mesh | None:
    """Returns an analytic shape as a mesh in the prim's local space; None if its size is zero."""
    name = prim.GetName()

    def dimension(attribute: str) -> float:
        value = prim.GetAttribute(attribute).Get(time)
        return max(float(value), 0.0) if value is not None and np.isfinite(value) else 0.0

    if prim.IsA(UsdGeom.Cube):
        return _scaled(cube(name), dimension("size") / 2)
    if prim.IsA(UsdGeom.Sphere):
        return _align_to_axis(lathe(name, _arc(dimension("radius"), -1.0, 1.0, 0.0), _SEGMENTS), "Z")
    axis = str(prim.GetAttribute("axis").Get() or "Z")
    if prim.IsA(UsdGeom.Plane):
        plane = quad(name)
        plane.positions = plane.positions * np.array([dimension("width") / 2, dimension("length") / 2, 1], np.float32)
        plane.positions, plane.normals = (_facing(v, axis) for v in (plane.positions, plane.normals))
        return plane
    half = dimension("height") / 2
    if prim.IsA(UsdGeom.Cone):
        radius = dimension("radius")
        profile = [(0.0, -half), (radius, -half), (0.0, half)]
    elif prim.IsA(UsdGeom.Cylinder) or prim.IsA(UsdGeom.Cylinder_1):
        bottom, top = _radii(prim, dimension)
        profile = [(0.0, -half), (bottom, -half), (top, half), (0.0, half)]
    else:
        bottom, top = _radii(prim, dimension)
        profile = _arc(bottom, -1.0, 0.0, -half) + _arc(top, 0.0, 1.0, half)
    profile = [point for i, point in enumerate(profile) if i == 0 or point != profile[i - 1]]
    if len({y for _, y in profile}) < 2 or max(r for r, _ in profile) <= 0:
        return None
    return _align_to_axis(lathe(name, profile, _SEGMENTS), axis)


def _radii(prim: Any, values: Any) -> tuple[float, float]:
    if prim.IsA(UsdGeom.Cylinder_1) or prim.IsA(UsdGeom.Capsule_1):
        return values("radiusBottom"), values("radiusTop")
    return values("radius"), values("radius")


def _arc(radius: float, start: float, end: float, height: float) -> list[tuple[float, float]]:
    angles = np.linspace(start, end, _ARC + 1) * np.pi / 2
    points = [(float(radius * np.cos(a)), float(height + radius * np.sin(a))) for a in angles]
    ends = {0: start, _ARC: end}
    return [(0.0 if abs(ends.get(i, 0.0)) == 1 else r, y) for i, (r, y) in enumerate(points)]


def _facing(vectors: Any, axis: str) -> Any:
    """Rotates vectors of a shape that faces +Z so that it faces the given axis, X, Y or Z.

    The shape's width, along X, stays along X; if the shape faces X, its width goes along Z.
    """
    x, y, z = vectors.T
    turned = {"X": (z, y, -x), "Y": (x, z, -y), "Z": (x, y, z)}[axis]
    return np.ascontiguousarray(np.stack(turned, axis=1), np.float32)


def _scaled(mesh: Mesh, factor: float) -> Mesh | None:
    mesh.positions = mesh.positions * np.float32(factor)
    return mesh if factor > 0 else None


def _align_to_axis(mesh: Mesh, axis: str) -> Mesh:
    columns = _COLUMNS[axis]
    mesh.positions = np.ascontiguousarray(mesh.positions[:, columns])
    if mesh.normals is not None:
        mesh.normals = np.ascontiguousarray(mesh.normals[:, columns])
    return mesh
