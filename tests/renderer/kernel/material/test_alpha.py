"""Tests of alpha transparency for camera rays, shadow rays and bounces, and of absorption inside materials."""

import numpy as np
import pytest

from renderer.film import ALBEDO, DEPTH, MATERIAL, NORMAL, OBJECT, mean
from renderer.render import render_frame
from renderer.scene.description import Material, Sphere
from tests.grids import grid
from tests.renderer.builders import emitter, gray, scene, settings, square
from tests.renderer.judge import assert_mean

FLOOR = square((0, 0, 0), (5, 0, 0), (0, 0, -5), 0)
WHITE = Material(base_color=gray(1.0))


def cards(count, material, distance=1.0):
    """Returns `count` parallel squares between the light and the camera at z = 4, from z = 2 backwards.

    distance: spacing in tenths of a unit.
    """
    return tuple(square((0, 0, 2 - 0.1 * distance * i), (9, 0, 0), (0, 9, 0), material) for i in range(count))


@grid("integrator", ["path", "direct", "whitted"], ordinary=("path",))
@pytest.mark.parametrize("count", [1, 4])
def test_alpha_cards_attenuate_the_light(integrator, count):
    """Black squares of opacity a transmit (1 - a)**n of the light behind them, and do not add to a path's depth."""
    card = Material(base_color=gray(0.0), opacity=0.3, alpha_mode="blend")
    made = scene([emitter(2.0), card], (square((0, 0, -2), (9, 0, 0), (0, 9, 0), 0), *cards(count, 1)))
    sums = render_frame(made, settings((0, 0, 4), (0, 0, 0), 30, max_depth=1, integrator=integrator), 256)
    assert_mean(sums, 2.0 * 0.7**count, tests=6)


@grid("sampling", ["mis", "light", "bsdf"], ordinary=("mis",))
def test_shadow_through_alpha_cards_is_their_product(sampling):
    card = Material(base_color=gray(0.0), opacity=0.4, alpha_mode="blend")
    over = tuple(square((0, y, 0), (9, 0, 0), (0, 0, -9), 2) for y in (1.0, 1.2))
    made = scene([WHITE, emitter(1.0), card], (FLOOR, square((0, 2, 0), (2, 0, 0), (0, 0, 2), 1), *over))
    bare = scene([WHITE, emitter(1.0)], (FLOOR, square((0, 2, 0), (2, 0, 0), (0, 0, 2), 1)))
    view = ((0, 0.5, -2), (0, 0, 0), 0.01)
    expected = mean(render_frame(bare, settings(*view, max_depth=2), 1024), 24).mean()
    assert_mean(render_frame(made, settings(*view, max_depth=2, sampling=sampling), 512), expected * 0.36, slack=2e-3, tests=3)


@pytest.mark.parametrize("with_card", [False, True])
@pytest.mark.parametrize("distance", [10.0, 30.0, 1000.0])
def test_a_distant_light_does_not_occlude_itself(distance, with_card):
    """A square light of area 1 facing a wall yields rho L / (pi d^2), with or without a transparent square next to it."""
    card = Material(base_color=gray(0.5), opacity=0.5, alpha_mode="blend")
    lamp = square((0.3, 4.0, 0.0), (0.5, 0, 0), (0, 0.5, 0), 1)
    wall = square((0.3, 4.0, distance), (0.1 * distance, 0, 0), (0, -0.1 * distance, 0), 0)
    beside = (square((5.0, 4.0, distance / 2), (1, 0, 0), (0, 1, 0), 2),) if with_card else ()
    made = scene([Material(base_color=gray(0.5)), emitter(1000.0), card], (wall, lamp, *beside))
    view = settings((0.3, 4.0, distance - 1.0), (0.3, 4.0, distance), max_depth=2)
    assert mean(render_frame(made, view, 16), 24).mean() == pytest.approx(0.5 * 1000.0 / np.pi / distance**2, rel=0.01)


@pytest.mark.parametrize(("opacity", "there"), [(0.49, False), (0.51, True)])
def test_alpha_mask_is_binary(opacity, there):
    card = Material(base_color=(0.2, 0.4, 0.6), opacity=opacity, alpha_mode="mask", alpha_cutoff=0.5)
    made = scene([emitter(2.0, 0.5), card], (square((0, 0, -2), (9, 0, 0), (0, 9, 0), 0), *cards(1, 1)))
    sums = render_frame(made, settings((0, 0, 4), (0, 0, 0), 30, max_depth=1), 4)
    assert (mean(sums, 24) == (0 if there else 2)).all()
    assert (sums[MATERIAL] == (2 if there else 1)).all()
    np.testing.assert_allclose(mean(sums, 24, ALBEDO)[0, 0], (0.2, 0.4, 0.6) if there else (0.5, 0.5, 0.5), rtol=1e-6)


