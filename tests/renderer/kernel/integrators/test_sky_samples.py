"""A second direction in which first vertices look for the sky: less noise, the same picture."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from renderer.film import mean
from renderer.kernel.options import kernel_options
from renderer.render import RenderStats, render_frame
from renderer.scene.description import Environment, Light, Material, Sky, Sphere
from renderer.settings import SAMPLINGS, RenderSettings, View
from tests.grids import grid
from tests.renderer.builders import emitter, gray, scene, settings, square
from tests.renderer.judge import limit, mean_and_error
from tests.renderer.kernel.pool.features import made

# Skies that are even and so left to surfaces, skies of a picture, and what is in front of them: of every kind of matter.
SEEN = (
    "a sky's picture",
    "metal and plastic",
    "a rough metal",
    "rough glass",
    "a coat and cloth",
    "half clear",
    "copies",
    "lights without a body",
    "what the camera does not see",
)
FLOOR = square((0, 0, 0), (5, 0, 0), (0, 0, -5), 0)
VIEW = ((0, 2, 6), (0, 0.8, 0), 30)


def _both(compiled, asked: RenderSettings, spp: int) -> list[tuple[float, float]]:
    """(mean, standard error) with one direction and with two."""
    asked = replace(asked, sampler="independent")
    return [mean_and_error(render_frame(compiled, replace(asked, sky_samples=n, seed=n), spp)) for n in (1, 2)]


def _agree(compiled, asked: RenderSettings, spp: int = 512) -> None:
    (one, its_error), (two, own_error) = _both(compiled, asked, spp)
    error = math.hypot(its_error, own_error)
    assert error < 0.01 * one, "too noisy to judge"
    assert abs(two - one) < limit(len(SEEN) + 1) * error, f"{two} and {one} +- {error}"


@pytest.mark.parametrize("name", [pytest.param(name, marks=() if name == SEEN[0] else pytest.mark.long) for name in SEEN])
def test_the_mean_is_that_of_one_direction(name: str) -> None:
    _agree(*made(name))


@pytest.mark.long
def test_the_mean_is_that_of_one_direction_where_a_sun_stands_in_the_sky() -> None:
    _agree(_sunny(), settings(*VIEW, max_depth=4, size=32))


def _sunny():
    """Matt, glossy and metal balls, and a lamp, under a sky with its sun."""
    materials = [
        Material(base_color=gray(0.5)),
        Material(kind="metallic_roughness", base_color=gray(0.8), roughness=0.3),
        emitter(4.0),
    ]
    balls = (Sphere((0, 0.6, 0), 0.6, 1), Sphere((-1.3, 0.6, 0), 0.6, 0), Sphere((1.3, 0.5, 0), 0.3, 2))
    return scene(materials, (FLOOR,), balls, environment=Environment(sky=Sky(sun_elevation=30.0)))


def test_a_convex_thing_in_an_even_sky_is_as_bright_as_it_reflects() -> None:
    """In closed form: a matt ball of 0.6 in a sky of 1 sends 0.6, each sample of it, to the last bits."""
    ball = scene([Material(base_color=gray(0.6))], spheres=(Sphere((0, 0, 0), 1.0),), environment=1.0)
    asked = RenderSettings(4, 4, View((0, 0, 4), (0, 0, 0), fov=10.0), max_depth=8)
    for count in (1, 2):
        np.testing.assert_allclose(
            mean(render_frame(ball, replace(asked, sky_samples=count), 4), asked.film_exponent), 0.6, rtol=1e-5
        )


def test_there_is_less_noise_for_fewer_rays_than_twice_the_samples() -> None:
    compiled, asked = made("a sky's picture")
    noise, rays = [], []
    for count in (1, 2):
        stats = RenderStats()
        pictures = [
            mean(render_frame(compiled, replace(asked, sky_samples=count, seed=s), 16, stats=stats), asked.film_exponent)
            for s in range(8)
        ]
        noise.append(np.var(pictures, axis=0).mean())
        rays.append(stats.rays)
    assert noise[1] < 0.85 * noise[0]
    assert rays[1] < 1.5 * rays[0]


def test_without_a_sky_it_costs_nothing_and_changes_no_bit() -> None:
    compiled = scene([Material(base_color=gray(0.5))], (FLOOR,), lights=(Light("point", gray(9.0), position=(0.0, 2.0, 0.0)),))
    films, stats = [], [RenderStats(), RenderStats()]
    for count in (1, 2):
        asked = settings(*VIEW, max_depth=3, size=8, sky_samples=count)
        films.append(render_frame(compiled, asked, 4, stats=stats[count - 1]))
        assert kernel_options(asked, compiled).sky_samples == 1
    np.testing.assert_array_equal(*films)
    assert stats[0].rays == stats[1].rays


@grid("sampling", [name for name in SAMPLINGS if name != "mis"], ordinary=("light",))
def test_strategies_that_weigh_nothing_look_once(sampling: str) -> None:
    compiled = _sunny()
    assert kernel_options(settings(*VIEW, sampling=sampling), compiled).sky_samples == 1
    assert kernel_options(settings(*VIEW), compiled).sky_samples == 2


def test_metal_that_is_brushed_and_not_rough_reflects_the_sky_whoever_looks_for_it() -> None:
    """Its lobe is wide along the scratches alone: light sampling must look for what a weighed direction leaves to it."""
    metal = Material(kind="conductor", eta=(0.2, 0.4, 1.4), k=(4.0, 2.4, 1.6), roughness=0.0, anisotropy=0.8)
    sky = Environment(sky=Sky(sun_elevation=30.0, sun=False))
    compiled = scene([metal], spheres=(Sphere((0, 0.8, 0), 0.8, 0),), environment=sky)
    asked = settings(*VIEW, max_depth=2, size=24, sampler="independent")
    pictures = [mean_and_error(render_frame(compiled, replace(asked, sampling=how), 512)) for how in ("mis", "bsdf")]
    (weighed, its_error), (surfaces, own_error) = pictures
    assert abs(weighed - surfaces) < limit(1) * math.hypot(its_error, own_error)


def test_several_light_samples_and_the_balance_heuristic_agree_with_it() -> None:
    """The kernel for one path at a time has it too."""
    compiled, asked = made("a sky's picture")
    asked = replace(asked, sampler="independent")
    (expected, its_error) = mean_and_error(render_frame(compiled, replace(asked, sky_samples=1), 256))
    for more in ({"light_samples": 3}, {"heuristic": "balance"}):
        found, error = mean_and_error(render_frame(compiled, replace(asked, **more, seed=5), 256))
        assert abs(found - expected) < limit(2) * math.hypot(error, its_error)
