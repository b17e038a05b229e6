"""Tests of memory rows read and written for eight lanes, against NumPy's indexing."""

from typing import NamedTuple

import numpy as np
import pytest

from renderer.bvh.simd import LANES, load, store
from renderer.jit import entry
from renderer.kernel.fetch import columns, row
from renderer.wide.fields import Float, Layout, Vector, accessors
from renderer.wide.rows import load_ints
from renderer.wide.values import as_floats

ROWS, N = 40, 8 * 50


def of_width(width, seed=0):
    """Returns a table (ROWS, width) of random floats and N random row numbers.

    Reading past the table's last row would read another array's memory.
    """
    rng = np.random.default_rng(seed)
    return rng.random((ROWS, width), np.float32), rng.integers(0, ROWS, N, np.int32)


@entry
def _gather(table, number, found):
    for i in range(0, len(number), LANES):
        at = load_ints(number, np.uintp(i))
        first = columns(table, at, 19, 2, 1)
        for column, values in enumerate(first + columns(table, at, 19, 0, 2)):
            store(found, np.uintp(column * len(number) + i), values)
        for column, values in enumerate(columns(table, at, 19, 1, 3)):
            store(found, np.uintp((3 + column) * len(number) + i), values)
        for column, values in enumerate(columns(table, at, 19, 3, 7)):
            store(found, np.uintp((6 + column) * len(number) + i), values)
        for column, values in enumerate(columns(table, at, 19, 2, 17)):
            store(found, np.uintp((13 + column) * len(number) + i), values)


def test_columns_of_eight_rows():
    table, number = of_width(19)
    found = np.empty((30, N), np.float32)
    _gather(table, number, found)
    wanted = [2, 0, 1, *range(1, 4), *range(3, 10), *range(2, 19)]
    np.testing.assert_array_equal(found, table[number][:, wanted].T)


@entry
def _fetch(floats, ints, number, found, words):
    for i in range(0, len(number), LANES):
        at = load_ints(number, np.uintp(i))
        for column, values in enumerate(row(floats, at, 5) + columns(floats, at, 5, 1, 4)):
            store(found, np.uintp(column * len(number) + i), values)
        for column, values in enumerate(row(ints, at, 3)):
            store(words, np.uintp(column * len(number) + i), as_floats(values))


def test_rows_of_a_scenes_tables():
    floats, number = of_width(5)
    ints = np.random.default_rng(1).integers(-(2**31), 2**31, (ROWS, 3), np.int32)
    found, words = np.empty((9, N), np.float32), np.empty((3, N), np.float32)
    _fetch(floats, ints, number, found, words)
    np.testing.assert_array_equal(found, floats[number][:, [*range(5), *range(1, 5)]].T)
    np.testing.assert_array_equal(words.view(np.int32), ints[number].T)


class _Pair(NamedTuple):
    """A memory row of two fields."""

    a: Vector
    b: Float


_WIDTH = 11  # columns in the table, of which the tuple uses eight
_LAYOUT = Layout(_Pair)
_LAYOUT.width = _WIDTH
_gather_pair, _scatter_pair = accessors(_LAYOUT)


@entry
def _scatter(table, number, values):
    for i in range(0, len(number), LANES):
        a, b = load(values, np.uintp(i)), load(values, np.uintp(len(number) + i))
        _scatter_pair(table, load_ints(number, np.uintp(i)), _Pair((a, b, a), b))


@pytest.mark.parametrize("repeated", [False, True])
def test_rows_written(repeated):
    """If two lanes write one row the last wins; columns beyond the eight are unchanged, unused ones of the eight become 0."""
    rng = np.random.default_rng(2)
    number = rng.integers(0, 3, 16, np.int32) if repeated else rng.permutation(ROWS)[:16].astype(np.int32)
    table, values = rng.random((ROWS, _WIDTH), np.float32), rng.random((2, 16), np.float32)
    wanted = table.copy()
    for k, (a, b) in zip(number, values.T, strict=True):
        wanted[k, :8] = a, b, a, b, 0, 0, 0, 0
    _scatter(table, number, values)
    np.testing.assert_array_equal(table, wanted)
