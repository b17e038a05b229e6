"""Tests of the film's fixed-point numbers in kernels: exact, for one value and for eight lanes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from renderer.bvh.simd import LANES, load
from renderer.film import SAMPLE_MAX
from renderer.jit import entry
from renderer.kernel import fixed_point
from renderer.settings import MAX_FILM_EXPONENT


@entry
def _fixed(values, scale, eight, one):
    for k in range(0, len(values), LANES):
        fixed_point.add_fixed8(eight, np.uintp(k), load(values, np.uintp(k)), scale)
    for k in range(len(values)):
        one[k] += fixed_point.fixed(values[k], scale)


def values(exponent: int) -> npt.NDArray[np.float32]:
    """Returns values of both signs, from denormals to above the sample limit, including ties and their neighbours."""
    random = np.random.default_rng(exponent)
    quantum = 2.0**-exponent
    magnitudes = 2.0 ** random.uniform(-150, 20, 20_000)
    ties = (random.integers(0, 1 << 22, 4_000) + 0.5) * quantum
    whole = random.integers(0, 1 << 24, 4_000) * quantum
    ends = np.array([0.0, quantum / 2, quantum, 1.5 * quantum, SAMPLE_MAX, SAMPLE_MAX * 1.01, 1e30, np.finfo(np.float32).max])
    positive = np.concatenate([magnitudes, ties, whole, ends]).astype(np.float32)
    beside = np.concatenate([positive, np.nextafter(positive, np.float32(0)), np.nextafter(positive, np.float32(1e6))])
    both = np.concatenate([beside, -beside, np.float32([np.inf, -np.inf])])
    return np.concatenate([both, np.zeros(-len(both) % LANES, np.float32)])


@pytest.mark.parametrize("exponent", [0, 1, 12, MAX_FILM_EXPONENT])
def test_values_are_rounded_to_nearest_even(exponent: int) -> None:
    given = values(exponent)
    clamped = np.clip(given.astype(np.float64), -SAMPLE_MAX, SAMPLE_MAX)
    expected = np.rint(clamped * 2.0**exponent).astype(np.int64)
    before = np.random.default_rng(1).integers(-(1 << 62), 1 << 62, len(given))
    eight, one = before.copy(), before.copy()
    _fixed(given, np.float32(2.0**exponent), eight, one)
    np.testing.assert_array_equal(eight - before, expected)
    np.testing.assert_array_equal(one - before, expected)
