"""Tests that `row` and `columns` read the same values of whole memory rows as indexing."""

import numpy as np

from renderer.jit import entry
from renderer.kernel.fetch import columns, row


@entry
def _read(floats, ints, number, whole, part):
    for i in range(len(number)):
        a = row(floats, number[i], 5)
        b = columns(ints, np.uint32(number[i]), 7, i % 4, 3)
        for k in range(5):
            whole[i, k] = a[k]
        for k in range(3):
            part[i, k] = b[k]


def test_fetched_rows_and_columns_match_indexing():
    rng = np.random.default_rng(0)
    floats, ints = rng.random((40, 5), np.float32), rng.integers(-9, 9, (40, 7), np.int32)
    number = rng.integers(0, 40, 300, np.int32)
    whole, part = np.empty((300, 5), np.float32), np.empty((300, 3), np.int32)
    _read(floats, ints, number, whole, part)
    np.testing.assert_array_equal(whole, floats[number])
    np.testing.assert_array_equal(part, [ints[n, i % 4 : i % 4 + 3] for i, n in enumerate(number)])
