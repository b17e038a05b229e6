"""Tests of light sampling strategies and path termination: they differ in noise, never in the expected picture."""

import math
from dataclasses import replace

import numpy as np
import pytest

from renderer.film import COLOR, SAMPLES, mean, noise
from renderer.render import RenderStats, render_batch, render_frame
from renderer.scene.description import Light, Material, Sphere
from renderer.settings import HEURISTICS, MAX_FLOOR, Tile
from tests.grids import grid
from tests.renderer.builders import box, emitter, gray, scene, settings, square
from tests.renderer.judge import assert_mean, limit, mean_and_error

FLOOR = square((0, 0, 0), (5, 0, 0), (0, 0, -5), 0)
VIEW = ((0, 2, 6), (0, 0.8, 0), 30)


def room(environment):
    """Returns diffuse, glossy, mirror and glass objects under large lights that all strategies can hit: square, sphere, sky."""
    materials = [
        Material(base_color=(0.7, 0.6, 0.5)),
        Material(kind="metallic_roughness", base_color=(0.9, 0.6, 0.3), metallic=0.7, roughness=0.6),
        Material(kind="mirror", base_color=gray(0.9)),
        Material(kind="glass", base_color=gray(1.0)),
        emitter(3.0),
    ]
    meshes = (FLOOR, square((0, 3, 0), (1.5, 0, 0), (0, 0, 1.5), 4), box(2, 0.4, (-1.6, 0.4, 0)))
    spheres = (Sphere((0, 0.6, 0.3), 0.6, 1), Sphere((1.4, 0.5, 0.6), 0.5, 3), Sphere((-2.5, 1.5, -1.5), 0.7, 4))
    return scene(materials, meshes, spheres, environment=environment)


@pytest.fixture(scope="module", params=[*(pytest.param(sky, marks=pytest.mark.long) for sky in ("dark", "even")), "image"])
def lit_room(request):
    image = np.random.default_rng(3).gamma(0.5, 1.0, (4, 8, 1)).repeat(3, 2)
    image[1, 2:4] = 0  # dark texels between bright ones, lit only by interpolation
    made = room({"dark": None, "even": 0.5, "image": image}[request.param])
    reference = mean_and_error(render_frame(made, settings(*VIEW, max_depth=5, size=32, sampler="independent"), 1024))
    return made, reference


@pytest.mark.long
@grid("sampling", ["light", "bsdf", "uniform"], ordinary=("light",))
def test_each_strategy_alone_is_unbiased(lit_room, sampling):
    made, (expected, error) = lit_room
    sums = render_frame(made, settings(*VIEW, max_depth=5, size=32, sampling=sampling, sampler="independent"), 1024)
    found, own = mean_and_error(sums)
    assert math.hypot(own, error) < 0.01 * expected
    assert abs(found - expected) < limit(9) * math.hypot(own, error), f"{found} and {expected}"


def test_mis_error_is_near_the_best_single_strategy(lit_room):
    made, _ = lit_room
    found = {
        sampling: noise(
            render_frame(made, settings(*VIEW, max_depth=5, size=32, sampling=sampling, sampler="independent"), 64), 24
        )
        for sampling in ("mis", "light", "bsdf", "uniform")
    }
    assert found["mis"] <= 1.1 * min(found.values()), found


@pytest.mark.long
@pytest.mark.parametrize("sampling", ["mis", "light", "bsdf", "uniform"])
def test_variance_falls_with_the_number_of_independent_samples(sampling):
    made = room(0.5)

    def error(spp):
        asked = settings(*VIEW, max_depth=4, size=32, sampling=sampling, sampler="independent")
        return noise(render_frame(made, asked, spp), 24)

    ratio = error(16) / error(256)
    assert 0.75 * 4 < ratio < 4 / 0.75, ratio


