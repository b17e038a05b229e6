"""The random numbers: uniform, independent of their neighbours, and a function of their four counters alone."""

import numpy as np
import pytest
import scipy.stats

from renderer.jit import entry
from renderer.kernel.sampler import pixel_key, uniform4
from tests.renderer.judge import assert_uniform, limit

N = 1 << 18


@entry
def _numbers(seed, x, y, sample, block, out):
    for i in range(len(out)):
        numbers = uniform4(np.uint32(seed[i]), pixel_key(x[i], y[i]), np.uint32(sample[i]), np.uint32(block[i]))
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = numbers


def numbers(seed=0, x=0, y=0, sample=0, block=0):
    """(n, 4) for counters that broadcast to one length."""
    columns = np.broadcast_arrays(*(np.atleast_1d(np.asarray(c, np.int64)) for c in (seed, x, y, sample, block)))
    out = np.empty((columns[0].size, 4), np.float32)
    _numbers(*(np.ascontiguousarray(c) for c in columns), out)
    return out


# One counter runs and the others stand still: what a pixel's samples, a row of pixels or a path's dimensions see.
RUNS = {
    "samples": lambda n: numbers(sample=np.arange(n)),
    "later samples": lambda n: numbers(seed=9, x=500, y=300, sample=np.arange(n) + 100_000),
    "row": lambda n: numbers(x=np.arange(n) % 16384, y=7 + np.arange(n) // 16384),
    "column": lambda n: numbers(y=np.arange(n) % 16384, x=np.arange(n) // 16384),
    "dimensions": lambda n: numbers(block=np.arange(n) % 2048, sample=np.arange(n) // 2048),
    "seeds": lambda n: numbers(seed=np.arange(n)),
    "picture": lambda n: numbers(x=np.arange(n) % 64, y=np.arange(n) // 64 % 64, sample=np.arange(n) // 4096),
}


@pytest.fixture(scope="module")
def runs():
    return {name: make(N) for name, make in RUNS.items()}


@pytest.mark.parametrize("name", RUNS)
def test_numbers_are_uniform_in_one_two_and_three_dimensions(runs, name):
    values = runs[name]
    assert values.dtype == np.float32
    assert values.min() >= 0
    assert values.max() < 1
    cell = (values * 1024).astype(int)
    for k in range(4):
        assert_uniform(np.bincount(cell[:, k], minlength=1024), 60, f"{name}, dimension {k}")
    coarse = (values * 64).astype(int)
    for a, b in ((0, 1), (1, 2), (2, 3), (0, 3)):  # a pixel's place, a light's place, a direction
        assert_uniform(np.bincount(coarse[:, a] * 64 + coarse[:, b], minlength=4096), 60, f"{name}, dimensions {a} and {b}")
    coarse = (values * 16).astype(int)
    assert_uniform(np.bincount((coarse[:, 0] * 16 + coarse[:, 1]) * 16 + coarse[:, 2], minlength=4096), 60, name)


@pytest.mark.parametrize("name", RUNS)
def test_neighbours_are_independent(runs, name):
    """Serial correlation at several lags, within a dimension and across, and joint uniformity with the next."""
    values = runs[name].astype(float) - 0.5
    for lag in (1, 2, 64, 2048):
        products = values[:-lag, :, None] * values[lag:, None, :]
        correlation = 12 * products.mean(0) * np.sqrt(len(products))  # standard normal where independent
        assert np.abs(correlation).max() < limit(len(RUNS) * 4 * 16), f"{name}, lag {lag}"
    cell = (runs[name] * 64).astype(int)
    for k in range(4):
        assert_uniform(np.bincount(cell[:-1, k] * 64 + cell[1:, k], minlength=4096), 28, f"{name}, dimension {k} and the next")


@pytest.mark.parametrize("name", RUNS)
def test_low_bits_are_random_too(runs, name):
    low = (runs[name].astype(np.float64) * 2**24).astype(np.int64) & 255
    for k in range(4):
        assert_uniform(np.bincount(low[:, k], minlength=256), 28, f"{name}, dimension {k}")


def test_the_mean_of_n_samples_nears_a_half_as_it_should():
    """Over 4096 pixels, the means of 64 samples are normal with the right spread: no pixel has a lucky row."""
    pixel = np.arange(4096 * 64) // 64
    values = numbers(x=pixel % 64, y=pixel // 64, sample=np.arange(4096 * 64) % 64)
    means = (values.reshape(4096, 64, 4).mean(1, dtype=np.float64) - 0.5) * np.sqrt(12 * 64)
    for k in range(4):
        assert scipy.stats.kstest(means[:, k], "norm").pvalue > 0.0025
        assert scipy.stats.chi2.sf((means[:, k] ** 2).sum(), 4096) > 0.0025


def test_only_the_counters_count():
    one = numbers(seed=5, x=10, y=20, sample=30, block=2)
    np.testing.assert_array_equal(one, numbers(seed=5, x=10, y=20, sample=[30, 30], block=2)[1:])
    changed = [
        numbers(seed=6, x=10, y=20, sample=30, block=2),
        numbers(seed=5, x=11, y=20, sample=30, block=2),
        numbers(seed=5, x=10, y=21, sample=30, block=2),
        numbers(seed=5, x=20, y=10, sample=30, block=2),
        numbers(seed=5, x=10, y=20, sample=31, block=2),
        numbers(seed=5, x=10, y=20, sample=30, block=3),
    ]
    for other in changed:
        assert not (other == one).any()


def test_pixels_of_the_largest_frame_are_told_apart():
    x, y = np.array([0, 1, 16383, 0, 16383, 255, 256]), np.array([0, 0, 0, 16383, 16383, 1, 1])
    assert len(np.unique(numbers(x=x, y=y), axis=0)) == len(x)
