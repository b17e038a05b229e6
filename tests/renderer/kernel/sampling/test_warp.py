"""Tests that samples of each square_to_x follow the density square_to_x_pdf, by chi-squared."""

import numpy as np
import pytest

from renderer.jit import entry
from renderer.kernel.sampling import warp
from tests.renderer.judge import assert_uniform, direction_test

N = 400_000
TESTS = 8


@entry
def _sample(which, one_minus_cos, u, out):
    for i in range(len(u)):
        pair = (u[i, 0], u[i, 1])
        if which == 0:
            out[i, 0], out[i, 1], out[i, 2] = warp.square_to_cosine_hemisphere(pair)
        elif which == 1:
            out[i, 0], out[i, 1], out[i, 2] = warp.square_to_sphere(pair)
        elif which == 2:
            out[i, 0], out[i, 1], out[i, 2] = warp.square_to_cone(pair, one_minus_cos)
        elif which == 3:
            out[i, 0], out[i, 1] = warp.square_to_disk(pair)
        else:
            out[i, 0], out[i, 1] = warp.square_to_triangle(pair)


@entry
def _density(which, one_minus_cos, w, out):
    for i in range(len(w)):
        direction = (w[i, 0], w[i, 1], w[i, 2])
        if which == 0:
            out[i] = warp.square_to_cosine_hemisphere_pdf(direction)
        elif which == 1:
            out[i] = warp.square_to_sphere_pdf(direction)
        elif which == 2:
            inside = w[i, 2] >= np.float32(1.0) - one_minus_cos
            out[i] = warp.square_to_cone_pdf(one_minus_cos) if inside else np.float32(0.0)
        else:
            out[i] = warp.square_to_disk_pdf((w[i, 0], w[i, 1]))


def sample(which, cone=0.0, seed=0):
    u = np.random.default_rng(seed).random((N, 2), np.float32)
    u[:8] = [(0, 0), (0.5, 0.5), (1 - 2**-24, 1 - 2**-24), (0, 1 - 2**-24), (1 - 2**-24, 0), (0.5, 0), (0, 0.5), (0.25, 0.75)]
    out = np.zeros((N, 3), np.float32)
    _sample(which, np.float32(cone), u, out)
    assert np.isfinite(out).all()
    return out


def density(which, cone=0.0):
    def values(w):
        out = np.empty(len(w), np.float32)
        _density(which, np.float32(cone), np.ascontiguousarray(w), out)
        return out

    return values


@pytest.mark.parametrize(("which", "name"), [(0, "cosine hemisphere"), (1, "sphere")])
def test_directions_follow_their_density(which, name):
    directions = sample(which)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-6)
    direction_test(directions, density(which), TESTS, name=name)
    assert which == 1 or directions[:, 2].min() >= 0


@pytest.mark.parametrize("cone", [0.25, 1.0, 1.75])
def test_directions_in_a_cone_follow_their_density(cone):
    """Directions in a cone follow their density, for cones whose rim coincides with a border of bins."""
    directions = sample(2, cone)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-6)
    direction_test(directions, density(2, cone), TESTS, name=f"cone {cone}")


def test_narrow_cone_is_uniform():
    """For a distant sun, 1 - cos = 1e-10, directions are uniform in 1 - z, computed as half the squared sine."""
    directions = sample(2, 1e-10).astype(float)
    square = (directions[:, 0] ** 2 + directions[:, 1] ** 2) / 2e-10
    assert square.max() <= 1 + 1e-5
    assert_uniform(np.histogram(square, 64, (0, 1 + 1e-5))[0], TESTS)
    assert_uniform(np.histogram(np.arctan2(directions[:, 1], directions[:, 0]), 64, (-np.pi, np.pi))[0], TESTS)


def test_disk_and_triangle_points_are_uniform_by_area():
    x, y = sample(3).T[:2].astype(float)
    radius = x * x + y * y
    assert radius.max() <= 1 + 1e-6
    cells = np.minimum((radius * 32).astype(int), 31) * 32 + np.minimum(
        ((np.arctan2(y, x) / (2 * np.pi) + 0.5) * 32).astype(int), 31
    )
    assert_uniform(np.bincount(cells, minlength=1024), TESTS, "disk")
    b, c = sample(4).T[:2].astype(float)
    assert b.min() >= 0
    assert c.min() >= 0
    assert (b + c).max() <= 1 + 1e-6
    # Splits each triangle into four by its edges' midpoints, three times: 64 cells of equal area.
    a, cell = np.maximum(1 - b - c, 0), np.zeros(N, int)
    for _ in range(3):
        place = np.select([a >= 0.5, b >= 0.5, c >= 0.5], [0, 1, 2], 3)
        cell = 4 * cell + place
        a, b, c = (np.where(place == 3, 1 - 2 * w, np.where(place == k, 2 * w - 1, 2 * w)) for k, w in enumerate((a, b, c)))
    assert_uniform(np.bincount(cell, minlength=64), TESTS, "triangle")


def test_densities_integrate_to_one():
    side = (np.arange(2000) + 0.5) / 1000 - 1
    x, y = np.meshgrid(side, side)
    flat = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], 1).astype(np.float32)
    assert density(3)(flat).astype(float).mean() * 4 == pytest.approx(1, abs=1e-3)
    assert warp.square_to_triangle_pdf.py_func(np.float32(0.25)) == 4
