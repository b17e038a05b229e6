"""Converts hair, fur and wire curves to fibres, tubes or ribbons in one mesh."""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.description import Mesh
from renderer.scene.readers import tubes as shapes
from renderer.scene.readers.polylines import by_stride
from renderer.scene.readers.tubes import (
    BASES,
    MAX_STEPS,
    MAX_VERTICES,
    STEPS,
    Tubes,
    elliptic,
    fineness_of,
    ribbons,
    sides_of,
    tubes,
    tubes_mesh,
)
from renderer.sentences import Sentence

__all__ = ["Strand", "line_of", "strands_mesh"]

F64 = npt.NDArray[np.float64]


class Strand(NamedTuple):
    """A curve: a tube, or a ribbon.

    facing: the directions across it that a ribbon faces; None for a tube. steps: lines for each segment of the curve, of which a
    fibre that is nearly straight keeps fewer.
    """

    points: F64  # (S, 3) along it
    radii: F64  # (S,)
    facing: F64 | None = None  # (S, 3)
    steps: int = 1


def line_of(points: F64, basis: str, steps: int = STEPS) -> F64:
    """Returns sampled points along a cubic curve, `steps` lines per segment.

    points: (N, D) control points; basis: bezier or bspline.
    """
    step = 3 if basis == "bezier" else 1
    first = np.arange(0, len(points) - 3, step)
    parts = np.einsum("uk,skx->sux", _weights(basis, steps), points[first[:, None] + np.arange(4)])
    return np.concatenate([parts[:, :-1].reshape(-1, points.shape[1]), parts[-1:, -1]])


@functools.cache
def _weights(basis: str, steps: int) -> F64:
    """Returns (steps + 1, 4) the weights of a segment's control points along it."""
    u = np.linspace(0, 1, steps + 1)
    return np.asarray(np.stack([u**k for k in range(4)], axis=1) @ BASES[basis])


_LEAST_SIDES = 6  # of an ellipse


def strands_mesh(strands: list[Strand], fibres: bool = False, aspect: float = 1.0) -> Mesh:
    """Returns one mesh with a tube or ribbon for each curve; with many curves, tubes have fewer sides.

    fibres: whether they are fibres of hair (tubes.py), which are segments of round curves; with an aspect ratio below 1, tubes
    whose cross-sections are ellipses. Raises SceneError if they have too many points.
    """
    groups: dict[tuple[int, bool, int], list[Strand]] = {}
    for strand in strands:
        groups.setdefault((len(strand.points), strand.facing is None or fibres, strand.steps), []).append(strand)
    sides, vertices = max(sides_of(len(strands), fibres), _LEAST_SIDES if aspect < 1 else 0), 0
    if sum(samples for samples, *_ in groups) > MAX_STEPS:
        raise _too_many(strands)
    around = 1 if fibres and aspect >= 1 else sides
    pieces: list[Tubes] = []
    for (samples, is_round, steps), group in groups.items():
        lines, radii = np.stack([strand.points for strand in group]), np.stack([strand.radii for strand in group])
        alike = [(np.arange(len(group)), slice(None))]
        if fibres:
            alike = list(by_stride(lines, radii, steps, *fineness_of(len(strands))))
        vertices += sum(len(k) * len(range(samples)[kept]) for k, kept in alike) * (around if is_round else 2)
        if vertices > MAX_VERTICES:
            raise _too_many(strands)
        if fibres and aspect >= 1:
            pieces += [shapes.fibres(lines[k, kept], radii[k, kept], None) for k, kept in alike]
        elif is_round:
            pieces += [tubes(lines[k, kept], radii[k, kept], None, sides, fibres) for k, kept in alike]
        else:
            facing = np.stack([strand.facing for strand in group if strand.facing is not None])
            pieces.append(ribbons(lines, radii, facing, None))
    mesh = tubes_mesh("curves", pieces)
    return elliptic(mesh, sides, aspect) if fibres and aspect < 1 else mesh


def _too_many(strands: list[Strand]) -> SceneError:
    return SceneError(
        Sentence(
            "curves-too-many",
            "{curves} curves with {points} points after subdivision are too many; export fewer or shorter ones",
            curves=len(strands),
            points=sum(len(strand.points) for strand in strands),
        )
    )
