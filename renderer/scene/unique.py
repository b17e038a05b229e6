"""Rows of a table that are the same."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.kernel.mesh.smooth import number_points

__all__ = ["unique_rows", "unique_threes"]


def unique_rows(table: npt.NDArray[Any]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """The first row of each kind, (U,), and the kind of each row, (N,), of an (N, K) table of numbers.

    As numpy.unique along axis 0, in the same order, and some ten times as fast: columns are sorted, not rows compared.
    """
    if len(table) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    order = np.lexsort(table.T[::-1])
    ordered = table[order]
    new = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])
    kind = np.empty(len(table), np.int64)
    kind[order] = np.cumsum(new) - 1
    return order[new], kind


def unique_threes(table: npt.NDArray[Any]) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """As `unique_rows`, of (N, 3) numbers of 32 bits, and far faster: by their bits, kinds in the order in which they come."""
    bits = np.ascontiguousarray(table).view(np.uint32)
    slots = np.full(1 << max(2 * len(bits) - 1, 1).bit_length(), -1, np.int32)
    first, kind = np.empty(len(bits), np.int32), np.empty(len(bits), np.int32)
    salt = np.uint64(int.from_bytes(os.urandom(8), "little"))
    count = number_points(bits, salt, slots, first, kind)
    return first[:count], kind
