"""Functions shared by the readers of polygon files: triangulation, per-corner values and colours."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.deduplicate import unique_corners, used_among
from renderer.scene.description import F32, I32, Mesh
from renderer.scene.polygons import Triangulation, triangulate
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["fractions", "of_triangles", "triangulated", "with_corner_values", "without_bad_vertices"]

Array = npt.NDArray[Any]


def triangulated(
    counts: Array, corners: Array, positions: npt.NDArray[np.floating], main: str, shelf: TextureShelf
) -> Triangulation:
    """Triangulates polygons (see `triangulate`), without those that have non-finite vertices; warns with their number.

    counts: corners per polygon; corners: vertex indices of all polygons, concatenated. Raises SceneError if a face refers to a
    vertex that does not exist, or if no face remains.
    """
    if len(corners) and (corners.min() < 0 or corners.max() >= len(positions)):
        odd = corners.min() if corners.min() < 0 else corners.max()
        raise SceneError(
            Sentence(
                "face-vertex-out-of-range",
                "{name}: a face refers to vertex {vertex}, but there are {count}; export the file again",
                name=main,
                vertex=odd,
                count=len(positions),
            )
        )
    finite = np.all(np.isfinite(positions), axis=1)
    if finite.all():
        cut = triangulate(counts, corners, positions)
    else:
        shown = np.bincount(np.repeat(np.arange(len(counts)), counts), finite[corners], len(counts)) == counts
        cut = triangulate(counts, corners, np.where(finite[:, None], positions, np.float32(0)))
        whole = shown[cut.face]
        if not whole.any():
            raise SceneError(
                Sentence(
                    "mesh-positions-not-finite",
                    "{file} has positions that are not finite numbers; export the file again",
                    file=main,
                )
            )
        cut = Triangulation(cut.triangles[whole], cut.face[whole], cut.unfilled)
        shelf.warn(
            Sentence(
                "mesh-vertices-not-finite",
                "{file}: {count} vertices have positions that are not finite; {faces} faces that use them are left out.",
                file=main,
                count=(~finite).sum(),
                faces=(~shown).sum(),
            )
        )
    if thin := int((np.asarray(counts) < 3).sum()):
        shelf.warn(
            Sentence(
                "mesh-faces-degenerate",
                "{file}: {count} faces have fewer than three corners and are left out.",
                file=main,
                count=thin,
            )
        )
    if cut.unfilled:
        shelf.warn(
            Sentence(
                "mesh-concave-polygons-uncut",
                "{file}: {count} concave polygons have too many corners and are filled as if convex.",
                file=main,
                count=cut.unfilled,
            )
        )
    return cut


def without_bad_vertices(mesh: Mesh) -> Mesh:
    """Returns the mesh unchanged if all vertices are finite, otherwise without its unused vertices.

    No triangle may use a non-finite vertex, so these are removed as well.
    """
    if np.isfinite(mesh.positions).all():
        return mesh
    return of_triangles(mesh, slice(None))


def of_triangles(mesh: Mesh, rows: Any) -> Mesh:
    """Returns a mesh of some triangles of a mesh, with only the vertices that they use.

    rows: index array or slice that selects the triangles.
    """
    at, triangles = used_among(mesh.triangles[rows], len(mesh.positions))
    normals, uvs, uvs1, colors = (
        None if values is None else values[at] for values in (mesh.normals, mesh.uvs, mesh.uvs1, mesh.colors)
    )
    return Mesh(mesh.name, mesh.positions[at], triangles.astype(np.int32), normals, uvs, mesh.material, uvs1, colors)


def with_corner_values(mesh: Mesh, uvs: F32 | None, colors: F32 | None) -> Mesh:
    """Returns the mesh with UVs and colours given per corner; a vertex whose corners have different values is duplicated.

    uvs, colors: (3 T, w) values by corner; None retains those of the mesh.
    """
    corners = mesh.triangles.reshape(-1)
    given = [values for values in (uvs, colors) if values is not None]
    first, kind = unique_corners(corners, len(mesh.positions), given)
    at = corners[first]

    def pick(own: F32 | None, values: F32 | None) -> F32 | None:
        return values[first] if values is not None else None if own is None else own[at]

    triangles: I32 = kind.reshape(-1, 3)
    normals = None if mesh.normals is None else mesh.normals[at]
    return Mesh(mesh.name, mesh.positions[at], triangles, normals, pick(mesh.uvs, uvs), colors=pick(mesh.colors, colors))


def fractions(values: Array) -> F32:
    """Returns colour values as fractions, 0..1.

    16-bit integers are divided by their maximum, other integers by 255, floats by 255 if any exceeds 1.
    """
    if values.dtype.kind != "f":
        most = float(np.iinfo(values.dtype).max) if values.dtype.itemsize == 2 else 255.0
    else:
        most = 255.0 if values.max(initial=0.0) > 1.0 else 1.0
    return np.clip(np.nan_to_num(values.astype(np.float64) / most), 0, 1).astype(np.float32)
