"""Tests that random numbers are a function of their counters alone.

The independent sampler is uncorrelated, the Sobol' sampler stratified.
"""

import math

import numpy as np
import pytest
import scipy.stats

from renderer.jit import entry
from renderer.kernel.polynomial import log
from renderer.kernel.sampling.sampler import INDEPENDENT, SOBOL, Stream, draw_film, opposite, pixel_key, uniform4
from renderer.kernel.sampling.sobol import direction_numbers
from tests.grids import grid
from tests.renderer.judge import assert_uniform, limit

N = 1 << 18


@entry
def _numbers(kind, seed, x, y, sample, block, out):
    for i in range(len(out)):
        numbers = uniform4(kind, np.uint32(seed[i]), pixel_key(x[i], y[i]), np.uint32(sample[i]), np.uint32(block[i]))
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = numbers


def numbers(seed=0, x=0, y=0, sample=0, block=0, kind=INDEPENDENT):
    """Returns numbers (n, 4) for counters that broadcast to one length."""
    columns = np.broadcast_arrays(*(np.atleast_1d(np.asarray(c, np.int64)) for c in (seed, x, y, sample, block)))
    out = np.empty((columns[0].size, 4), np.float32)
    _numbers(kind, *(np.ascontiguousarray(c) for c in columns), out)
    return out


# One counter runs while the others are fixed: the samples of a pixel, a row of pixels, or the dimensions of a path.
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
    for a, b in ((0, 1), (1, 2), (2, 3), (0, 3)):  # pairs used for pixel positions, light positions and directions
        assert_uniform(np.bincount(coarse[:, a] * 64 + coarse[:, b], minlength=4096), 60, f"{name}, dimensions {a} and {b}")
    coarse = (values * 16).astype(int)
    assert_uniform(np.bincount((coarse[:, 0] * 16 + coarse[:, 1]) * 16 + coarse[:, 2], minlength=4096), 60, name)


@grid("name", RUNS)
def test_neighbours_are_independent(runs, name):
    """Numbers have no serial correlation at several lags, within or across dimensions, and are jointly uniform with the next."""
    values = runs[name].astype(float) - 0.5
    for lag in (1, 2, 64, 2048):
        products = values[:-lag, :, None] * values[lag:, None, :]
        correlation = 12 * products.mean(0) * np.sqrt(len(products))  # standard normal if independent
        assert np.abs(correlation).max() < limit(len(RUNS) * 4 * 16), f"{name}, lag {lag}"
    cell = (runs[name] * 64).astype(int)
    for k in range(4):
        assert_uniform(np.bincount(cell[:-1, k] * 64 + cell[1:, k], minlength=4096), 28, f"{name}, dimension {k} and the next")


@pytest.mark.parametrize("name", RUNS)
def test_low_bits_are_random_too(runs, name):
    low = (runs[name].astype(np.float64) * 2**24).astype(np.int64) & 255
    for k in range(4):
        assert_uniform(np.bincount(low[:, k], minlength=256), 28, f"{name}, dimension {k}")


