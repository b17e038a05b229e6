"""What lanes are asked all at once: sums up to each of them, and comparisons of whole numbers, against NumPy."""

import numpy as np

from renderer.bvh.simd import bits, exceeding, load, running_sum, store
from renderer.jit import entry

LANES = 8
ZERO = np.uintp(0)


@entry
def _sums(values, sums):
    for i in range(len(values)):
        store(sums[i], ZERO, running_sum(load(values[i], ZERO)))


@entry
def _exceed(numbers, number, found):
    for i in range(len(numbers)):
        found[i] = bits(exceeding(load(numbers[i], ZERO), number[i]))


def test_running_sums_neither_fall_nor_rise_where_a_lane_is_zero():
    """By the last bit: whoever is chosen by them has a chance."""
    rng = np.random.default_rng(0)
    values = (rng.random((5000, LANES)) * 10.0 ** rng.integers(-9, 10, (5000, LANES))).astype(np.float32)
    values[rng.random(values.shape) < 0.3] = 0
    sums = np.zeros_like(values)
    _sums(values, sums)
    np.testing.assert_allclose(sums, np.cumsum(values.astype(float), axis=1), rtol=1e-6)
    steps = np.diff(sums, axis=1, prepend=np.float32(0))
    assert steps.min() >= 0
    assert not steps[values == 0].any()


def test_whole_numbers_are_compared_as_such():
    """As floats, half of these would be NaN."""
    rng = np.random.default_rng(1)
    numbers = rng.integers(-(2**31), 2**31, (1000, LANES)).astype(np.int32)
    number = rng.integers(-(2**31), 2**31, 1000).astype(np.int32)
    numbers[:, 2] = number
    found = np.zeros(1000, np.uint32)
    _exceed(numbers.view(np.float32), number, found)
    expected = np.packbits(numbers > number[:, None], axis=1, bitorder="little")[:, 0]
    assert np.array_equal(found, expected)
