"""Converts hair, fur and wire curves to tubes in one mesh."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Mesh
from renderer.scene.readers.tubes import BASES, STEPS, sides_of, tubes, tubes_mesh

__all__ = ["Strand", "line_of", "strands_mesh"]

F64 = npt.NDArray[np.float64]
Strand = tuple[F64, F64]  # (S, 3) points along it, and (S,) radii


def line_of(points: F64, basis: str, steps: int = STEPS) -> F64:
    """Returns sampled points along a cubic curve, `steps` lines per segment.

    points: (N, D) control points; basis: bezier or bspline.
    """
    step = 3 if basis == "bezier" else 1
    first = np.arange(0, len(points) - 3, step)
    u = np.linspace(0, 1, steps + 1)
    weights = np.stack([u**k for k in range(4)], axis=1) @ BASES[basis]
    parts = np.einsum("uk,skx->sux", weights, points[first[:, None] + np.arange(4)])
    return np.concatenate([parts[:, :-1].reshape(-1, points.shape[1]), parts[-1:, -1]])


def strands_mesh(strands: list[Strand], fibres: bool = False) -> Mesh:
    """Returns one mesh with a tube for each curve; with many curves, tubes have fewer sides. fibres: of hair (tubes.py)."""
    groups: dict[int, list[Strand]] = {}
    for strand in strands:
        groups.setdefault(len(strand[0]), []).append(strand)
    pieces, sides = [], sides_of(len(strands), fibres)
    for group in groups.values():
        lines, radii = (np.stack([strand[k] for strand in group]) for k in (0, 1))
        pieces.append(tubes(lines, radii, None, sides, fibres))
    return tubes_mesh("curves", pieces)