def test_first_hit_planes_skip_invisible_surfaces():
    """First-hit planes skip invisible surfaces: behind an invisible square, depth is that of the next surface."""
    card = Material(base_color=gray(0.0), opacity=0.0, alpha_mode="blend")
    wall = square((0, 0, -2), (9, 0, 0), (0, 9, 0), 0)
    bare = scene([emitter(1.0, 0.3)], (wall,))
    made = scene([emitter(1.0, 0.3), card], (wall, *cards(3, 1)))
    a, b = (render_frame(s, settings((0, 0, 4), (0, 0, 0), 30), 4) for s in (bare, made))
    np.testing.assert_allclose(mean(a, 24, DEPTH), mean(b, 24, DEPTH), rtol=1e-5)
    np.testing.assert_allclose(mean(a, 24, NORMAL), mean(b, 24, NORMAL), atol=1e-6)
    assert (b[OBJECT] == 1).all()


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["whitted", "ao"])
def test_other_integrators_support_alpha(integrator):
    card = Material(base_color=gray(0.0), opacity=0.0, alpha_mode="blend")
    wall = square((0, 0, -2), (9, 0, 0), (0, 9, 0), 0)
    view = settings((0, 0, 4), (0, 0, 0), 30, integrator=integrator)
    a, b = (render_frame(scene([emitter(1.0, 0.3), card], meshes), view, 4) for meshes in ((wall,), (wall, *cards(3, 1))))
    np.testing.assert_allclose(mean(a, 24, DEPTH), mean(b, 24, DEPTH), rtol=1e-5)


@grid("sampling", ["mis", "light", "bsdf", "uniform"], ordinary=("mis",))
def test_invisible_shells_have_no_effect(sampling):
    """Bounces and shadow rays pass invisible shells, and MIS weights use the vertex before the shell."""
    air = Material(base_color=gray(0.9), opacity=0.0, alpha_mode="blend")
    shells = tuple(Sphere((0, 0, 0), 1.2 + 0.1 * i, 2) for i in range(3))
    made = scene(
        [Material(base_color=gray(0.6)), emitter(4.0), air], spheres=(Sphere((0, 0, 0), 1.0), Sphere((0, 3, 0), 1.0, 1), *shells)
    )
    bare = scene([Material(base_color=gray(0.6)), emitter(4.0)], spheres=(Sphere((0, 0, 0), 1.0), Sphere((0, 3, 0), 1.0, 1)))
    view = ((0, 3, 3), (0, 0.7, 0), 10)
    expected = mean(render_frame(bare, settings(*view, max_depth=2), 1024), 24).mean()
    assert_mean(
        render_frame(made, settings(*view, max_depth=2, sampling=sampling), 512), expected, slack=2e-3, most_error=0.02, tests=4
    )


@pytest.mark.parametrize("integrator", ["path", pytest.param("whitted", marks=pytest.mark.long)])
@pytest.mark.parametrize("distance", [0.1, 0.5])
def test_absorbing_slab_follows_beers_law(integrator, distance):
    """A slab of index 1, which reflects nothing, transmits color ** (path length / distance)."""
    glass = Material(
        kind="glass", base_color=gray(1.0), ior=1.0, attenuation_color=(0.5, 0.25, 0.9), attenuation_distance=distance
    )
    slab = tuple(square((0, 0, z), (s * 9, 0, 0), (0, 9, 0), 1) for z, s in ((0.1, 1), (-0.1, -1)))
    made = scene([emitter(1.0), glass], (square((0, 0, -2), (9, 0, 0), (0, 9, 0), 0), *slab))
    sums = render_frame(made, settings((0, 0, 3), (0, 0, 0), 0.01, max_depth=4, integrator=integrator), 4)
    expected = np.array((0.5, 0.25, 0.9)) ** (0.2 / distance)
    np.testing.assert_allclose(mean(sums, 24).mean((0, 1)), expected, rtol=1e-4)


@pytest.mark.parametrize("integrator", ["path", "direct", pytest.param("whitted", marks=pytest.mark.long)])
def test_unlit_surfaces_emit_and_do_not_scatter(integrator):
    unlit = Material(kind="unlit", base_color=(0.2, 0.5, 0.8))
    made = scene(
        [unlit, emitter(50.0)], (square((0, 0, 0), (9, 0, 0), (0, 9, 0), 0),), (Sphere((0, 0, 9), 1.0, 1),), environment=3.0
    )
    sums = render_frame(made, settings((0, 0, 4), (0, 0, 0), 30, integrator=integrator), 4)
    np.testing.assert_allclose(mean(sums, 24), np.broadcast_to((0.2, 0.5, 0.8), (24, 24, 3)), rtol=1e-6)


def test_white_alpha_cards_in_a_white_furnace():
    """Light between two half-transparent white squares is reflected and transmitted repeatedly; none is lost or counted twice."""
    card = Material(base_color=gray(1.0), opacity=0.5, alpha_mode="blend")
    made = scene([card], cards(2, 0, 5.0), environment=1.0)
    sums = render_frame(made, settings((0, 0, 4), (0, 0, 0), 30, max_depth=64), 256)
    assert_mean(sums, 1.0, most_error=0.02)