@pytest.mark.parametrize("sampling", ["mis", "light", "bsdf", "uniform"])
def test_every_strategy_samples_punctual_lights(sampling):
    made = scene([Material(base_color=gray(1.0))], (FLOOR,), lights=(Light("point", gray(math.pi), (0, 2, 0)),))
    asked = settings((0, 0.5, -2), (0, 0, 0), 0.01, max_depth=2, sampling=sampling)
    assert_mean(render_frame(made, asked, 16), 0.25, slack=1e-4)


@grid("roulette", [0.2, 0.5, 0.8, 1.0, 0.0], ordinary=(0.2, 0.0))
@grid("sampling", ["mis", "bsdf"], ordinary=("mis",))
def test_roulette_of_any_probability_is_unbiased(roulette, sampling):
    furnace = scene([emitter(0.7, 0.3, double_sided=True)], spheres=(Sphere((0, 0, 0), 1.0),))
    asked = settings((0.3, 0.2, 0.1), (1, 0, 0), 70, max_depth=200, roulette=roulette, sampling=sampling, sampler="independent")
    samples = 32 if roulette == 1.0 else 512  # without roulette paths are long and have little noise
    assert_mean(render_frame(furnace, asked, samples), 1.0, slack=1e-4, tests=10)


@pytest.mark.long
@pytest.mark.parametrize("floor", [0.15, 0.5, MAX_FLOOR])
def test_roulette_with_minimum_survival_is_unbiased(floor):
    """Russian roulette with a minimum survival probability ("floor") is unbiased, and traces more rays than without one.

    At reflectance 0.1, roulette by throughput alone ends most paths within three bounces.
    """
    furnace = scene([emitter(0.9, 0.1, double_sided=True)], spheres=(Sphere((0, 0, 0), 1.0),))
    asked = settings((0.3, 0.2, 0.1), (1, 0, 0), 70, max_depth=200, roulette_floor=floor, sampler="independent")
    counts = RenderStats(), RenderStats()
    assert_mean(render_frame(furnace, asked, 128, stats=counts[0]), 1.0, slack=1e-4, tests=3)
    render_frame(furnace, replace(asked, roulette_floor=0.0), 128, stats=counts[1])
    assert counts[0].rays > counts[1].rays


def test_minimum_survival_has_no_effect_on_constant_roulette():
    made = room(0.5)
    pictures = [render_frame(made, settings(*VIEW, size=8, roulette=0.7, roulette_floor=floor), 2) for floor in (0.0, 0.9)]
    np.testing.assert_array_equal(*pictures)


@pytest.mark.long
def test_heuristics_and_light_choices_are_unbiased(lit_room):
    made, (expected, error) = lit_room
    ways = [("balance", "tree"), ("balance", "uniform"), ("power", "power"), ("power", "uniform")]
    for heuristic, choice in ways:
        asked = settings(*VIEW, max_depth=5, size=32, heuristic=heuristic, light_choice=choice, sampler="independent")
        found, own = mean_and_error(render_frame(made, asked, 512))
        assert math.hypot(own, error) < 0.01 * expected
        assert abs(found - expected) < limit(3 * len(ways)) * math.hypot(own, error), f"{heuristic}, {choice}"


def test_heuristics_have_different_films():
    """The MIS heuristics' films differ; otherwise the previous test would compare a picture with itself."""
    made = room(0.5)
    pictures = [render_frame(made, settings(*VIEW, size=8, heuristic=name), 4)[COLOR] for name in HEURISTICS]
    assert (pictures[0] != pictures[1]).any()


def test_depth_limit_is_biased_and_roulette_is_not():
    furnace = scene([emitter(0.2, 0.8, double_sided=True)], spheres=(Sphere((0, 0, 0), 1.0),))
    asked = settings((0.3, 0.2, 0.1), (1, 0, 0), 70, max_depth=5)
    assert_mean(render_frame(furnace, asked, 64), 1 - 0.8**5, slack=1e-4)


