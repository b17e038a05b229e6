"""Built-in meshes of scene files, in object space. All face outwards, counter-clockwise, as Mitsuba's shapes do.

quad: -1..1 in x and y, facing +Z. disk: radius 1, facing +Z. cube: -1..1.
"""

from __future__ import annotations

import numpy as np

from renderer.scene.description import Mesh
from renderer.scene.normals import smoothed

__all__ = ["cube", "disk", "globe", "lathe", "quad"]

_CORNERS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], np.float32)
_CORNER_UVS = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32)
_TWO_TRIANGLES = np.array([(0, 1, 2), (0, 2, 3)], np.int32)


def quad(name: str) -> Mesh:
    """Returns the square -1..1 in x and y; its texture is upright as seen from +Z."""
    positions = np.column_stack([_CORNERS, np.zeros(4, np.float32)])
    normals = np.tile(np.array([0, 0, 1], np.float32), (4, 1))
    return Mesh(name, positions, _TWO_TRIANGLES, normals, _CORNER_UVS)


def disk(name: str, segments: int = 256) -> Mesh:
    """Returns the unit disk as a triangle fan; with 256 segments its area is 0.01 % below that of the circle."""
    angle = np.arange(segments) * (2 * np.pi / segments)
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    flat = np.concatenate([np.zeros((1, 2)), rim])
    positions = np.column_stack([flat, np.zeros(len(flat))]).astype(np.float32)
    i = np.arange(segments)
    triangles = np.column_stack([np.zeros_like(i), 1 + i, 1 + (i + 1) % segments]).astype(np.int32)
    uvs = np.column_stack([0.5 + 0.5 * flat[:, 0], 0.5 - 0.5 * flat[:, 1]]).astype(np.float32)
    return Mesh(name, positions, triangles, np.tile(np.array([0, 0, 1], np.float32), (len(flat), 1)), uvs)


def cube(name: str) -> Mesh:
    """Returns the cube -1..1; each face shows the whole texture."""
    positions, normals = [], []
    square = np.column_stack([_CORNERS, np.ones(4, np.float32)])
    # Columns of the rotation from +Z to each face's normal.
    for x, y, z in (
        ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),
        ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
        ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
        ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
        ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    ):
        positions.append(square @ np.array([x, y, z], np.float32))
        normals.append(np.tile(np.array(z, np.float32), (4, 1)))
    triangles = np.concatenate([_TWO_TRIANGLES + 4 * i for i in range(6)]).astype(np.int32)
    return Mesh(name, np.concatenate(positions), triangles, np.concatenate(normals), np.tile(_CORNER_UVS, (6, 1)))


def globe(name: str) -> Mesh:
    """Returns the unit sphere as a mesh of 256 by 128 quads, with the UVs of the analytic sphere.

    For materials that displace it, which the analytic sphere cannot be.
    """
    angles = np.linspace(-np.pi / 2, np.pi / 2, 129)
    ends = {0: 0.0, 128: 0.0}
    mesh = lathe(name, [(ends.get(i, float(np.cos(a))), float(np.sin(a))) for i, a in enumerate(angles)], 256)
    assert mesh.uvs is not None
    mesh.uvs[:, 0] = 1 - mesh.uvs[:, 0]
    return mesh


def lathe(name: str, profile: list[tuple[float, float]], segments: int = 96) -> Mesh:
    """Returns the surface of revolution about Y of a profile of (radius, y) points, smooth except at sharp bends.

    It faces outwards if the profile goes from bottom to top. u goes once around; v goes from 0 at the last point to 1 at the
    first.
    """
    points = np.array(profile, np.float64)
    points[:, 0] = np.abs(points[:, 0])
    along = np.r_[0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    angle = np.arange(segments + 1) * (2 * np.pi / segments)
    radius, height = points[:, 0][:, None], points[:, 1][:, None]
    ring = np.stack(
        [radius * np.sin(angle), np.broadcast_to(height, (len(points), segments + 1)), radius * np.cos(angle)], axis=-1
    )
    ring[:, -1] = ring[:, 0]  # exactly equal, so that normals are smooth over the seam
    uvs = np.stack(np.broadcast_arrays(angle / (2 * np.pi), 1 - (along / max(along[-1], 1e-30))[:, None]), axis=-1)
    row = segments + 1
    corner = (np.arange(len(points) - 1)[:, None] * row + np.arange(segments)).reshape(-1)
    below, right, above = corner, corner + 1, corner + row
    triangles = np.concatenate([np.stack([below, right, above + 1], 1), np.stack([below, above + 1, above], 1)])
    positions = ring.reshape(-1, 3).astype(np.float32)
    corners = positions[triangles]
    solid = (corners != np.roll(corners, 1, axis=1)).any(axis=2).all(axis=1)  # at the poles one edge has no length
    return smoothed(Mesh(name, positions, triangles[solid].astype(np.int32), None, uvs.reshape(-1, 2).astype(np.float32)))
