"""Tests of scalar functions that are called lane by lane for selected lanes, and for a single path like any function."""

import numpy as np

from renderer.bvh.simd import load
from renderer.jit import device, entry
from renderer.wide.lanes import each_lane
from renderer.wide.values import to_int, u32
from tests.renderer.wide.both import LANES, keep

N = LANES


@device
def _looked_up(table, number, pair, calls):
    """Returns values of several types through a branch, and counts its calls in `calls`."""
    calls[0] += 1
    if number >= 100:
        return (table[0], np.int64(number) - 100), pair[0], True
    return (table[number], np.int64(-1)), pair[1], pair[0] > pair[1]


@entry
def _in_lanes(table, x, common, below, calls, out):
    a = load(x, np.uintp(0))
    (value, number), other, choice = each_lane(_looked_up, a < below, (table, to_int(a), (a, common), calls))
    keep(out, 0, number, (value, number, other, choice))


@entry
def _of_one(table, x, common, below, calls, out):
    for i in range(len(x)):
        arguments = table, u32(to_int(x[i])), (x[i], common), calls
        (value, number), other, choice = each_lane(_looked_up, x[i] < below, arguments)
        keep(out, i, u32(number), (value, u32(number), other, choice))


def test_function_is_called_for_selected_lanes():
    table = np.linspace(1, 2, 8, dtype=np.float32)
    x = np.array([3, 107, 0, 500, 7, 100, 5, 501], np.float32)
    out, calls = np.full((2, 4, N), np.float32(-9)), np.zeros((2, 1), np.int32)
    for k, kernel in enumerate((_in_lanes, _of_one)):
        kernel(table, x, np.float32(4), np.float32(200), calls[k], out[k])
    assert calls.tolist() == [[6], [6]]
    for value, number, other, choice in out:
        np.testing.assert_array_equal(value, [*table[[3, 0, 0]], 0, table[7], table[0], table[5], 0])
        np.testing.assert_array_equal(number, [-1, 7, -1, 0, -1, 0, -1, 0])
        np.testing.assert_array_equal(other, [4, 107, 4, 0, 4, 100, 4, 0])
        np.testing.assert_array_equal(choice, [0, 1, 0, 0, 1, 1, 1, 0])
