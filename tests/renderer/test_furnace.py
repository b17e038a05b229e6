"""Tests of a closed sphere with constant radiance inside, for all integrators, samplers, filters and cameras.

The sphere has reflectance 1/2 and either emits radiance 1/2 or has a point light of intensity pi at its centre, as in pbrt's
cpu/integrators_test.cpp. Paths of unlimited depth yield 1/2 + 1/4 + 1/8 + ... = 1.
"""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from renderer.arrays.scene import CompiledScene
from renderer.render import render_frame
from renderer.scene.description import Light, Sphere
from renderer.settings import FILTERS, SAMPLERS, SAMPLINGS, RenderSettings, View
from tests.renderer.builders import emitter, gray, scene
from tests.renderer.judge import assert_mean, mean_and_error

EYE, TARGET = (0.3, 0.2, 0.1), (0.9, -0.1, 0.3)
CAMERAS = {
    "perspective": View(EYE, TARGET, fov=70.0),
    "thin lens": View(EYE, TARGET, fov=50.0, aperture=0.3, focus=0.5),
    "orthographic": View(EYE, TARGET, projection="orthographic", height=0.9),
    "panorama": View(EYE, TARGET, projection="panorama"),
}
ALBEDO = 0.5
# Whitted and direct lighting end at the first diffuse surface: its emission, 1/2, plus the reflected half of the direct light.
GLOW = {"path": 1.0, "direct": 0.75, "whitted": 0.75}
LAMPLIGHT = {"path": 1.0, "direct": 0.5, "whitted": 0.5}
INTEGRATORS = ["path", "direct", pytest.param("whitted", marks=pytest.mark.long)]


@pytest.fixture(scope="module")
def glowing() -> CompiledScene:
    return scene([emitter(0.5, ALBEDO, double_sided=True)], spheres=(Sphere((0, 0, 0), 1.0),))


@pytest.fixture(scope="module")
def lit() -> CompiledScene:
    lamp = Light("point", gray(math.pi), position=(0.0, 0.0, 0.0))
    return scene([emitter(0.0, ALBEDO)], spheres=(Sphere((0, 0, 0), 1.0),), lights=(lamp,))


def _settings(camera: str, sampler: str, integrator: str, **more: object) -> RenderSettings:
    return RenderSettings(12, 12, CAMERAS[camera], max_depth=100, sampler=sampler, integrator=integrator, **more)


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("sampler", SAMPLERS)
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_glowing_sphere(glowing, integrator, sampler, camera):
    sums = render_frame(glowing, _settings(camera, sampler, integrator), 64)
    assert_mean(sums, GLOW[integrator], slack=1e-4, tests=len(GLOW) * len(CAMERAS) * len(SAMPLERS))


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("sampler", SAMPLERS)
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_point_light_at_the_centre(lit, integrator, sampler, camera):
    sums = render_frame(lit, _settings(camera, sampler, integrator), 64)
    assert_mean(sums, LAMPLIGHT[integrator], slack=1e-4, tests=len(LAMPLIGHT) * len(CAMERAS) * len(SAMPLERS))


@pytest.mark.long
@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("sampler", SAMPLERS)
def test_ambient_occlusion(lit, sampler, camera):
    """Ambient occlusion inside a unit sphere is 1 - (D / 2)^2 for chords longer than D.

    The chord at angle a to the normal has length 2 cos a, so the cosine-weighted share of chords below D is (D / 2)^2.
    """
    settings = _settings(camera, sampler, "ao", ao_distance=1.2)
    assert_mean(render_frame(lit, settings, 256), 1 - 0.6**2, slack=1e-4, tests=len(CAMERAS) * len(SAMPLERS))
    assert mean_and_error(render_frame(lit, replace(settings, ao_distance=0.0), 4))[0] == 0.0


@pytest.mark.parametrize("name", FILTERS)
def test_every_filter(glowing, name):
    assert_mean(render_frame(glowing, _settings("perspective", "sobol", "path", filter=name), 64), 1.0, slack=1e-4, tests=3)


@pytest.mark.parametrize("sampler", SAMPLERS)
@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_every_strategy_of_finding_lights(glowing, sampling, sampler):
    settings = _settings("perspective", sampler, "path", sampling=sampling)
    assert_mean(render_frame(glowing, settings, 256), 1.0, slack=1e-4, tests=len(SAMPLINGS) * len(SAMPLERS))


@pytest.mark.parametrize("survival", [0.2, 0.5, 0.8])
def test_roulette_of_any_probability(survival):
    """Russian roulette with any survival probability yields mean 1 at a reflectance of 0.3.

    At a reflectance of 0.5, a probability of 0.2 would have infinite variance: 0.2 (0.5 / 0.2)^2 > 1.
    """
    darker = scene([emitter(0.7, 0.3, double_sided=True)], spheres=(Sphere((0, 0, 0), 1.0),))
    settings = _settings("perspective", "independent", "path", roulette=survival)
    assert_mean(render_frame(darker, settings, 512), 1.0, slack=1e-4, tests=3)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_several_light_samples(glowing, integrator):
    settings = _settings("perspective", "sobol", integrator, light_samples=4)
    assert_mean(render_frame(glowing, settings, 64), GLOW[integrator], slack=1e-4, tests=len(GLOW))
