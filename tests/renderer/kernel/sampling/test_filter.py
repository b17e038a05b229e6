"""Tests of pixel filters: samples are distributed as the filter, and a point's picture has the filter's shape."""

import numpy as np
import pytest
import scipy.integrate

from renderer.film import COLOR, mean
from renderer.jit import entry
from renderer.kernel.sampling.filter import BLACKMAN_HARRIS, BOX, RADIUS, TENT, blackman_harris, filter_offset
from renderer.render import render_frame
from renderer.scene.description import Material
from tests.renderer.builders import emitter, gray, scene, settings, square
from tests.renderer.judge import chi_squared

SHAPES = {
    "blackman-harris": (BLACKMAN_HARRIS, RADIUS, blackman_harris),
    "tent": (TENT, 1.0, lambda x: np.maximum(1 - np.abs(x), 0)),
    "box": (BOX, 0.5, lambda x: (np.abs(x) <= 0.5).astype(float)),
}


@entry
def _offsets(kind, u, out):
    for i in range(len(u)):
        out[i] = filter_offset(kind, u[i])


def offsets(kind, u):
    out = np.empty(len(u), np.float32)
    _offsets(kind, u.astype(np.float32), out)
    return out


@pytest.mark.parametrize("name", SHAPES)
def test_offsets_follow_the_filter(name):
    kind, radius, shape = SHAPES[name]
    n, bins = 1 << 20, 200
    found = offsets(kind, np.random.default_rng(1).random(n, np.float32) * np.float32(1 - 2.0**-24))
    assert np.abs(found).max() <= radius
    edges = np.linspace(-radius, radius, bins + 1)
    fine = np.linspace(-radius, radius, bins * 64 + 1)
    weight = scipy.integrate.cumulative_simpson(shape(fine), x=fine, initial=0)[::64]
    chi_squared(np.histogram(found, edges)[0], np.diff(weight) / weight[-1] * n, len(SHAPES), name)


@pytest.mark.parametrize("name", SHAPES)
def test_offsets_rise_with_u_and_are_symmetric(name):
    """Offsets increase with u, which preserves stratification, and are symmetric, so that no filter shifts the picture."""
    kind, radius, _ = SHAPES[name]
    u = np.arange(1, 4096) / 4096
    found = offsets(kind, u)
    assert (np.diff(found) > 0).all()
    np.testing.assert_allclose(found, -found[::-1], atol=2e-6)
    assert offsets(kind, np.array([0.0, 1 - 2.0**-24])) == pytest.approx([-radius, radius], abs=3e-3)


@pytest.mark.parametrize("name", SHAPES)
def test_a_small_light_is_spread_over_its_neighbours_by_the_filters_integral(name):
    """An emitter of 1/40 pixel at a pixel's centre gives each neighbouring pixel the filter's value at its distance."""
    _, _, shape = SHAPES[name]
    size, spp = 5, 4096
    pixel = 2 * np.tan(np.radians(10) / 2) / size * 10  # a pixel's size at distance 10
    side = pixel / 80
    lit = scene([emitter(1000.0), Material(base_color=gray(0))], (square((0, 0, 0), (side, 0, 0), (0, side, 0), 0),))
    asked = settings((0, 0, 10), (0, 0, 0), 10, size=size, max_depth=1, filter=name)
    picture = mean(render_frame(lit, asked, spp), 24)[..., 0].astype(float)
    x = np.arange(size) - size // 2
    norm = scipy.integrate.quad(shape, -1, 1, points=[-RADIUS, -0.5, 0.5, RADIUS], limit=200)[0]
    expected = np.outer(shape(x) / norm, shape(x) / norm) * 1000 / 40**2
    hits = expected * spp / 1000
    error = np.sqrt(np.maximum(hits, 1)) / spp * 1000
    assert (np.abs(picture - expected) < 4 * error).all()


def test_filters_differ_and_preserve_energy():
    even = scene([Material(base_color=gray(0.5))], environment=0.7, meshes=(square((0, -9, 0), (9, 0, 0), (0, 0, -9), 0),))
    pictures = [render_frame(even, settings((0, 0, 0), (0, 1, 0), 30, size=8, filter=name), 4)[COLOR] for name in SHAPES]
    for picture in pictures:  # the pictures show only sky
        assert (picture == picture[0, 0, 0]).all()
