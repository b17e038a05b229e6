"""Tests of choosing which stored rows of a tile's sums are folded into one row, and of that row."""

from __future__ import annotations

import json

import pytest

from service.store.film_file import RowHead
from service.store.row_folding import MAX_ROWS_APART, MAX_ROWS_UNFOLDED, folded_head, rows_to_fold
from service.store.senders import senders_of


def rows(count: int, workers: int = 1, step: int = 4) -> list[RowHead]:
    """Returns heads (all columns but the sums) of `count` rows with 4 samples each, whose first samples are `step` apart.

    The rows come from `workers` workers in turn.
    """
    return [RowHead(0, 3, step * n, 4, 1, json.dumps([f"worker {n % workers}"]), None) for n in range(count)]


@pytest.mark.parametrize(
    ("count", "workers", "separates_senders", "is_contiguous", "sizes"),
    [
        (MAX_ROWS_UNFOLDED - 1, 1, False, True, []),
        (MAX_ROWS_UNFOLDED, 3, False, True, [MAX_ROWS_UNFOLDED]),
        (MAX_ROWS_UNFOLDED, 3, False, False, []),  # samples between them are still expected
        (2 * MAX_ROWS_UNFOLDED, 2, True, False, [MAX_ROWS_UNFOLDED, MAX_ROWS_UNFOLDED]),
        (2 * MAX_ROWS_UNFOLDED, 3, True, True, []),
        (MAX_ROWS_APART, MAX_ROWS_APART, True, False, [MAX_ROWS_APART]),
    ],
)
def test_rows_to_fold_are_selected(
    count: int, workers: int, separates_senders: bool, is_contiguous: bool, sizes: list[int]
) -> None:
    found = rows_to_fold(rows(count, workers), separates_senders, is_contiguous)
    assert [len(each) for each in found] == sizes
    assert all(len({head.workers for head in each}) == 1 for each in found) or not separates_senders or count >= MAX_ROWS_APART


@pytest.mark.parametrize(("step", "ranges"), [(4, None), (8, [[0, 4], [8, 4], [16, 4]])])
def test_folded_head_combines_rows(step: int, ranges: list[list[int]] | None) -> None:
    made = folded_head(rows(3, workers=2, step=step)[::-1])
    assert (made.frame, made.tile, made.first, made.count, made.bad) == (0, 3, 0, 12, 3)
    assert (None if made.ranges is None else json.loads(made.ranges)) == ranges
    assert {"worker 0", "worker 1"} == set(senders_of(made.workers))
