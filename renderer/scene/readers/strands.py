"""Converts hair, fur and wire curves to tubes in one mesh."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Mesh
from renderer.scene.readers.tubes import BASES, STEPS, tubes

__all__ = ["Strand", "line_of", "strands_mesh"]

F64 = npt.NDArray[np.float64]
Strand = tuple[F64, F64]  # (S, 3) points along it, and (S,) radii
_MAX_FINE_CURVES = 500  # up to this many curves get more sides


def line_of(points: F64, basis: str) -> F64:
    """Returns sampled points along a cubic curve. points: (N, D) control points; basis: bezier or bspline."""
    step = 3 if basis == "bezier" else 1
    first = np.arange(0, len(points) - 3, step)
    u = np.linspace(0, 1, STEPS + 1)
    weights = np.stack([u**k for k in range(4)], axis=1) @ BASES[basis]
    parts = np.einsum("uk,skx->sux", weights, points[first[:, None] + np.arange(4)])
    return np.concatenate([parts[:, :-1].reshape(-1, points.shape[1]), parts[-1:, -1]])


def strands_mesh(strands: list[Strand]) -> Mesh:
    """Returns one mesh with a tube for each curve; with many curves, tubes have fewer sides."""
    sides = 12 if len(strands) <= _MAX_FINE_CURVES else 4
    groups: dict[int, list[Strand]] = {}
    for strand in strands:
        groups.setdefault(len(strand[0]), []).append(strand)
    positions, normals, triangles, first = [], [], [], 0
    for group in groups.values():
        lines, radii = (np.stack([strand[k] for strand in group]) for k in (0, 1))
        points, out, _, faces = tubes(lines, radii, None, sides)
        positions.append(points)
        normals.append(out)
        triangles.append(faces + first)
        first += len(points)
    return Mesh(
        "curves",
        np.concatenate(positions).astype(np.float32),
        np.concatenate(triangles).astype(np.int32),
        np.concatenate(normals).astype(np.float32),
    )
