"""Tests of aiming at targets: directions follow their density, and a picture's mean is that of the BSDF's directions alone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from renderer.arrays.kernel_variant import strip_absent_features
from renderer.jit import entry
from renderer.kernel.options import kernel_options
from renderer.kernel.sampling.sphere_cone import sample_sphere_direction, sphere_direction_pdf
from renderer.kernel.steps.aim import NOT_AIMED, aim, mixture_pdf, targets_in_view
from renderer.kernel.steps.state import LastVertex
from renderer.kernel.surface.surface import NO_OBJECT
from renderer.render import render_frame
from renderer.scene.description import Material, Sphere
from renderer.settings import View
from tests.grids import grid
from tests.renderer.builders import emitter, gray, scene, settings, square
from tests.renderer.judge import direction_test, limit, mean_and_error
from tests.renderer.kernel.backends.features import FEATURES, made

N = 200_000
LAMPS = (Sphere((0.2, 1.4, 0.1), 0.5, 1), Sphere((0.2, 1.4, 0.1), 0.1, 2), Sphere((-1.5, 0.5, 1.0), 0.6, 3, guide=True))
MATERIALS = [Material(base_color=gray(0.5)), Material(kind="glass", roughness=0.0), emitter(50.0), Material(kind="mirror")]
ROOM = scene(MATERIALS, (square((0, 0, 0), (3, 0, 0), (0, 0, -3), 0),), LAMPS)
UP, EVERY_SIDE = (0.0, 1.0, 0.0), (0.0, 0.0, 0.0)
# Point and normal of a vertex: with all targets in view, with one behind the surface, and within the guard sphere of one.
VERTICES = [((0.9, 0.0, 0.8), UP), ((-0.7, 0.3, 1.0), (1.0, 0.0, 0.0)), ((0.2, 1.2, 0.3), EVERY_SIDE)]
_SURFACE, _NO = np.bool_(True), np.bool_(False)
AIMED = [name for name in FEATURES if name.startswith("lamps in glass")]
DOWN = View((0.0, 1.6, 5.0), (0.0, -0.3, 0.9), fov=30)  # the lamps are out of the picture


@entry
def _aim(made, point, normal, material, options, choose, u, direction):
    """Writes the direction of each choice; NaN where the vertex does not aim."""
    last = LastVertex((point[0], point[1], point[2]), (normal[0], normal[1], normal[2]), NO_OBJECT)
    targets = targets_in_view(made, last, material, _NO, _SURFACE, options)
    for i in range(len(u)):
        found = aim(made, last, targets, choose[i], (u[i, 0], u[i, 1]))
        for k in range(3):
            direction[i, k] = found.direction[k] if found.is_aimed else np.float32(np.nan)


@entry
def _density(made, point, normal, material, options, direction, pdf):
    last = LastVertex((point[0], point[1], point[2]), (normal[0], normal[1], normal[2]), NO_OBJECT)
    targets = targets_in_view(made, last, material, _NO, _SURFACE, options)
    for i in range(len(direction)):
        d = (direction[i, 0], direction[i, 1], direction[i, 2])
        pdf[i] = mixture_pdf(made, last, targets, d, np.float32(0.0), NOT_AIMED)


def _aimed(point, normal, material=0, **asked):
    """Returns (directions, NaN where the vertex does not aim; function that returns the density of directions)."""
    given, options = strip_absent_features(ROOM, "aimed"), kernel_options(settings((0, 0, 0), (1, 0, 0), **asked), ROOM)
    vertex = np.array(point, np.float32), np.array(normal, np.float32), np.uint32(material), options
    random = np.random.default_rng(7)
    directions = np.empty((N, 3), np.float32)
    _aim(given, *vertex, random.random(N, np.float32), random.random((N, 2), np.float32), directions)

    def density(grid):
        values = np.empty(len(grid), np.float32)
        _density(given, *vertex, np.ascontiguousarray(grid, np.float32), values)
        return values

    return directions, density


@pytest.mark.long
@pytest.mark.parametrize(("point", "normal"), VERTICES)
def test_directions_follow_their_density(point, normal):
    directions, density = _aimed(point, normal)
    assert np.isfinite(directions[:, 0]).mean() == pytest.approx(0.25, abs=0.005)
    direction_test(directions, density, tests=len(VERTICES), fine=48, name=f"from {point}")


@pytest.mark.long
def test_smooth_glass_and_other_strategies_do_not_aim():
    assert np.isnan(_aimed(*VERTICES[0], material=1)[0]).all()
    assert np.isnan(_aimed(*VERTICES[0], sampling="bsdf")[0]).all()


@entry
def _far_rim(center, radius, u, pdf):
    p = (np.float32(0.0), np.float32(0.0), np.float32(0.0))
    for i in range(len(u)):
        c = (center[0], center[1], center[2])
        d, _ = sample_sphere_direction(c, radius, p, (u[i, 0], u[i, 1]))
        pdf[i] = sphere_direction_pdf(c, radius, p, d, _NO)


def test_directions_hit_a_small_sphere_far_away():
    """The pdf of sampled directions is positive at ten thousand radii, where 1 - cosine**2 would have no correct digit."""
    u, pdf = np.random.default_rng(1).random((20_000, 2), np.float32), np.empty(20_000, np.float32)
    _far_rim(np.array((60.0, -50.0, 62.4), np.float32), np.float32(0.01), u, pdf)
    assert (pdf > 0).mean() > 0.999


@pytest.mark.long
@grid("name", AIMED, ordinary=())
def test_the_mean_is_that_without_targets(name):
    compiled, asked = made(name)
    asked = replace(asked, sampler="independent", view=DOWN)
    assert len(compiled.target) > 0
    own, own_error = mean_and_error(render_frame(compiled, replace(asked, seed=AIMED.index(name)), 1024))
    plain = compiled._replace(target=compiled.target[:0])
    other, its_error = mean_and_error(render_frame(plain, replace(asked, seed=100 + AIMED.index(name)), 1024))
    error = math.hypot(own_error, its_error)
    assert error < 0.005 * other, "too noisy to judge"
    assert abs(own - other) < limit(len(AIMED)) * error, f"{own} and {other} +- {error}"


@pytest.mark.long
def test_lamps_in_glass_are_found():
    compiled, asked = made("lamps in glass")
    asked = replace(asked, view=DOWN)
    errors = [
        mean_and_error(render_frame(each, asked, 128))[1] for each in (compiled, compiled._replace(target=compiled.target[:0]))
    ]
    assert errors[0] ** 2 < errors[1] ** 2 / 4