@pytest.mark.long
@pytest.mark.parametrize("count", [2, 5, 16])
def test_more_light_samples_reduce_noise_without_bias(count):
    made = scene([Material(base_color=gray(1.0)), emitter(1.0)], (FLOOR, square((0, 1, 0), (0.5, 0, 0), (0, 0, 0.5), 1)))
    view = ((0, 0.5, -2), (0, 0, 0), 0.01)
    one = render_frame(made, settings(*view, max_depth=2, sampler="independent"), 64)
    more = render_frame(made, settings(*view, max_depth=2, sampler="independent", light_samples=count), 64)
    assert_mean(more, 0.752275 / math.pi, slack=1e-4)
    # Shared with BSDF sampling, more light samples reduce only their part of the variance
    assert noise(more, 24) < noise(one, 24)
    alone = [
        noise(render_frame(made, settings(*view, max_depth=2, sampler="independent", sampling="light", light_samples=k), 64), 24)
        for k in (1, count)
    ]
    assert alone[0] / alone[1] == pytest.approx(math.sqrt(count), rel=0.15)


def test_clamp_limits_indirect_light_only():
    made = room(0.5)

    def picture(depth, clamp, spp=64):
        return render_frame(made, settings(*VIEW, max_depth=depth, size=32, clamp_indirect=clamp), spp)[COLOR]

    np.testing.assert_array_equal(picture(2, 1e-6, 4), picture(2, 0.0, 4))
    np.testing.assert_array_equal(picture(6, 1e9, 4), picture(6, 0.0, 4))
    free, clamped, none = (picture(6, c).mean() for c in (0.0, 0.3, 1e-9))
    assert none < clamped < free
    direct = picture(2, 0.0).mean()
    # Mirror and glass show light after more than one bounce, which is indirect light
    assert abs(none - direct) < 0.02 * direct


def test_direct_integrator_equals_two_path_segments():
    made = room(0.5)
    one = render_frame(made, settings(*VIEW, max_depth=7, integrator="direct"), 4)
    np.testing.assert_array_equal(one, render_frame(made, settings(*VIEW, max_depth=2, transmission_depth=0), 4))
    seen = render_frame(made, settings(*VIEW, max_depth=1, integrator="direct"), 4)
    np.testing.assert_array_equal(seen, render_frame(made, settings(*VIEW, max_depth=1), 4))


def under_a_lamp(height, side=0.05):
    return scene(
        [Material(base_color=gray(1.0)), emitter(1000.0)],
        (square((0, 0, 0), (500, 0, 0), (0, 0, -500), 0), square((0, height, 0), (side, 0, 0), (0, 0, side), 1)),
    )


@pytest.mark.parametrize("integrator", ["path", pytest.param("whitted", marks=pytest.mark.long)])
def test_deliberate_errors_have_their_named_effect(integrator):
    """Each deliberate mistake of the renderer changes the irradiance below a small lamp as its name says.

    Without mistakes, E = L A / h^2 at height h. `attenuation` divides by h^2 again; `light-cutoff` removes lamps farther away
    than sqrt(1000).
    """
    for height, mistake, factor in (
        (3.0, "", 1.0),
        (3.0, "attenuation", 1 / 9),
        (3.0, "light-cutoff", 1.0),
        (31.0, "light-cutoff", 1.0),
        (32.0, "light-cutoff", 0.0),
        (32.0, "", 1.0),
    ):
        asked = settings((0, 0.5, -2), (0, 0, 0), 0.01, max_depth=2, integrator=integrator, mistake=mistake)
        sums = render_frame(under_a_lamp(height), asked, 64)
        expected = 1000 * 0.01 / height**2 / math.pi * factor
        assert mean(sums, 24).mean() == pytest.approx(expected, rel=0.01, abs=1e-9), (height, mistake)


def test_strategy_batches_are_deterministic(lit_room):
    made, _ = lit_room
    for sampling in ("light", "uniform"):
        asked = settings(*VIEW, max_depth=4, size=16, sampling=sampling, light_samples=3, roulette=0.7)
        whole = render_batch(made, asked, Tile(0, 0, 16, 16), 0, 4).sums
        parts = sum(render_batch(made, asked, Tile(0, 0, 16, 16), n, 1).sums for n in range(4))
        np.testing.assert_array_equal(whole, parts)
        assert (whole[SAMPLES] == 4).all()
