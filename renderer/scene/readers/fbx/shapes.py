"""Deforms FBX meshes, first by blend shapes, then by skins."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32
from renderer.scene.kernel_arguments import read_only
from renderer.scene.normals import corner_angles, face_normals
from renderer.scene.readers.fbx import layout
from renderer.scene.readers.fbx.library import array, each, matrix, pointed, struct_at
from renderer.scene.readers.fbx.meshes import Part
from renderer.scene.readers.skinning import carried

__all__ = ["Skin", "blended", "updated_normals"]

F64 = npt.NDArray[np.float64]

MOST_JOINTS = 16  # per vertex, in order of descending weight


def blended(mesh: Any) -> tuple[F64, F64 | None]:
    """Returns (P, 3) points of a mesh with its blend shapes applied, and the (P, 3) offsets of its normals or None."""
    points = array(mesh.vertices, np.float64, 3).copy()
    turned: F64 | None = None
    for deformer in pointed(mesh.blends, layout.BlendDeformer):
        for channel in pointed(deformer.channels, layout.BlendChannel):
            for key in each(channel.keyframes, layout.BlendKeyframe):
                shape = struct_at(layout.BlendShape, key.shape)
                if shape is None or key.weight == 0:
                    continue
                where = array(shape.vertices, np.uint32)
                moved = array(shape.positions, np.float64, 3)
                count = min(len(where), len(moved))
                kept = where[:count] < len(points)
                np.add.at(points, where[:count][kept], key.weight * moved[:count][kept])
                bent = array(shape.normals, np.float64, 3)
                if len(bent) == len(where) and bent.any():
                    turned = np.zeros_like(points) if turned is None else turned
                    np.add.at(turned, where[kept], key.weight * bent[kept])
    return points, turned


def updated_normals(part: Part, before: F64, after: F64) -> F32 | None:
    """Returns a part's normals after the mesh's points moved from `before` to `after`.

    To each normal is added the change of the smooth normal (see `_smooth`) at its vertex.
    """
    if part.normals is None or np.array_equal(before, after):
        return part.normals
    old, new = (_smooth(points[part.point], part) for points in (before, after))
    return (part.normals + (new - old)).astype(np.float32)


def _smooth(positions: F64, part: Part) -> F64:
    """Returns (V, 3) unit normals: the mean of each vertex's triangle normals, weighted by the angles at the vertex."""
    faces = face_normals(positions, part.triangles)
    length = np.linalg.norm(faces, axis=1, keepdims=True)
    unit = np.divide(faces, length, out=np.zeros_like(faces), where=length > 0)
    share = unit[:, None, :] * corner_angles(positions.astype(np.float32), part.triangles)[..., None]
    total = np.zeros((len(positions), 3))
    for axis in range(3):
        total[:, axis] = np.bincount(part.triangles.reshape(-1), share[..., axis].reshape(-1), len(positions))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.divide(total, length, out=np.zeros_like(total), where=length > 0)


class Skin:
    """The joints of a mesh's points, and their weights; points without weights follow the node that has the mesh."""

    def __init__(self, deformer: Any) -> None:
        clusters = pointed(deformer.clusters, layout.SkinCluster)
        rows = array(deformer.vertices, np.uint32, 4)  # columns: begin, count, a float64
        weights = array(deformer.weights, np.uint32, 4)  # columns: cluster, unused, a float64
        begin, count = rows[:, 0].astype(np.int64), np.minimum(rows[:, 1].astype(np.int64), MOST_JOINTS)
        width = int(count.max(initial=0)) + 1
        self._rest = len(clusters)
        self.joints = np.full((len(rows), width), self._rest, np.int64)
        self.weights = np.zeros((len(rows), width), np.float32)
        values = np.ascontiguousarray(weights[:, 2:]).view(np.float64).reshape(-1)
        for k in range(width - 1):
            has = np.flatnonzero((count > k) & (begin + k < len(weights)))
            self.joints[has, k] = np.minimum(weights[begin[has] + k, 0], self._rest)
            self.weights[has, k] = values[begin[has] + k]
        self.weights[self.weights.sum(axis=1) <= 0, -1] = 1.0

    @staticmethod
    def joint_transforms(deformer: Any, node: F64) -> F64:
        """Returns (J + 1, 4, 4) transforms from mesh space to world space: one per joint, then that of the node with the mesh.

        node: (4, 4) world transform of that node.
        """
        clusters = pointed(deformer.clusters, layout.SkinCluster)
        return np.stack([*(matrix(cluster.geometry_to_world) for cluster in clusters), node])

    def deformed(self, part: Part, points: F64, normals: F32 | None, places: F64) -> tuple[npt.NDArray[Any], F32 | None]:
        """Returns a part's positions and normals in world space. places: (J + 1, 4, 4) matrices from `joint_transforms`."""
        none = np.zeros((0, 3), np.float32)
        old = none if normals is None else normals
        turned = np.empty(old.shape, np.float32)
        point = np.minimum(part.point, len(self.joints) - 1)
        placed = carried(
            read_only(places),
            *(read_only(np.ascontiguousarray(a)) for a in (self.joints[point], self.weights[point])),
            *(read_only(np.ascontiguousarray(a, np.float32)) for a in (points[part.point], old, none)),
            turned=turned,
            bent=none.copy(),
        )
        return placed, None if normals is None else turned
