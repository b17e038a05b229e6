"""Mitsuba's analytic shapes as meshes with Mitsuba's UVs; an image's first row is at v = 0.

Tangents define the frame of normal maps, which in Mitsuba is right-handed for either direction of v. Source: Mitsuba's
documentation of shapes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Mesh
from renderer.scene.readers import shapes

__all__ = ["cube", "disk", "rectangle", "sphere", "tube"]

_SEGMENTS = 256
_TUBE = 192
_RINGS = 64
_Y_TO_Z = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], np.float32)
# For each face of the cube: first corner, direction to the second (along u), direction from second to third (against v).
_FACES = (
    ((1, -1, -1), (0, 0, 1), (-1, 0, 0)),
    ((1, 1, -1), (-1, 0, 0), (0, 0, 1)),
    ((1, -1, -1), (0, 1, 0), (0, 0, 1)),
    ((1, -1, 1), (0, 1, 0), (-1, 0, 0)),
    ((-1, -1, 1), (0, 1, 0), (0, 0, -1)),
    ((1, 1, -1), (0, -1, 0), (-1, 0, 0)),
)


def rectangle(name: str) -> Mesh:
    """Returns the square -1..1 in x and y, facing +Z."""
    mesh = shapes.quad(name)
    return _with_tangents(
        replace(mesh, uvs=((mesh.positions[:, :2] + 1) / 2).astype(np.float32)), np.tile(np.array([1, 0, 0], np.float32), (4, 1))
    )


def cube(name: str) -> Mesh:
    """Returns the cube -1..1; each face shows the whole texture."""
    positions, along = [], []
    for first, u, v in np.array(_FACES, np.float32):
        positions.append([first, first + 2 * u, first + 2 * u + 2 * v, first + 2 * v])
        along.append([u] * 4)
    points = np.array(positions, np.float32).reshape(-1, 3)
    normals = np.cross(np.array([f[1] for f in _FACES]), np.array([f[2] for f in _FACES])).astype(np.float32)
    triangles = np.concatenate([np.array([(0, 1, 2), (3, 0, 2)], np.int32) + 4 * i for i in range(6)])
    uvs = np.tile(np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32), (6, 1))
    return _with_tangents(
        Mesh(name, points, triangles, np.repeat(normals, 4, axis=0), uvs), np.array(along, np.float32).reshape(-1, 3)
    )


def disk(name: str) -> Mesh:
    """Returns the disk of radius 1, facing +Z; u increases from the centre to the rim, v once around."""
    turn = np.arange(_SEGMENTS + 1) / _SEGMENTS
    rim = np.column_stack([np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn), np.zeros(len(turn))])
    rim[-1] = rim[0]
    points = np.concatenate([np.zeros((_SEGMENTS, 3)), rim]).astype(np.float32)
    i = np.arange(_SEGMENTS)
    triangles = np.column_stack([i, _SEGMENTS + i, _SEGMENTS + i + 1]).astype(np.int32)
    uvs = np.concatenate([np.column_stack([0 * i, (i + 0.5) / _SEGMENTS]), np.column_stack([np.ones(len(turn)), turn])])
    normals = np.tile(np.array([0, 0, 1], np.float32), (len(points), 1))
    return Mesh(name, points, triangles, normals, uvs.astype(np.float32))


def tube(name: str) -> Mesh:
    """Returns an open cylinder of radius 1 about Z, from z = 0 to 1, facing outwards; v increases upwards."""
    mesh = _upright(shapes.lathe(name, [(1.0, 0.0), (1.0, 1.0)], _TUBE))
    assert mesh.uvs is not None
    return replace(mesh, uvs=np.column_stack([mesh.uvs[:, 0], 1 - mesh.uvs[:, 1]]).astype(np.float32))


def sphere(name: str) -> Mesh:
    """Returns the sphere of radius 1; v increases from the pole at +Z downwards."""
    turns = np.linspace(-np.pi / 2, np.pi / 2, _RINGS + 1)
    return _upright(shapes.lathe(name, [(float(np.cos(t)), float(np.sin(t))) for t in turns], 2 * _RINGS))


def _upright(mesh: Mesh) -> Mesh:
    """Returns a mesh that is symmetric about the Y axis, rotated so that its axis is Z and u starts at +X."""
    assert mesh.uvs is not None
    normals = None if mesh.normals is None else np.ascontiguousarray(mesh.normals @ _Y_TO_Z.T)
    uvs = (mesh.uvs - np.array([0.25, 0], np.float32)).astype(np.float32)
    return replace(mesh, positions=np.ascontiguousarray(mesh.positions @ _Y_TO_Z.T), normals=normals, uvs=uvs)


def _with_tangents(mesh: Mesh, along: npt.NDArray[np.float32]) -> Mesh:
    """Returns the mesh with the tangents `along`, signed so that normal, tangent and bitangent form right-handed frames."""
    return replace(mesh, tangents=np.column_stack([along, np.ones(len(along))]).astype(np.float32))
