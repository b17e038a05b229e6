"""Tests of the warning about pictures that look black although they contain light.

The warning states the exposure that makes the brightest parts white.
"""

from __future__ import annotations

import numpy as np
import pytest

from renderer.image.darkness import darkness


@pytest.mark.parametrize(("brightest", "exposure"), [(0.0003, 11.5), (1e-5, 16.5), (2**-8, 8.0)])
def test_dark_picture_exposure_maps_highlights_to_white(brightest: float, exposure: float) -> None:
    picture = np.linspace(0, 1, 300).reshape(10, 10, 3).astype(np.float32) ** 0.0 * np.float32(brightest)
    picture[:5] *= 0.1
    found = darkness(picture)
    assert found is not None and found.exposure == exposure
    assert found.brightest == pytest.approx(brightest)
    assert 0.7 < brightest * 2**found.exposure <= 1


def test_fireflies_and_black_pictures_are_not_dark() -> None:
    picture = np.full((40, 40, 3), 1e-4, np.float32)
    picture[0, 0] = 50, np.nan, np.inf
    assert darkness(picture) is not None, "one pixel lights nothing"
    assert darkness(np.full((4, 4, 3), 0.02, np.float32)) is None
    assert darkness(np.zeros((4, 4, 3), np.float32)) is None
