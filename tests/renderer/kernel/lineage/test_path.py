"""Tests of the path integrator: path depth, light leaks through walls, and independence of scale."""

import numpy as np
import pytest

from renderer.film import COLOR, mean
from renderer.jit import entry
from renderer.kernel.lineage.strategy import heuristic_weight
from renderer.render import render_frame
from renderer.scene.description import Material, Sphere
from renderer.settings import HEURISTICS
from tests.grids import grid
from tests.renderer.builders import box, emitter, gray, icosphere, scene, settings, square
from tests.renderer.judge import assert_mean, mean_and_error


def test_colored_furnace_per_channel():
    wall = Material(base_color=(0.5, 0.8, 0.2), emission=(0.5, 0.2, 0.8), double_sided=True)
    sums = render_frame(scene([wall], (icosphere(1),)), settings((0.1, 0.2, 0.3), (1, 0, 0), 90, max_depth=100), 256)
    for channel in range(3):
        single = sums.copy()
        single[0:3] = sums[channel]
        single[3:6] = sums[3 + channel]
        assert_mean(single, 1.0, tests=3, slack=1e-4)


def test_max_depth_1_shows_only_visible_emission():
    floor = square((0, -1, 0), (50, 0, 0), (0, 0, -50), 0)
    light = square((0, 0, -1), (1, 0, 0), (0, 1, 0), 1)
    small = scene([Material(base_color=gray(0.8)), Material(emission=(3.0, 2.0, 1.0))], (floor, light), environment=0.25)
    asked = settings((0, 0, 4), (0, 0, 0), 50, size=32, max_depth=1)
    picture = mean(render_frame(small, asked, 4), 24)
    assert (picture[16, 16] == (3, 2, 1)).all()
    assert (picture[0, 0] == 0.25).all()
    assert (picture[31, 16] == 0).all()


@grid("scale", [2.0**-10, 1.0, 2.0**10], ordinary=(1.0,))
@pytest.mark.parametrize("mesh", [icosphere, box])
def test_no_light_leaks_into_a_closed_mesh(mesh, scale):
    """A closed mesh under a sky of radiance 1e6 stays black: none of 800,000 paths leaks at walls, edges or corners."""
    closed = icosphere(2, scale=scale) if mesh is icosphere else box(0, scale)
    dark = scene([Material(base_color=gray(0.9))], (closed,), environment=1e6)
    eye, target = np.array((0.1, 0.2, 0.3)) * scale, np.array((0.5, 0.1, 1.0)) * scale
    sums = render_frame(dark, settings(tuple(eye), tuple(target), 120, size=40, max_depth=8), 64)
    assert not sums[COLOR].any()


def test_few_paths_leak_where_coordinates_are_coarse():
    """Few paths leak from a closed mesh at 300 from the origin, where float32 has a step of 1.5e-5.

    Points that close to an edge may be rounded across it.
    """
    closed = box(0, center=(300, 300, 300))
    dark = scene([Material(base_color=gray(0.9))], (closed,), environment=1.0)
    sums = render_frame(dark, settings((300.1, 300.2, 300.3), (300.5, 300.1, 301), 120, size=40, max_depth=8), 64)
    assert mean_and_error(sums)[0] < 1e-4


def test_scaling_by_a_power_of_two_keeps_the_bits():
    """Scaling by a power of two changes only exponents, so equal bits show that no absolute length is used."""
    pictures = []
    for s in (2.0**-10, 1.0, 2.0**10):
        materials = [
            Material(base_color=(0.7, 0.6, 0.5)),
            Material(kind="glass", base_color=gray(1.0)),
            Material(kind="metallic_roughness", metallic=1.0, roughness=0.4),
            emitter(20.0),
        ]
        meshes = (
            square((0, 0, 0), (20 * s, 0, 0), (0, 0, -20 * s), 0),
            box(0, s, (0, s, 0)),
            square((0, 4 * s, 0), (s, 0, 0), (0, 0, s), 3),
        )
        spheres = (Sphere((2 * s, s, 0), s, 1), Sphere((-2.5 * s, s, 0), s, 2))
        asked = settings((0, 3 * s, 8 * s), (0, s, 0), 40, size=32)
        pictures.append(render_frame(scene(materials, meshes, spheres, environment=0.3), asked, 16)[COLOR])
    assert pictures[1].any()
    np.testing.assert_array_equal(pictures[0], pictures[1])
    np.testing.assert_array_equal(pictures[2], pictures[1])


@entry
def _weights(a, b, weight):
    for h in range(len(weight)):
        for i in range(len(a)):
            weight[h, i] = heuristic_weight(h, a[i], b[i])


def weights(a, b):
    """Returns the MIS weights (heuristics, N) of samples with pdf a, which another strategy samples with pdf b."""
    weight = np.empty((len(HEURISTICS), len(a)), np.float32)
    _weights(a, b, weight)
    return weight


def pairs(*densities):
    return (grid.ravel() for grid in np.meshgrid(np.float32(densities), np.float32(densities)))


def test_the_weights_of_two_strategies_sum_to_one():
    a, b = pairs(1e-6, 0.3, 1, 30, 1e6)
    np.testing.assert_array_equal(weights(a, np.zeros_like(a)), 1)
    np.testing.assert_allclose(weights(a, b) + weights(b, a), 1.0, atol=1e-6)
    of_two = dict(zip(HEURISTICS, weights(np.float32([2]), np.float32([1]))[:, 0], strict=True))
    assert of_two == {"power": pytest.approx(4 / 5), "balance": pytest.approx(2 / 3)}


def test_weights_of_huge_densities_are_finite():
    for weight in weights(*pairs(0, 1e-30, 1, 1e30, np.inf)):
        assert ((weight >= 0) & (weight <= 1)).all()
