"""Converts hair curves to thin tubes: a ring of a few vertices around each point, with normals that make it look round."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["MOST_POINTS", "Tubes", "tubes"]

F32 = npt.NDArray[np.float32]
SIDES = 6
WIDENED = float(np.pi / SIDES / np.sin(np.pi / SIDES))  # a ring has the circumference of the round fibre
MOST_POINTS = 1_000_000
LEAST_ACROSS = 1e-3  # of a direction across the hair, when it is made perpendicular to it
MOST_ACROSS = 1e3  # curves without length have normals that are not unit


class Tubes(NamedTuple):
    """Tubes as triangles. fibres: each vertex's unit direction along the hair, and the hair's diameter."""

    positions: F32  # (V, 3)
    normals: F32  # (V, 3)
    triangles: npt.NDArray[np.int32]  # (T, 3)
    fibres: F32  # (V, 4)


def tubes(points: F32, radii: F32, first: npt.NDArray[np.int32], across: F32 | None = None) -> Tubes:
    """Returns the tubes of strands of hair.

    points: (P, 3), radii: (P,), strand by strand. first: (S + 1,) start index of each strand, followed by P. Strands of one point
    are omitted. across: (P, 3), directions in which the first vertex of each ring is to lie; None for any.
    """
    strand = np.repeat(np.arange(len(first) - 1), np.diff(first))
    is_last = np.zeros(len(points), bool)
    is_last[first[1:] - 1] = True
    follows = np.where(is_last, np.arange(len(points)), np.arange(len(points)) + 1)
    starts = np.zeros(len(points), bool)
    starts[first[:-1]] = True
    before = np.where(starts, np.arange(len(points)), np.arange(len(points)) - 1)
    along = _unit(points[follows] - points[before])
    # For each strand the axis along which it extends least: successive rings rotate only as the strand bends.
    reach = np.abs(points[first[1:] - 1] - points[first[:-1]])
    away = np.eye(3, dtype=np.float32)[np.argmin(reach, axis=1)][strand]
    side = _unit(np.cross(along, away))
    if across is not None:
        across = np.where(np.abs(across) < MOST_ACROSS, across, 0.0)
        towards = across - along * (across * along).sum(axis=1, keepdims=True)
        length = np.linalg.norm(towards, axis=1, keepdims=True)
        is_sound = length > LEAST_ACROSS
        side = np.where(is_sound, towards / np.where(is_sound, length, 1), side)
    up = np.cross(side, along)
    turn = 2 * np.pi * np.arange(SIDES) / SIDES
    out = np.cos(turn)[None, :, None] * side[:, None] + np.sin(turn)[None, :, None] * up[:, None]
    positions = points[:, None] + WIDENED * radii[:, None, None] * out
    here = np.flatnonzero(~is_last)[:, None] * SIDES
    k, l = np.arange(SIDES)[None], (np.arange(SIDES)[None] + 1) % SIDES  # noqa: E741
    a, b, c, d = here + k, here + l, here + SIDES + l, here + SIDES + k
    triangles = np.stack([np.stack([a, d, b], -1), np.stack([b, d, c], -1)], axis=2).reshape(-1, 3)
    fibres = np.repeat(np.column_stack([along, 2 * WIDENED * radii]), SIDES, axis=0)
    vertices = positions.reshape(-1, 3).astype(np.float32), out.reshape(-1, 3).astype(np.float32)
    return Tubes(*vertices, triangles.astype(np.int32), fibres.astype(np.float32))


def _unit(vectors: F32) -> F32:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1), (0.0, 0.0, 1.0))
