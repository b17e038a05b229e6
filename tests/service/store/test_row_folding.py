"""Selection of a tile's rows for folding, and the folded row."""

from __future__ import annotations

import json

import pytest

from service.store.film_file import Head
from service.store.row_folding import FOLD_AT, MOST_APART, folded, to_fold
from service.store.senders import senders_of


def rows(count: int, workers: int = 1, step: int = 4) -> list[Head]:
    """Returns heads of rows with 4 samples each, whose first samples are `step` apart."""
    return [Head(0, 3, step * n, 4, 1, json.dumps([f"worker {n % workers}"]), None) for n in range(count)]


@pytest.mark.parametrize(
    ("count", "workers", "keeps_apart", "is_one_run", "sizes"),
    [
        (FOLD_AT - 1, 1, False, True, []),
        (FOLD_AT, 3, False, True, [FOLD_AT]),
        (FOLD_AT, 3, False, False, []),  # it is waited for what is missing between them
        (2 * FOLD_AT, 2, True, False, [FOLD_AT, FOLD_AT]),
        (2 * FOLD_AT, 3, True, True, []),
        (MOST_APART, MOST_APART, True, False, [MOST_APART]),
    ],
)
def test_rows_that_become_one(count: int, workers: int, keeps_apart: bool, is_one_run: bool, sizes: list[int]) -> None:
    found = to_fold(rows(count, workers), keeps_apart, is_one_run)
    assert [len(each) for each in found] == sizes
    assert all(len({head.workers for head in each}) == 1 for each in found) or not keeps_apart or count >= MOST_APART


@pytest.mark.parametrize(("step", "ranges"), [(4, None), (8, [[0, 4], [8, 4], [16, 4]])])
def test_one_row_says_what_all_of_them_said(step: int, ranges: list[list[int]] | None) -> None:
    made = folded(rows(3, workers=2, step=step)[::-1])
    assert (made.frame, made.tile, made.first, made.count, made.bad) == (0, 3, 0, 12, 3)
    assert (None if made.ranges is None else json.loads(made.ranges)) == ranges
    assert {"worker 0", "worker 1"} == set(senders_of(made.workers))
