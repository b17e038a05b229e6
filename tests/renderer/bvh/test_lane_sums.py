"""Tests of sums over the eight lanes of a vector, compared with NumPy, and of choosing a lane by running sums of weights."""

import numpy as np

from renderer.bvh.lane_sums import running_sum, whole_sum
from renderer.bvh.simd import load, store
from renderer.jit import entry

LANES = 8
ZERO = np.uintp(0)


@entry
def _sums(values, sums, wholes):
    for i in range(len(values)):
        store(sums[i], ZERO, running_sum(load(values[i], ZERO)))
        store(wholes[i], ZERO, whole_sum(load(values[i], ZERO)))


def test_running_sums_are_constant_across_zero_lanes():
    """Running sums are exactly constant across lanes of weight 0, so that such a lane is never chosen."""
    rng = np.random.default_rng(0)
    values = (rng.random((5000, LANES)) * 10.0 ** rng.integers(-9, 10, (5000, LANES))).astype(np.float32)
    values[rng.random(values.shape) < 0.3] = 0
    sums, wholes = np.zeros_like(values), np.zeros_like(values)
    _sums(values, sums, wholes)
    np.testing.assert_allclose(sums, np.cumsum(values.astype(float), axis=1), rtol=1e-6)
    steps = np.diff(sums, axis=1, prepend=np.float32(0))
    assert steps.min() >= 0
    assert not steps[values == 0].any()
    assert np.array_equal(wholes, np.repeat(sums[:, -1:], LANES, axis=1))
