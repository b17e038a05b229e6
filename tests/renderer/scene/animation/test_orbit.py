"""Tests of the camera of a turntable animation, which orbits about an axis at constant distance and height."""

import numpy as np
import pytest

from renderer.scene.animation.orbit import orbit
from renderer.settings import View


def test_quarter_turn_is_counter_clockwise():
    view = View((0, 2, 5), (0, 1, 0))
    quarter = orbit(view, 0.25)
    np.testing.assert_allclose(quarter.eye, (5, 2, 0), atol=1e-15)
    assert quarter.target == view.target
    np.testing.assert_allclose(orbit(view, 1.5).eye, (0, 2, -5), atol=1e-14)


def test_full_turn_returns_exactly_to_the_start():
    view = View((3.3, 1.7, 5.1), (0.1, 1, 0.2), (0.1, 1, 0))
    assert orbit(view, 0) == orbit(view, 7) == view


@pytest.mark.parametrize("axis", [(0, 0, 2), (1, 1, 0), (0, 1, 0)])
def test_orbit_keeps_distance_height_and_roll(axis):
    view = View((3, 2, 1), (1, 0, 1), (0.2, 1, 0.1))
    unit = np.array(axis) / np.linalg.norm(axis)
    for turns in (0.1, 0.6):
        moved = orbit(view, turns, axis)
        before, after = np.subtract(view.eye, view.target), np.subtract(moved.eye, moved.target)
        assert np.linalg.norm(after) == pytest.approx(np.linalg.norm(before), rel=1e-14)
        assert after @ unit == pytest.approx(before @ unit, abs=1e-14)
        assert np.dot(moved.up, after) == pytest.approx(np.dot(view.up, before), rel=1e-13)
    # Turning twice by 0.1 equals turning once by 0.2.
    np.testing.assert_allclose(orbit(orbit(view, 0.1, axis), 0.1, axis).eye, orbit(view, 0.2, axis).eye, atol=1e-14)
