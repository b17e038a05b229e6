"""The film's arithmetic, on sums made by hand."""

import hashlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from renderer.film import (
    CHANNELS,
    COLOR,
    COLOR_EVEN,
    DEPTH,
    NORMAL,
    SAMPLE_MAX,
    SAMPLES,
    SAMPLES_EVEN,
    digest,
    mean,
    noise,
)
from renderer.settings import MAX_SPP

EXPONENT = 24


def film_of(values, height=2, width=3):
    """Sums of the samples (n, height, width, 3), numbered from 0."""
    fixed = np.rint(np.asarray(values, np.float64) * 2.0**EXPONENT).astype(np.int64)
    sums = np.zeros((CHANNELS, height, width), np.int64)
    sums[COLOR] = np.moveaxis(fixed.sum(0), -1, 0)
    sums[COLOR_EVEN] = np.moveaxis(fixed[::2].sum(0), -1, 0)
    sums[SAMPLES] = len(fixed)
    sums[SAMPLES_EVEN] = len(fixed[::2])
    return sums


def test_planes_do_not_overlap_and_fill_the_film():
    from renderer import film

    planes = [film.COLOR, film.COLOR_EVEN, film.ALBEDO, film.NORMAL, film.POSITION]
    used = [i for plane in planes for i in range(plane.start, plane.stop)]
    used += [DEPTH, SAMPLES, SAMPLES_EVEN, film.OBJECT, film.MATERIAL]
    assert sorted(used) == list(range(CHANNELS))


def test_no_sum_can_overflow():
    assert int(SAMPLE_MAX) * 2**EXPONENT * MAX_SPP <= 2**62


def test_mean_has_the_shapes_and_types_it_says():
    sums = film_of(np.full((4, 2, 3, 3), 0.25))
    sums[DEPTH] = 4 * 3 << EXPONENT
    assert mean(sums, EXPONENT).shape == (2, 3, 3)
    assert mean(sums, EXPONENT).dtype == np.float32
    assert (mean(sums, EXPONENT) == 0.25).all()
    assert mean(sums, EXPONENT, NORMAL).shape == (2, 3, 3)
    assert mean(sums, EXPONENT, DEPTH).shape == (2, 3)
    assert (mean(sums, EXPONENT, DEPTH) == 3).all()


def test_mean_is_zero_without_samples():
    assert (mean(np.zeros((CHANNELS, 2, 2), np.int64), EXPONENT) == 0).all()


def test_mean_divides_by_the_samples_that_count():
    sums = film_of(np.ones((4, 1, 2, 3)), 1, 2)
    sums[SAMPLES, 0, 1] = 2
    np.testing.assert_array_equal(mean(sums, EXPONENT)[0, :, 0], [1, 2])


def test_digest_is_the_sha256_of_the_little_endian_planes():
    sums = np.arange(CHANNELS * 6, dtype=np.int64).reshape(CHANNELS, 2, 3)
    assert digest(sums) == hashlib.sha256(sums.astype("<i8").tobytes()).hexdigest()
    assert digest(np.asfortranarray(sums)) == digest(sums)
    for plane in range(CHANNELS):
        other = sums.copy()
        other[plane, 1, 2] += 1
        assert digest(other) != digest(sums)


@given(st.integers(2, 9), st.integers(0, 2**32 - 1))
def test_noise_is_the_standard_error_of_the_mean(n, seed):
    """Against numpy, for halves of unequal size too: in expectation, over many pixels of independent noise."""
    rng = np.random.default_rng(seed)
    spread, level, side = 0.3, 2.0, 64
    values = level + spread * rng.standard_normal((n, side, side, 3))
    found = noise(film_of(values, side, side), EXPONENT)
    expected = spread / np.sqrt(n) / level
    pixels = 3 * side * side  # the root of a mean of squares of that many normal numbers
    assert found == pytest.approx(expected, rel=5 / np.sqrt(2 * pixels))


def test_noise_is_unknown_where_a_half_is_empty():
    assert noise(film_of(np.ones((1, 2, 3, 3))), EXPONENT) == np.inf
    sums = film_of(np.ones((4, 2, 3, 3)))
    sums[SAMPLES, 1, 1] = sums[SAMPLES_EVEN, 1, 1] = 0
    assert noise(sums, EXPONENT) == np.inf
    assert noise(np.zeros((CHANNELS, 0, 0), np.int64), EXPONENT) == np.inf


def test_noise_of_a_black_picture_is_zero():
    assert noise(film_of(np.zeros((4, 2, 3, 3))), EXPONENT) == 0
