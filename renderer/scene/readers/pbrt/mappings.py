"""Maps textures by position rather than by UVs: planar, spherical and cylindrical mappings.

The mapping's coordinates become a mesh's second UV set, with v measured from the top as in the first set.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Mesh, UvTransform, Vec3
from renderer.scene.matrices import Matrix
from renderer.scene.readers.pbrt.parameters import Parameters
from renderer.sentences import Sentence

__all__ = ["UPRIGHT", "Mapping", "mapped", "mapping_of"]

F64 = npt.NDArray[np.float64]
UPRIGHT: UvTransform = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


class Mapping(NamedTuple):
    """A mapping from world space to texture coordinates s and t.

    kind: planar, spherical or cylindrical; of_world: rows of the matrix from world to texture space.
    axes, offsets: for planar mappings, the directions of s and t, and the values of s and t at the origin.
    """

    kind: str
    of_world: tuple[tuple[float, ...], ...]
    axes: tuple[Vec3, Vec3] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    offsets: tuple[float, float] = (0.0, 0.0)

    def uvs(self, points: F64) -> F64:
        """Returns (V, 2) texture coordinates s and t of (V, 3) points in world space."""
        matrix = np.array(self.of_world)
        x, y, z = (points @ matrix[:3, :3].T + matrix[:3, 3]).T
        if self.kind == "planar":
            s, t = (x * a[0] + y * a[1] + z * a[2] + d for a, d in zip(self.axes, self.offsets, strict=True))
        elif self.kind == "spherical":
            s = np.arccos(np.clip(z / np.maximum(np.sqrt(x * x + y * y + z * z), 1e-30), -1, 1)) / math.pi
            t = np.arctan2(y, x) / (2 * math.pi) % 1.0
        else:
            s, t = (math.pi + np.arctan2(y, x)) / (2 * math.pi), z
        return np.stack([s, t], axis=1)

    @property
    def wrapping_coordinate(self) -> int | None:
        """Index of the coordinate that wraps around: 0 for s, 1 for t, None for neither."""
        return {"spherical": 1, "cylindrical": 0}.get(self.kind)


def mapping_of(source: Parameters, ctm: Matrix) -> Mapping | None:
    """Returns the mapping of a texture; None for UV mapping. ctm: transformation at the texture's definition.

    Raises SceneError if the mapping is unknown.
    """
    kind = source.text("mapping", "uv")
    if kind == "uv":
        return None
    if kind not in ("planar", "spherical", "cylindrical"):
        raise source.place.error(
            Sentence(
                "pbrt-mapping-unknown",
                "{source} has the mapping {kind}; known are uv, planar, spherical and cylindrical",
                source=source,
                kind=repr(kind[:30]),
            )
        )
    of_world = tuple(tuple(float(v) for v in row) for row in np.linalg.pinv(ctm))
    if kind != "planar":
        return Mapping(kind, of_world)
    axes = source.vector("v1", (1.0, 0.0, 0.0)), source.vector("v2", (0.0, 1.0, 0.0))
    return Mapping(kind, of_world, axes, (source.number("udelta", 0.0), source.number("vdelta", 0.0)))


def mapped(mesh: Mesh, mapping: Mapping, ctm: Matrix) -> Mesh:
    """Returns the mesh with the mapping's coordinates as its second UV set. ctm: from object to world space."""
    points = mesh.positions.astype(np.float64) @ ctm[:3, :3].T + ctm[:3, 3]
    found = mapping.uvs(points)
    if mapping.wrapping_coordinate is not None:
        mesh, found = _split_at_seam(mesh, found, mapping.wrapping_coordinate)
    return replace(mesh, uvs1=np.stack([found[:, 0], 1 - found[:, 1]], axis=1).astype(np.float32))


def _split_at_seam(mesh: Mesh, found: F64, around: int) -> tuple[Mesh, F64]:
    """Duplicates vertices of triangles that cross the line where a coordinate wraps around; there, that coordinate may exceed 1.

    found: (V, 2) coordinates of the mesh's vertices; around: index of the coordinate that wraps around. Returns the mesh and the
    coordinates of its vertices.
    """
    turns = found[mesh.triangles, around]
    across = np.flatnonzero(np.ptp(turns, axis=1) > 0.5)
    if len(across) == 0:
        return mesh, found
    corners = mesh.triangles[across].reshape(-1)
    own = found[corners].copy()
    own[:, around] += own[:, around] < 0.5
    triangles = mesh.triangles.copy()
    triangles[across] = np.arange(len(found), len(found) + len(corners), dtype=np.int32).reshape(-1, 3)

    def with_added_vertices(values: npt.NDArray[np.float32] | None) -> npt.NDArray[np.float32] | None:
        return None if values is None else np.concatenate([values, values[corners]])

    positions = np.concatenate([mesh.positions, mesh.positions[corners]])
    mesh = replace(
        mesh,
        positions=positions,
        triangles=triangles,
        normals=with_added_vertices(mesh.normals),
        uvs=with_added_vertices(mesh.uvs),
    )
    return mesh, np.concatenate([found, own])