def test_sample_means_are_normally_distributed():
    """The means of 64 samples, over 4096 pixels, are normally distributed with the expected standard deviation."""
    pixel = np.arange(4096 * 64) // 64
    values = numbers(x=pixel % 64, y=pixel // 64, sample=np.arange(4096 * 64) % 64)
    means = (values.reshape(4096, 64, 4).mean(1, dtype=np.float64) - 0.5) * np.sqrt(12 * 64)
    for k in range(4):
        assert scipy.stats.kstest(means[:, k], "norm").pvalue > 0.0025
        assert scipy.stats.chi2.sf((means[:, k] ** 2).sum(), 4096) > 0.0025


@entry
def _passing(paths, majorant, real):
    """Returns how many paths pass a slab of thickness 1 by delta tracking. real: the probability that a collision is real."""
    passed = 0
    for i in range(paths):
        pixel, sample, block = np.uint32(i & 0xFFFF), np.uint32(i >> 16), np.uint32(1 << 30)
        t, u = np.float32(0.0), uniform4(INDEPENDENT, np.uint32(7), pixel, sample, np.uint32(5))[0]
        while True:
            t -= log(np.float32(1.0) - u) / majorant
            if t >= np.float32(1.0):
                passed += 1
                break
            chance, u, _, _ = uniform4(INDEPENDENT, np.uint32(7), pixel, sample, block)
            block = np.uint32(block + np.uint32(1))
            if chance < real:
                break
    return passed


@pytest.mark.long
def test_blocks_of_a_path_are_jointly_independent():
    """Delta tracking, which draws a block a collision, has the mean exp(-optical depth).

    With unhashed block numbers it was 0.06 % too large, 5 times the standard error of this test.
    """
    paths, depth, majorant = 1 << 29, 2.0, 8.8
    real = np.float32(depth / majorant)
    expected = math.exp(-majorant * float(real))
    passed = _passing(paths, np.float32(majorant), real)
    assert abs(passed / paths - expected) < 4 * math.sqrt(expected * (1 - expected) / paths)


@pytest.mark.parametrize("kind", [SOBOL, INDEPENDENT])
def test_numbers_depend_on_the_counters_only(kind):
    counters = {"seed": 5, "x": 10, "y": 20, "sample": 30, "block": 2, "kind": kind}
    one = numbers(**counters)
    np.testing.assert_array_equal(one, numbers(**{**counters, "sample": [30, 30]})[1:])
    changes = ({"seed": 6}, {"x": 11}, {"y": 21}, {"x": 20, "y": 10}, {"sample": 31}, {"block": 3})
    changed = [numbers(**{**counters, **change}) for change in changes]
    for other in changed:
        assert not (other == one).any()


def test_pixel_keys_of_the_largest_frame_are_distinct():
    x, y = np.array([0, 1, 16383, 0, 16383, 255, 256]), np.array([0, 0, 0, 16383, 16383, 1, 1])
    assert len(np.unique(numbers(x=x, y=y), axis=0)) == len(x)


def test_direction_numbers_match_scipy():
    """Direction numbers equal SciPy's, which are those of Joe and Kuo."""
    columns = direction_numbers()
    bits = np.arange(256)[:, None] >> np.arange(8) & 1
    points = np.array([np.bitwise_xor.reduce(np.where(bits, row[:8], 0), axis=1) for row in columns]).T / 2**32
    theirs = scipy.stats.qmc.Sobol(4, scramble=False).random(256)
    assert set(map(tuple, points)) == set(map(tuple, theirs))


@pytest.fixture(scope="module")
def points():
    """Returns (pixels, samples, 4): a block of 64 pixels with 1024 samples each."""
    pixel = np.arange(64 * 1024) // 1024
    return numbers(x=pixel % 8, y=pixel // 8, sample=np.arange(64 * 1024) % 1024, block=3, kind=SOBOL).reshape(64, 1024, 4)


@pytest.mark.parametrize("first", [0, 512, 640])
@pytest.mark.parametrize("log_n", range(8))
def test_every_aligned_run_of_samples_is_stratified(points, first, log_n):
    """Aligned runs of 2**k samples are stratified: one in each of 2**k slices of each dimension.

    Also one in each of 2**k boxes of the first two dimensions.
    """
    n = 1 << log_n
    run = points[:, first : first + n]
    for k in range(4):
        np.testing.assert_array_equal(np.sort((run[..., k] * n).astype(int), axis=1), np.broadcast_to(np.arange(n), (64, n)))
    for cut in range(log_n + 1):
        cell = (run[..., 0] * (1 << cut)).astype(int) * (n >> cut) + (run[..., 1] * (n >> cut)).astype(int)
        np.testing.assert_array_equal(np.sort(cell, axis=1), np.broadcast_to(np.arange(n), (64, n)))


def test_four_dimensions_together_are_stratified_coarsely(points):
    """The first four dimensions are a (t, 4)-sequence with t = 3, so 256 points put 8 into each of 32 boxes."""
    run = points[:, :256]
    for cuts in ((5, 0, 0, 0), (2, 1, 1, 1), (1, 2, 1, 1), (1, 1, 2, 1), (1, 1, 1, 2), (0, 0, 2, 3), (0, 3, 2, 0), (2, 0, 0, 3)):
        cell = np.zeros((64, 256), int)
        for k, cut in enumerate(cuts):
            cell = (cell << cut) + (run[..., k] * (1 << cut)).astype(int)
        assert (np.apply_along_axis(np.bincount, 1, cell, minlength=32) == 8).all(), cuts


SOBOL_RUNS = {
    "pixels": lambda n: numbers(x=np.arange(n) % 512, y=np.arange(n) // 512, sample=5, kind=SOBOL),
    "blocks": lambda n: numbers(block=np.arange(n) % 256, x=np.arange(n) // 256, sample=5, kind=SOBOL),
    "seeds": lambda n: numbers(seed=np.arange(n), sample=5, kind=SOBOL),
    "first samples": lambda n: numbers(x=np.arange(n) % 512, y=np.arange(n) // 512, sample=0, kind=SOBOL),
}


@pytest.mark.parametrize("name", SOBOL_RUNS)
def test_sobol_points_of_different_pixels_blocks_and_seeds_are_independent(name):
    values = SOBOL_RUNS[name](N)
    cell = (values * 64).astype(int)
    for a, b in ((0, 1), (1, 2), (2, 3), (0, 3)):
        assert_uniform(np.bincount(cell[:, a] * 64 + cell[:, b], minlength=4096), 16, f"{name}, dimensions {a} and {b}")
    centred = values.astype(float) - 0.5
    for lag in (1, 2, 512):
        correlation = 12 * (centred[:-lag, :, None] * centred[lag:, None, :]).mean(0) * np.sqrt(N - lag)
        assert np.abs(correlation).max() < limit(len(SOBOL_RUNS) * 3 * 16), f"{name}, lag {lag}"


def test_blocks_of_a_pixel_are_not_correlated():
    """Over many pixels, sample i's positions in two blocks are independent: samples are shuffled, not only scrambled."""
    pixel, sample = np.arange(N) // 16, np.arange(N) % 16
    blocks = [numbers(x=pixel % 512, y=pixel // 512, sample=sample, block=b, kind=SOBOL) for b in (1, 2, 3, 4, 7)]
    products = []
    for i, a in enumerate(blocks):
        for b in blocks[:i]:
            # A pixel's samples depend on each other, so their sum is one observation
            sums = ((a - 0.5)[:, :, None] * (b - 0.5)[:, None, :]).astype(float).reshape(-1, 16, 4, 4).sum(1)
            products.append(np.abs(sums.mean(0)) / (sums.std(0) / np.sqrt(len(sums))))
    assert np.max(products) < limit(10 * 16)


@pytest.mark.parametrize(("first", "then"), [(2, 4), (6, 8)])
def test_two_vertices_are_stratified_in_four_dimensions(first, then):
    """The four dimensions of two path vertices' directions are stratified together.

    Most divisions of them into as many equal boxes as samples have one sample in each box.
    """
    for log_n in (4, 5, 6):
        n = 1 << log_n
        pixel, sample = np.arange(8 * n) // n, np.arange(8 * n) % n
        u = np.hstack([numbers(x=pixel, y=3, sample=sample, block=b, kind=SOBOL)[:, :2] for b in (first, then)])
        cuts = [c for c in np.ndindex(*4 * (log_n + 1,)) if sum(c) == log_n and c[0] + c[1] and c[2] + c[3]]
        full = 0
        for cut in cuts:
            digits = (u * (1 << np.array(cut))).astype(int)
            cell = np.ravel_multi_index(tuple(digits.T), tuple(1 << c for c in cut))
            full += len(np.unique(pixel * n + cell)) == 8 * n
        assert full > len(cuts) / 2


@pytest.mark.parametrize("n", [4, 16, 64, 256])
def test_sobol_integrates_better_than_independent_numbers(n):
    """The Sobol' sampler integrates with less error than independent numbers, whose error falls as 1 / sqrt(n).

    Compared is the spread over 1024 pixels, for the area of a disk in the unit square and for a smooth bump.
    """
    pixel = np.arange(1024 * n) // n
    errors = {}
    for kind in (SOBOL, INDEPENDENT):
        u = numbers(x=pixel % 32, y=pixel // 32, sample=np.arange(1024 * n) % n, block=1, kind=kind).reshape(1024, n, 4)
        inside = (u[..., 0] ** 2 + u[..., 1] ** 2 < 1).mean(1)
        bump = np.exp(-8 * ((u[..., 0] - 0.4) ** 2 + (u[..., 1] - 0.7) ** 2)).mean(1)
        errors[kind] = np.array([inside.std(), bump.std()])
    gain = errors[INDEPENDENT] / errors[SOBOL]
    assert (gain > np.array([n**0.2, n**0.4])).all(), gain


@entry
def _film_places(kind, seed, x, y, sample, out):
    for i in range(len(out)):
        stream = Stream(kind, np.uint32(seed), pixel_key(x[i], y[i]), np.uint32(sample[i]))
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = draw_film(stream)


def film_places(pixels, samples, kind=SOBOL):
    """Returns the film positions of samples of a row of pixels, (pixels, samples, 4)."""
    x, sample = np.repeat(np.arange(pixels), samples), np.tile(np.arange(samples), pixels)
    out = np.empty((pixels * samples, 4), np.float32)
    _film_places(kind, 3, x, np.zeros_like(x), sample, out)
    return out.reshape(pixels, samples, 4)


@grid("first", [0, 512, 640])
@pytest.mark.parametrize("log_n", range(1, 8))
def test_film_positions_form_a_good_lattice(first, log_n):
    """Any aligned run of 2**k samples has one in each of 2**k rows and columns, with the minimum distances of a good lattice."""
    n = 1 << log_n
    run = film_places(64, 1024)[:, first : first + n].astype(float)
    for k in range(4):
        np.testing.assert_array_equal(np.sort((run[..., k] * n).astype(int), axis=1), np.broadcast_to(np.arange(n), (64, n)))
    way = run[:, :, None, :2] - run[:, None, :, :2]
    distance = np.linalg.norm(way - np.rint(way), axis=-1)[:, ~np.eye(n, dtype=bool)]
    densest = math.sqrt(2 / math.sqrt(3) / n)
    assert distance.min() > 0.65 * densest


@pytest.mark.parametrize("kind", [SOBOL, INDEPENDENT])
def test_film_positions_of_pixels_are_independent(kind):
    values = film_places(N // 16, 16, kind)[:, 5]
    cell = (values * 16).astype(int)
    for a, b in ((0, 1), (1, 2), (2, 3), (0, 3)):
        assert_uniform(np.bincount(cell[:, a] * 16 + cell[:, b], minlength=256), 8, f"dimensions {a} and {b}")
    assert_uniform(np.bincount(cell[:-1, 0] * 16 + cell[1:, 0], minlength=256), 8, "a pixel and the next")


@entry
def _opposite(numbers, out):
    for i in range(len(out)):
        out[i, 0], out[i, 1], out[i, 2] = opposite((numbers[i, 0], numbers[i, 1], numbers[i, 2]))


def _opposites(own):
    out = np.empty((len(own), 3), np.float32)
    _opposite(own, out)
    return out


@pytest.mark.parametrize("kind", [SOBOL, INDEPENDENT])
def test_opposite_points_are_uniform_and_distinct(kind):
    own = numbers(sample=np.arange(1 << 14), block=2, kind=kind)[:, :3]
    others = _opposites(own)
    assert ((others >= 0) & (others < 1)).all()
    assert (abs(others - own).max(axis=1) > 0.1).all()
    np.testing.assert_array_equal(_opposites(others), own)
    for column in others.T:
        assert scipy.stats.kstest(column, "uniform").pvalue > 1e-4


def test_opposite_points_are_stratified_with_the_originals():
    """A pixel's points and their opposites together are stratified, in most divisions into as many rectangles as points."""
    found = []
    for power in range(9):
        own = numbers(x=5, y=9, sample=np.arange(2**power), block=2, kind=SOBOL)[:, :3]
        both = np.concatenate([own, _opposites(own)])
        for wide in range(power + 2):
            cells = np.floor(both[:, 0] * 2**wide) * 2 ** (power + 1 - wide) + np.floor(both[:, 1] * 2 ** (power + 1 - wide))
            found.append(len(np.unique(cells)) == len(both))
    assert np.mean(found) > 2 / 3
