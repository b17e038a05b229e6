"""Converts point clouds to small spheres at the points, all in one mesh."""

from __future__ import annotations

from itertools import combinations
from pathlib import PurePosixPath

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.description import F32, Instance, Material, Mesh, SceneDescription
from renderer.scene.readers.colors import vertex_colors
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["MOST_POINTS", "add_points", "spacing", "sphere_mesh"]

MOST_POINTS = 1_000_000
# (greatest number of points, refinements of the icosahedron of each point); larger clouds have octahedra
_REFINEMENTS = ((2_500, 2), (25_000, 1), (200_000, 0))
_SAMPLES = 48
_GOLDEN = (1 + 5**0.5) / 2


def _icosahedron() -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    a, b = 1.0, _GOLDEN
    corners = [(0, s * a, t * b) for s in (-1, 1) for t in (-1, 1)]
    points = np.array([*corners, *((y, z, x) for x, y, z in corners), *((z, x, y) for x, y, z in corners)], np.float64)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    near = np.linalg.norm(points[:, None] - points[None], axis=2) < 1.1
    faces = [(i, j, k) for i, j, k in combinations(range(12), 3) if near[i, j] and near[j, k] and near[i, k]]
    return points, _outwards(points, np.array(faces))


def _octahedron() -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    points = np.concatenate([np.eye(3), -np.eye(3)])
    faces = [(i, j, k) for i in (0, 3) for j in (1, 4) for k in (2, 5)]
    return points, _outwards(points, np.array(faces))


def _refined(
    points: npt.NDArray[np.float64], faces: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Returns a sphere with four triangles for each, whose new corners are on the unit sphere."""
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    codes, middle = np.unique(ends.min(axis=1) * len(points) + ends.max(axis=1), return_inverse=True)
    new = points[codes // len(points)] + points[codes % len(points)]
    x, y, z = new.T
    (a, b, c), (ab, bc, ca) = faces.T, (len(points) + middle).reshape(-1, 3).T
    finer = np.concatenate([np.stack(three, axis=1) for three in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return np.concatenate([points, new / np.sqrt(x * x + y * y + z * z)[:, None]]), finer


def _ball(count: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Returns the corners and faces of the unit sphere for each point of a cloud of `count` points."""
    levels = next((levels for most, levels in _REFINEMENTS if count <= most), None)
    if levels is None:
        return _octahedron()
    ball = _icosahedron()
    for _ in range(levels):
        ball = _refined(*ball)
    return ball


def _outwards(points: npt.NDArray[np.float64], faces: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    a, b, c = (points[faces[:, k]] for k in range(3))
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    return np.where(inwards[:, None], faces[:, ::-1], faces)


def spacing(points: F32) -> float:
    """Returns the median distance from sampled points to their nearest neighbours; 0 if all points coincide."""
    if len(points) < 2:
        return 0.0
    chosen = np.linspace(0, len(points) - 1, min(_SAMPLES, len(points))).astype(np.int64)
    found = []
    for i in chosen:
        apart = points - points[i]
        square = np.einsum("ij,ij->i", apart, apart)
        others = square[square > 0]
        found += [float(others.min())] if len(others) else []
    return float(np.sqrt(np.median(found))) if found else 0.0


def sphere_mesh(
    name: str, points: F32, colors: npt.NDArray[np.uint8] | F32 | None, radius: float | None = None
) -> tuple[Mesh, float]:
    """Returns a mesh with a sphere at each of (P, 3) points, and the spheres' radius, by default the spacing of the points.

    colors: (P, 3 or 4) sRGB, as 8-bit integers or fractions, or None.
    """
    corners, faces = _ball(len(points))
    extent = float(np.ptp(points, axis=0).max(initial=0.0))
    radius = radius or spacing(points) or extent / 100 or 0.01
    positions = (points[:, None] + np.float32(radius) * corners.astype(np.float32)[None]).reshape(-1, 3)
    step = np.arange(len(points))[:, None, None] * len(corners)
    triangles = (faces[None] + step).reshape(-1, 3).astype(np.int32)
    normals = np.tile(corners.astype(np.float32), (len(points), 1))
    linear = None if colors is None else vertex_colors(colors)
    shown = None if linear is None else np.repeat(linear, len(corners), axis=0)
    return Mesh(name, positions, triangles, normals, colors=shown), radius


def add_points(
    points: F32,
    colors: npt.NDArray[np.uint8] | F32 | None,
    place: npt.NDArray[np.float64],
    main: str,
    description: SceneDescription,
    shelf: TextureShelf,
) -> None:
    """Adds a file's points to the description, as spheres. Very many points are subsampled.

    points: (P, 3); colors: (P, 3 or 4) sRGB, or None; place: (4, 4) transform. Raises SceneError if no point is finite.
    """
    chosen = np.isfinite(points).all(axis=1)
    count = int(chosen.sum())
    if count == 0:
        raise SceneError(
            Sentence(
                "mesh-positions-not-finite",
                "{file} has positions that are not finite numbers; export the file again",
                file=main,
            )
        )
    step = -(-count // MOST_POINTS)
    rows = np.flatnonzero(chosen)[::step]
    mesh, radius = sphere_mesh(PurePosixPath(main).stem, points[rows], None if colors is None else colors[rows])
    description.materials.append(Material("points", base_color=(1.0, 1.0, 1.0) if mesh.colors is not None else (0.8, 0.8, 0.8)))
    mesh.material = len(description.materials) - 1
    description.meshes.append(mesh)
    description.instances.append(Instance(len(description.meshes) - 1, place, name=mesh.name))
    shelf.warn(
        Sentence(
            "points-shown-as-spheres",
            "{file} has points and no faces; {shown} of {count} points are shown as spheres of radius {radius}.",
            file=main,
            shown=len(rows),
            count=count,
            radius=f"{radius:.3g}",
        )
    )
