"""Tests of the path pool's memory: columns of eight rows, and lists of rows."""

from __future__ import annotations

import numpy as np

from renderer.bvh.simd import store
from renderer.jit import entry
from renderer.kernel.backends.cpu.lists import LIST_SIZE, LISTS, append, clear, eight_rows, length, pad, row
from renderer.kernel.backends.cpu.rows import LAYOUT, ROW, ROWS, Facet, Sample, column, gather, scatter
from renderer.wide.fields import width_of
from renderer.wide.values import as_floats, where

ONE = np.float32(1)


@entry
def _list(lists, which, numbers, out):
    clear(lists, which)
    for k in range(len(numbers)):
        append(lists, which, numbers[k])
    for k in range(0, pad(lists, which), 8):
        store(out, np.uintp(k), as_floats(eight_rows(lists, which, k)))
    return length(lists, which), row(lists, which, len(numbers) - 1)


def test_lists_are_padded_with_their_last_number() -> None:
    lists = np.full(LISTS * LIST_SIZE, 77, np.uint32)
    for count in (1, 7, 8, 9, ROWS):
        for which in (0, LISTS - 1):
            beside = lists.reshape(LISTS, LIST_SIZE).copy()
            numbers = np.random.default_rng(count).permutation(ROWS)[:count]
            out = np.full(ROWS + 8, -1, np.int32)
            assert _list(lists, which, numbers, out.view(np.float32)) == (count, numbers[-1])
            filled = -(-count // 8) * 8
            assert out[:filled].tolist() == [*numbers, *[numbers[-1]] * (filled - count)]
            assert (out[filled:] == -1).all()
            others = np.arange(LISTS) != which
            np.testing.assert_array_equal(lists.reshape(LISTS, LIST_SIZE)[others], beside[others])


@entry
def _rows(pool, lists, numbers, out):
    clear(lists, 0)
    for k in range(len(numbers)):
        append(lists, 0, numbers[k])
    pad(lists, 0)
    rows = eight_rows(lists, 0, 0)
    facet, sample = gather(pool, rows, Facet), gather(pool, rows, Sample)
    for c in range(3):
        store(out, np.uintp(8 * c), facet.point[c])
        store(out, np.uintp(32 + 8 * c), facet.geometric[c])
    store(out, np.uintp(24), facet.error)
    store(out, np.uintp(56), where(facet.front, ONE, -ONE))
    store(out, np.uintp(64), as_floats(sample.place))
    scatter(pool, rows, Facet(facet.geometric, facet.error, facet.point, facet.smooth, facet.front))
    alone = gather(pool, np.uintp(numbers[0]), Facet)
    return alone.point[0], alone.front, alone.smooth


def test_fields_of_arbitrary_rows_round_trip() -> None:
    pool = np.random.default_rng(3).random((ROWS, int(ROW)), np.float32)
    first, flags, place = (int(column(*of)) for of in ((Facet, "point"), (Facet, "front"), (Sample, "place")))
    pool.view(np.int32)[:, flags] = np.arange(ROWS) % 4
    expected = pool.copy()
    numbers = np.array([5, 127, 0, 64, 3])
    filled = [*numbers, 3, 3, 3]
    out = np.zeros((9, 8), np.float32)
    told = _rows(pool.ravel(), np.zeros(LISTS * LIST_SIZE, np.uint32), numbers, out.ravel())
    np.testing.assert_array_equal(out[:7], expected[filled, first : first + 7].T)
    np.testing.assert_array_equal(out[7] > 0, [row % 2 == 1 for row in filled])
    np.testing.assert_array_equal(out[8], expected[filled, place])
    expected[numbers, first : first + 7] = expected[numbers][:, [first + k for k in (4, 5, 6, 3, 0, 1, 2)]]
    expected.view(np.int32)[numbers, flags] = [(row % 2 << 1) + (row % 4 >> 1) for row in numbers]
    np.testing.assert_array_equal(pool, expected)
    assert told == (expected[5, first], False, True)


def test_fields_have_separate_columns() -> None:
    """Each field of the pool has separate columns; tuples read by one load begin at multiples of eight columns."""
    taken: dict[int, type] = {}
    for declared, first in LAYOUT.first.items():
        assert first % 8 == 0
        taken.setdefault(first, declared)
    ends = {first: first + width_of(declared) for first, declared in taken.items()}
    assert all(end <= after for end, after in zip(list(ends.values())[:-1], sorted(taken)[1:], strict=True))
    assert LAYOUT.width == int(ROW) == 144
