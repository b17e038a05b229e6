"""Tests that each pixel of a downscaled picture is the mean of a square of pixels, however the picture is divided into bands."""

from __future__ import annotations

import numpy as np
import pytest

from service.watching.downscale import reduced_bands, square_side

PICTURE = np.random.default_rng(3).random((37, 50, 3), np.float32)


@pytest.mark.parametrize("rows", [1, 4, 16, 37])
@pytest.mark.parametrize("side", [1, 2, 5, 37])
def test_squares_across_bands_are_averaged(rows: int, side: int) -> None:
    found = np.concatenate(list(reduced_bands((PICTURE[y : y + rows] for y in range(0, 37, rows)), side)))
    h, w = 37 // side, 50 // side
    expected = PICTURE[: h * side, : w * side].reshape(h, side, w, side, 3).mean(axis=(1, 3), dtype=np.float64)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_dtype_is_preserved() -> None:
    (band,) = reduced_bands([np.full((4, 4, 3), 201, np.uint8)], 2)
    assert band.dtype == np.uint8
    assert (band == 201).all()


@pytest.mark.parametrize(("wanted", "side"), [(None, 1), (100, 1), (26, 1), (25, 2), (16, 3), (1, 30)])
def test_copy_has_minimum_width(wanted: int | None, side: int) -> None:
    assert square_side(wanted, 50, 30) == side
