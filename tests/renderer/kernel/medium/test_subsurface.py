"""Tests of the albedo of a subsurface medium, which is derived from the colour that the surface shall have."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.jit import entry
from renderer.kernel.medium.subsurface import albedo_of
from tests.renderer.half_space import diffuse_reflectance


@entry
def _albedo(color, g, found):
    for i in range(len(color)):
        found[i] = albedo_of((color[i], color[i], color[i]), g)[0]


def albedo(color: np.ndarray, g: float = 0.0) -> np.ndarray:
    found = np.empty(len(color), np.float32)
    _albedo(np.array(color, np.float32), np.float32(g), found)
    return found.astype(float)


def test_half_space_reflects_the_requested_color() -> None:
    """A half-space of a medium with the derived albedo has the requested colour within 0.005, van de Hulst's stated accuracy.

    The half-space's reflectance is computed by Chandrasekhar's H function.
    """
    color = np.linspace(0.05, 0.95, 10)
    found = [diffuse_reflectance(each) for each in albedo(color)]
    assert found == pytest.approx(color, abs=0.005)


def test_albedo_of_black_and_white() -> None:
    for g in (-0.5, 0.0, 0.9):
        black, white = albedo(np.array((0.0, 1.0)), g)
        assert black == pytest.approx(0.0, abs=1e-3)
        assert white == pytest.approx(1.0, abs=1e-6)
    assert (np.diff(albedo(np.linspace(0, 1, 50), 0.5)) > 0).all()
