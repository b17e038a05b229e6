"""Tests of punctual lights in rendered pictures: their irradiance in closed form, and that rays never hit them."""

import math

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.film import mean
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.description import Light, Material, SceneDescription, Sphere
from tests.grids import grid
from tests.renderer.builders import gray, scene, settings, square
from tests.renderer.judge import assert_mean

WHITE = Material(base_color=gray(1.0))
FLOOR = square((0, 0, 0), (50, 0, 0), (0, 0, -50), 0)  # faces +y
EYE = (0.3, 2.0, -0.2)


def irradiance(*lights, at=(0.0, 0.0, 0.0), blockers=(), spp=4):
    """Returns the film sums of a floor seen at point `at` below a punctual light; its radiance is E / pi."""
    lit = scene([WHITE, Material(base_color=gray(0.0))], (FLOOR, *blockers), lights=lights)
    eye = (at[0] + EYE[0], EYE[1], at[2] + EYE[2])
    return render_frame(lit, settings(eye, at, 0.01, size=8, max_depth=2), spp)


def assert_irradiance(sums, expected, rtol=1e-4):
    """Asserts the irradiance of film sums that have no noise."""
    found = mean(sums, 24).mean((0, 1)) * math.pi
    np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), rtol=rtol, atol=1e-6)


@pytest.mark.parametrize("degrees", [0, 40, 80])
@pytest.mark.parametrize("distance", [0.5, 30.0])
def test_point_light_irradiance(degrees, distance):
    a = math.radians(degrees)
    lamp = Light("point", (3.0, 2.0, 1.0), (distance * math.sin(a), distance * math.cos(a), 0))
    assert_irradiance(irradiance(lamp), np.array([3.0, 2.0, 1.0]) * math.cos(a) / distance**2)


def test_blocker_occludes_the_point_light():
    roof = square((0, 0.5, 0), (0.2, 0, 0), (0, 0, 0.2), 1)
    for kind in ("point", "spot", "directional"):
        lamp = Light(kind, gray(3.0), (0, 3, 0), (0, -1, 0))
        assert mean(irradiance(lamp, blockers=(roof,)), 24).max() == 0
        assert mean(irradiance(lamp), 24).min() > 0.1


@pytest.mark.parametrize(("inner", "outer"), [(0, 45), (20, 30), (30, 30)])
def test_gltf_spot_falloff(inner, outer):
    """A spot's intensity follows clamp((cos - cos outer) / (cos inner - cos outer))^2, as glTF defines."""
    cos_inner, cos_outer = math.cos(math.radians(inner)), math.cos(math.radians(outer))
    for degrees in (0, 10, 19, 22, 25, 28, 29.5, 31, 44, 46, 100):
        a = math.radians(degrees)
        lamp = Light("spot", gray(2.0), (0, 2, 0), (math.sin(a), -math.cos(a), 0), inner_cone=inner, outer_cone=outer)
        fall = min(max((math.cos(a) - cos_outer) / max(1e-3, cos_inner - cos_outer), 0), 1) ** 2
        assert_irradiance(irradiance(lamp, spp=1), 2.0 / 4 * fall, rtol=1e-3)


def smooth_step(x):
    return x * x * (3 - 2 * x)


@grid(
    ("falloff", "by", "curve"),
    [("smooth", math.cos, smooth_step), ("linear", float, float), ("smooth angle", float, smooth_step)],
    ordinary=("smooth",),
)
@pytest.mark.parametrize(("inner", "outer"), [(0, 45), (20, 30), (30, 30)])
def test_spot_falloff_of_other_renderers(falloff, by, curve, inner, outer):
    """Spot falloffs equal those of Cycles, pbrt, Mitsuba and USD; renderer/kernel/light/punctual.py cites the sources."""
    start, end = by(math.radians(inner)), by(math.radians(outer))
    for degrees in (0, 10, 19, 22, 25, 28, 29.5, 31, 44, 46, 100):
        a = math.radians(degrees)
        cones = {"inner_cone": inner, "outer_cone": outer, "falloff": falloff}
        lamp = Light("spot", gray(2.0), (0, 2, 0), (math.sin(a), -math.cos(a), 0), **cones)
        inside = float(degrees <= outer) if start == end else min(max((by(a) - end) / (start - end), 0), 1)
        assert_irradiance(irradiance(lamp, spp=1), 2.0 / 4 * curve(inside), rtol=1e-3)


@pytest.mark.parametrize("degrees", [0, 60])
def test_directional_light_irradiance(degrees):
    a = math.radians(degrees)
    sun = Light("directional", (3.0, 2.0, 1.0), direction=(5 * math.sin(a), -5 * math.cos(a), 0))
    assert_irradiance(irradiance(sun), np.array([3.0, 2.0, 1.0]) * math.cos(a))


