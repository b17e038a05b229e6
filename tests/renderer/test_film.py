"""Tests of the film's arithmetic on made-up sums: its planes, mean, digest, noise and error."""

import hashlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from renderer.film import (
    CHANNELS,
    COLOR,
    COLOR_HALF,
    DEPTH,
    NORMAL,
    SAMPLE_MAX,
    SAMPLES,
    SAMPLES_HALF,
    alpha,
    alpha_plane,
    digest,
    error,
    in_half,
    mean,
    noise,
    plane_count,
)
from renderer.settings import MAX_SPP

EXPONENT = 24


def film_of(values, height=2, width=3):
    """Returns the film sums of samples with values (n, height, width, 3), numbered from 0."""
    fixed = np.rint(np.asarray(values, np.float64) * 2.0**EXPONENT).astype(np.int64)
    sums = np.zeros((CHANNELS, height, width), np.int64)
    sums[COLOR] = np.moveaxis(fixed.sum(0), -1, 0)
    half = np.array([in_half(i) for i in range(len(fixed))])
    sums[COLOR_HALF] = np.moveaxis(fixed[half].sum(0), -1, 0)
    sums[SAMPLES] = len(fixed)
    sums[SAMPLES_HALF] = half.sum()
    return sums


def test_planes_do_not_overlap_and_fill_the_film():
    from renderer import film

    planes = [film.COLOR, film.COLOR_HALF, film.ALBEDO, film.NORMAL, film.POSITION]
    used = [i for plane in planes for i in range(plane.start, plane.stop)]
    used += [DEPTH, SAMPLES, SAMPLES_HALF, film.OBJECT, film.MATERIAL]
    assert sorted(used) == list(range(CHANNELS))


def test_no_sum_can_overflow():
    assert int(SAMPLE_MAX) * 2**EXPONENT * MAX_SPP <= 2**62


def test_mean_shapes_and_types():
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


def test_mean_divides_by_finite_samples():
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
    """The noise estimate equals NumPy's standard error in expectation over many pixels, also for halves of unequal size."""
    rng = np.random.default_rng(seed)
    spread, level, side = 0.3, 2.0, 64
    values = level + spread * rng.standard_normal((n, side, side, 3))
    found = noise(film_of(values, side, side), EXPONENT)
    expected = spread / np.sqrt(n) / level
    pixels = 3 * side * side  # the root mean square of that many normal variates
    assert found == pytest.approx(expected, rel=5 / np.sqrt(2 * pixels))


def test_noise_is_unknown_where_a_half_is_empty():
    assert noise(film_of(np.ones((1, 2, 3, 3))), EXPONENT) == np.inf
    sums = film_of(np.ones((4, 2, 3, 3)))
    sums[SAMPLES, 1, 1] = sums[SAMPLES_HALF, 1, 1] = 0
    assert noise(sums, EXPONENT) == np.inf
    assert noise(np.zeros((CHANNELS, 0, 0), np.int64), EXPONENT) == np.inf


def test_noise_of_a_black_picture_is_zero():
    assert noise(film_of(np.zeros((4, 2, 3, 3))), EXPONENT) == 0


def test_halves_are_balanced_for_powers_of_two():
    assert [i for i in range(20) if in_half(i)] == [0, 2, 4, 5, 8, 9, 10, 11, 16, 17, 18, 19]
    for k in range(1, 12):
        assert sum(map(in_half, range(1 << k))) == 1 << (k - 1)


@pytest.mark.parametrize("n", [2, 3, 7, 64])
def test_error_is_the_standard_error_of_each_pixels_luminance(n):
    spread, level, side = np.array([0.3, 0.1, 0.2]), 2.0, 96
    values = level + spread * np.random.default_rng(n).standard_normal((n, side, side, 3))
    sums = film_of(values, side, side)
    expected = np.sqrt(((spread * (0.2126, 0.7152, 0.0722)) ** 2).sum() / n)
    found = error(sums, EXPONENT)
    assert found.shape == (side, side)
    assert found.dtype == np.float32
    assert np.sqrt((found.astype(float) ** 2).mean()) == pytest.approx(expected, rel=5 / np.sqrt(2 * side * side))
    np.testing.assert_allclose(
        error(sums, EXPONENT, relative=True), found / (mean(sums, EXPONENT) @ (0.2126, 0.7152, 0.0722)), 1e-5
    )


def test_error_is_infinite_where_unknown_and_zero_where_all_samples_agree():
    assert (error(np.zeros((CHANNELS, 2, 2), np.int64), EXPONENT) == np.inf).all()
    assert (error(film_of(np.ones((1, 2, 3, 3))), EXPONENT) == np.inf).all()
    assert (error(film_of(np.zeros((4, 2, 3, 3))), EXPONENT, relative=True) == 0).all()
    assert (error(film_of(np.ones((4, 2, 3, 3))), EXPONENT, relative=True) == 0).all()


def test_alpha_is_the_coverage_and_the_blocked_part_of_what_catches_shadows() -> None:
    """Half of the samples cover; a quarter of them are on a catcher of which three quarters of the light are blocked."""
    sums = np.zeros((plane_count(1, True), 1, 4), np.int64)
    first, one = alpha_plane(1), 1 << EXPONENT
    sums[SAMPLES] = (8, 8, 8, 0)
    sums[first] = (4 * one, 8 * one, 0, 0)
    sums[first + 1] = (2 * one, 0, 8 * one, 0)
    sums[first + 2] = (40, 0, 0, 0)  # without light nothing is blocked
    sums[first + 3] = (10, 0, 0, 0)
    assert alpha(sums, EXPONENT, 1).tolist() == [[0.5 + 0.25 * 0.75, 1, 0, 0]]
    sums[first + 3] = 50  # more than without occlusion, by rounding
    assert alpha(sums, EXPONENT, 1)[0, 0] == 0.5
