"""Tests of drafts: their codes, and what smoothing keeps and removes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.film import ALBEDO, CHANNELS, COLOR, DEPTH, MATERIAL, NORMAL, POSITION, SAMPLES, Sums
from renderer.kernel.draft import DRAFT_STOPS
from renderer.kernel.draft_of_film import draft_of

EXPONENT, HEIGHT, WIDTH = 20, 48, 64


def codes_of(film: Sums, *, is_smooth: bool = False) -> npt.NDArray[np.uint8]:
    """Returns the codes of a film's draft, (3, h, w)."""
    words = draft_of(film, EXPONENT, is_smooth=is_smooth)
    assert (words >> 24 == 0).all()
    return np.moveaxis(words.view(np.uint8).reshape(*words.shape, 4), -1, 0)[:3]


def radiance_of(codes: npt.NDArray[np.uint8]) -> npt.NDArray[np.float64]:
    return (2.0 ** (codes * (DRAFT_STOPS / 255)) - 1) / 255


def noisy_wall(seed: int) -> Sums:
    """Returns the film of one sample per pixel of a white wall that faces the camera, of radiance 0.5 on average."""
    rng = np.random.default_rng(seed)
    film = np.zeros((CHANNELS, HEIGHT, WIDTH), np.int64)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    film[COLOR] = np.rint(rng.exponential(0.5, (HEIGHT, WIDTH)) * 2**EXPONENT)
    film[ALBEDO], film[NORMAL.stop - 1], film[DEPTH] = 2**EXPONENT, 2**EXPONENT, 5 * 2**EXPONENT
    film[POSITION] = np.stack([x * 2**EXPONENT // 100, y * 2**EXPONENT // 100, np.zeros_like(x)])
    film[SAMPLES] = film[MATERIAL] = 1
    return film


def test_codes_are_the_nearest_on_a_logarithmic_scale() -> None:
    rng = np.random.default_rng(3)
    film = np.zeros((CHANNELS, 40, 50), np.int64)
    film[COLOR] = np.rint(2.0 ** (rng.uniform(-14, 6, (3, 40, 50)) + EXPONENT))
    film[SAMPLES] = rng.integers(0, 5, (40, 50))
    film[0, :10] *= -1
    codes = codes_of(film)
    exact = 255 * np.log2(1 + 255 * np.maximum(film[COLOR] * 2.0**-EXPONENT / np.maximum(film[SAMPLES], 1), 0)) / DRAFT_STOPS
    assert (np.abs(codes - np.minimum(exact, 255)) < 0.5001).all()
    assert (codes == 255).any()


def test_smoothing_removes_noise() -> None:
    """The radiance of a wall stays what it is on average, and varies a twelfth as much."""
    film = noisy_wall(5)
    raw, smooth = radiance_of(codes_of(film)), radiance_of(codes_of(film, is_smooth=True))
    assert abs(smooth.mean() / raw.mean() - 1) < 0.1
    assert smooth.std() < raw.std() / 12


def test_smoothing_keeps_edges_and_textures() -> None:
    """Two sides of one picture with light of 0.5 and 0.05 differ in one guide each; a texture and the background stay sharp."""
    right = np.s_[:, WIDTH // 2 :]
    for plane, value in ((NORMAL.start, 2**EXPONENT), (POSITION.stop - 1, 2**EXPONENT), (MATERIAL, 2)):
        film = noisy_wall(6)
        film[COLOR][:, *right] //= 10
        film[plane][right] = value
        codes = radiance_of(codes_of(film, is_smooth=True))
        assert codes[:, :, : WIDTH // 2].min() > 0.25 and codes[:, :, WIDTH // 2 :].max() < 0.1, plane
    film = noisy_wall(7)
    dark = (np.mgrid[:HEIGHT, :WIDTH].sum(0) % 2).astype(bool)
    film[COLOR][:, dark] //= 4
    film[ALBEDO][:, dark] //= 4
    texture = radiance_of(codes_of(film, is_smooth=True))
    np.testing.assert_allclose(texture[:, ::2, 1::2] * 4, texture[:, ::2, ::2], rtol=0.2)
    film[DEPTH] = 0
    np.testing.assert_array_equal(codes_of(film, is_smooth=True), codes_of(film))


def test_smoothing_of_pixels_without_samples_gives_black() -> None:
    film = noisy_wall(8)
    film[:, 20:24, 30:34] = 0
    codes = codes_of(film, is_smooth=True)
    assert (codes[:, 20:24, 30:34] == 0).all()
    assert codes[:, 16, 28].min() > 100, "and does not darken what is beside them"