@pytest.mark.parametrize("kind", ["point", "spot"])
@pytest.mark.parametrize("degrees", [0, 55])
def test_radius_keeps_the_irradiance_above_the_horizon(kind, degrees):
    """The irradiance by a spherical light above the horizon equals a point's: E = pi L (r / d)^2 cos = I cos / d^2."""
    a = math.radians(degrees)
    place = (2 * math.sin(a), 2 * math.cos(a), 0)
    lamp = Light(kind, gray(5.0), place, tuple(-c for c in place), radius=0.8, inner_cone=30)
    assert_mean(irradiance(lamp, spp=64), 5.0 * math.cos(a) / 4 / math.pi, slack=1e-4)


def test_spherical_light_cut_by_the_horizon():
    """A spherical light with its centre in the floor's plane is half visible; E is integrated numerically over its cone."""
    distance, radius = 2.0, 1.0
    lamp = Light("point", gray(1.0), (distance, 0, 0), radius=radius)
    theta = (np.arange(2000) + 0.5) / 2000 * math.asin(radius / distance)
    phi = (np.arange(2000) + 0.5) / 2000 * 2 * math.pi
    height = np.sin(theta)[:, None] * np.sin(phi)
    cell = np.sin(theta)[:, None] * (theta[1] - theta[0]) * (phi[1] - phi[0])
    expected = (np.maximum(height, 0) * cell).sum() / (math.pi * radius**2)
    assert_mean(irradiance(lamp, spp=1024), expected / math.pi, slack=1e-3)


def test_point_inside_a_spherical_light():
    lamp = Light("point", gray(1.0), (0, 0.1, 0), radius=0.5)
    assert_mean(irradiance(lamp, spp=1024), 1 / (math.pi * 0.25), slack=1e-3)  # L, since E = pi L


@pytest.mark.parametrize("angle", [0.01, 0.53, 20.0, 120.0, 180.0])
def test_sun_angle_keeps_the_irradiance(angle):
    sun = Light("directional", gray(3.0), direction=(0, -1, 0), angle=angle)
    assert_mean(irradiance(sun, spp=256), 3.0 / math.pi, slack=2e-4)


def test_sun_angle_makes_a_penumbra():
    """A half plane at height h casts a penumbra of width 2 h tan(half angle), with half the light at its middle."""
    roof = square((-20, 1.0, 0), (20, 0, 0), (0, 0, 40), 1)
    sun = Light("directional", gray(1.0), direction=(0, -1, 0), angle=40)
    edge = math.tan(math.radians(20))
    for x, least, most in ((-1.05 * edge, 0, 1e-9), (0.0, 0.49, 0.51), (1.05 * edge, 0.98, 1.02)):
        lit = scene([WHITE, Material(base_color=gray(0.0))], (FLOOR, roof), lights=(sun,))
        sums = render_frame(lit, settings((x + 1.8, 0.5, 0.0), (x, 0, 0), 0.01, max_depth=2), 64)
        assert least <= mean(sums, 24).mean() * math.pi <= most


def test_spherical_point_light_equals_an_emissive_sphere():
    radius, intensity = 0.4, 2.0
    place = (0.5, 1.2, 0.3)
    body = Material(base_color=gray(0), emission=gray(intensity / (math.pi * radius**2)))
    view = settings((0, 1.5, -3), (0, 0, 0), 25, max_depth=3)
    ball = square((0.2, 0.4, 0), (0.3, 0, 0), (0, 0, 0.3), 0)
    punctual = render_frame(
        scene([WHITE], (FLOOR, ball), lights=(Light("point", gray(intensity), place, radius=radius),)), view, 256
    )
    emitting = render_frame(scene([WHITE, body], (FLOOR, ball), (Sphere(place, radius, 1),)), view, 256)
    assert_mean(punctual, float(mean(emitting, 24).mean()), slack=2e-3)


def test_rays_do_not_hit_punctual_lights():
    lamp = Light("point", gray(3.0), (0, 0, 0), radius=0.5)
    lit = scene([WHITE], (square((0, 0, -9), (0.1, 0, 0), (0, 0.1, 0), 0),), lights=(lamp,))
    assert mean(render_frame(lit, settings((0, 0, 3), (0, 0.3, 0)), 1), 24).max() == 0


@pytest.mark.parametrize(
    ("light", "words"),
    [
        (Light("lamp"), "known are point"),
        (Light("point", intensity=(-1, 0, 0)), "must be from 0 to 1e15"),
        (Light("point", position=(math.nan, 0, 0)), "not finite"),
        (Light("spot", direction=(0, 0, 0)), "no direction"),
        (Light("point", radius=-1), "radius -1"),
        (Light("directional", angle=181), "181 degrees"),
        (Light("spot", inner_cone=50, outer_cone=40), "inner must be from 0 to the outer"),
    ],
)
def test_invalid_light_is_rejected(light, words):
    description = SceneDescription(spheres=[Sphere((0, 0, 0), 1.0)], materials=[WHITE], lights=[light])
    with pytest.raises(SceneError, match=words):
        compile_scene(description)
