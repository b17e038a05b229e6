"""The pool's memory: columns of eight rows, and lists of rows."""

from __future__ import annotations

import numpy as np

from renderer.bvh.simd import store
from renderer.jit import entry
from renderer.kernel.pool.lists import LIST_SIZE, LISTS, append, clear, eight, length, pad, row
from renderer.kernel.pool.rows import MAPPED, ROW, ROWS, at, few, read, write
from renderer.wide.values import as_floats

LAST = np.uintp(13)  # of a group of eight, the column that `few` begins with


@entry
def _list(lists, which, numbers, out):
    clear(lists, which)
    for k in range(len(numbers)):
        append(lists, which, numbers[k])
    for k in range(0, pad(lists, which), 8):
        store(out, np.uintp(k), as_floats(eight(lists, which, k)))
    return length(lists, which), row(lists, which, len(numbers) - 1)


def test_a_list_is_read_by_eights_its_last_number_to_the_end() -> None:
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
    rows = eight(lists, 0, 0)
    group = read(pool, rows, MAPPED)
    for k in range(8):
        store(out, np.uintp(8 * k), group[k])
    three = few(pool, rows, LAST, 3)
    for k in range(3):
        store(out, np.uintp(64 + 8 * k), three[k])
    write(pool, rows, MAPPED, (group[7], group[6], group[5], group[4], group[3], group[2], group[1], group[0]))
    return pool[at(numbers[0], MAPPED)]


def test_columns_of_any_rows_are_read_and_written() -> None:
    pool = np.random.default_rng(3).random((ROWS, int(ROW)), np.float32)
    expected = pool.copy()
    numbers = np.array([5, 127, 0, 64, 3])
    filled = [*numbers, 3, 3, 3]
    group = slice(int(MAPPED), int(MAPPED) + 8)
    out = np.zeros((11, 8), np.float32)
    first = _rows(pool.ravel(), np.zeros(LISTS * LIST_SIZE, np.uint32), numbers, out.ravel())
    np.testing.assert_array_equal(out[:8], expected[filled, group].T)
    np.testing.assert_array_equal(out[8:], expected[filled, int(LAST) : int(LAST) + 3].T)
    expected[numbers, group] = expected[numbers, group][:, ::-1]
    np.testing.assert_array_equal(pool, expected)
    assert first == expected[5, int(MAPPED)]
