"""Tests of splitting a path into several branches at its first vertex: the noise is lower, and the expected picture the same."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from renderer.film import mean
from renderer.kernel.options import kernel_options
from renderer.render import RenderStats, render_frame
from renderer.scene.description import Environment, Material, Sky, Sphere
from renderer.settings import SAMPLINGS, RenderSettings, View
from tests.grids import grid
from tests.renderer.builders import emitter, gray, scene, settings, square
from tests.renderer.judge import limit, mean_and_error
from tests.renderer.kernel.backends.features import made

# Features to compare: constant skies, which only surfaces sample, image skies, and objects of every material kind.
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
    """Returns [(mean, standard error)] of two pictures: with one branch per path, and with two."""
    asked = replace(asked, sampler="independent")
    return [mean_and_error(render_frame(compiled, replace(asked, splitting=n, seed=n), spp)) for n in (1, 2)]


def _agree(compiled, asked: RenderSettings, spp: int = 512) -> None:
    (one, its_error), (two, own_error) = _both(compiled, asked, spp)
    error = math.hypot(its_error, own_error)
    assert error < 0.01 * one, "too noisy to judge"
    assert abs(two - one) < limit(len(SEEN) + 1) * error, f"{two} and {one} +- {error}"


@pytest.mark.long
@pytest.mark.parametrize("name", [pytest.param(name, marks=() if name == SEEN[0] else pytest.mark.long) for name in SEEN])
def test_splitting_keeps_the_mean(name: str) -> None:
    _agree(*made(name))


@pytest.mark.long
def test_splitting_keeps_the_mean_under_a_sun() -> None:
    _agree(_sunny(), settings(*VIEW, max_depth=4, size=32))


def _sunny():
    """Returns diffuse, glossy and metal balls, and a lamp, under a sky with its sun."""
    materials = [
        Material(base_color=gray(0.5)),
        Material(kind="metallic_roughness", base_color=gray(0.8), roughness=0.3),
        emitter(4.0),
    ]
    balls = (Sphere((0, 0.6, 0), 0.6, 1), Sphere((-1.3, 0.6, 0), 0.6, 0), Sphere((1.3, 0.5, 0), 0.3, 2))
    return scene(materials, (FLOOR,), balls, environment=Environment(sky=Sky(sun_elevation=30.0)))


def test_convex_body_under_uniform_sky_has_no_noise() -> None:
    """Each sample of a convex diffuse ball of albedo 0.6 under a sky of radiance 1 has the value 0.6, up to rounding."""
    ball = scene([Material(base_color=gray(0.6))], spheres=(Sphere((0, 0, 0), 1.0),), environment=1.0)
    asked = RenderSettings(4, 4, View((0, 0, 4), (0, 0, 0), fov=10.0), max_depth=8)
    for count in (1, 2):
        np.testing.assert_allclose(
            mean(render_frame(ball, replace(asked, splitting=count), 4), asked.film_exponent), 0.6, rtol=1e-5
        )


def _noise_and_rays(compiled, asked: RenderSettings, spp: int) -> tuple[float, int]:
    """Returns the variance between eight pictures with different seeds, and their total number of rays."""
    stats = RenderStats()
    pictures = [mean(render_frame(compiled, replace(asked, seed=s), spp, stats=stats), asked.film_exponent) for s in range(8)]
    return float(np.var(pictures, axis=0).mean()), stats.rays


@pytest.mark.long
@pytest.mark.parametrize("name", ["a sky's picture", "a room"])
def test_splitting_reduces_variance_per_ray(name: str) -> None:
    """For indirect light and for skylight, splitting reduces the variance by a larger factor than it increases the rays."""
    compiled, asked = (_room(), settings((0, 1, 2.9), (0, 0, 0), 25, size=16)) if name == "a room" else made(name)
    (noise, rays), (less, more) = (_noise_and_rays(compiled, replace(asked, splitting=count), 16) for count in (1, 2))
    assert rays < more < 1.9 * rays
    assert less * more < noise * rays


def _room():
    """Returns a closed room with a lamp below its ceiling, outside the camera's view."""
    walls = (
        square((0, 0, 1), (1, 0, 0), (0, 0, -2), 0),
        square((0, 2, 1), (1, 0, 0), (0, 0, 2), 0),
        square((-1, 1, 1), (0, 0, -2), (0, 1, 0), 1),
        square((1, 1, 1), (0, 0, 2), (0, 1, 0), 0),
        square((0, 1, -1), (1, 0, 0), (0, 1, 0), 0),
        square((0, 1, 3), (-1, 0, 0), (0, 1, 0), 0),
        square((0, 1.99, 0), (0.25, 0, 0), (0, 0, 0.25), 2),
    )
    return scene([Material(base_color=gray(0.7)), Material(base_color=(0.6, 0.1, 0.1)), emitter(15.0)], walls)


def test_splitting_has_no_effect_on_specular_vertices() -> None:
    glass = Sphere((0, 0.8, 0), 0.8, 1)
    compiled = scene([Material(kind="mirror"), Material(kind="glass", ior=1.5)], (FLOOR,), (glass,), environment=1.0)
    films, stats = [], [RenderStats(), RenderStats()]
    for count in (1, 2):
        asked = settings(*VIEW, max_depth=6, size=8, splitting=count)
        films.append(render_frame(compiled, asked, 4, stats=stats[count - 1]))
    np.testing.assert_array_equal(*films)
    assert stats[0].rays == stats[1].rays


@pytest.mark.long
@grid("sampling", [name for name in SAMPLINGS if name != "mis"], ordinary=("light",))
def test_comparison_strategies_do_not_split(sampling: str) -> None:
    compiled = _sunny()
    assert kernel_options(settings(*VIEW, sampling=sampling), compiled).splitting == 1
    assert kernel_options(settings(*VIEW), compiled).splitting == 2


@pytest.mark.long
def test_brushed_smooth_metal_has_one_mean_for_all_strategies() -> None:
    """Brushed smooth metal, whose lobe is wide only along the scratches, has the same mean with MIS as with BSDF sampling."""
    metal = Material(kind="conductor", eta=(0.2, 0.4, 1.4), k=(4.0, 2.4, 1.6), roughness=0.0, anisotropy=0.8)
    sky = Environment(sky=Sky(sun_elevation=30.0, sun=False))
    compiled = scene([metal], spheres=(Sphere((0, 0.8, 0), 0.8, 0),), environment=sky)
    asked = settings(*VIEW, max_depth=2, size=24, sampler="independent")
    pictures = [mean_and_error(render_frame(compiled, replace(asked, sampling=how), 512)) for how in ("mis", "bsdf")]
    (weighed, its_error), (surfaces, own_error) = pictures
    assert abs(weighed - surfaces) < limit(1) * math.hypot(its_error, own_error)


@pytest.mark.long
def test_splitting_with_light_samples_and_balance_heuristic() -> None:
    """The single-path kernel supports splitting too, together with several light samples and the balance heuristic."""
    compiled, asked = made("a sky's picture")
    asked = replace(asked, sampler="independent")
    (expected, its_error) = mean_and_error(render_frame(compiled, replace(asked, splitting=1), 256))
    for more in ({"light_samples": 3}, {"heuristic": "balance"}):
        found, error = mean_and_error(render_frame(compiled, replace(asked, **more, seed=5), 256))
        assert abs(found - expected) < limit(2) * math.hypot(error, its_error)
