"""Tests of Whitted ray tracing and ambient occlusion against closed forms."""

import math

import numpy as np
import pytest

from renderer.film import ALBEDO, DEPTH, NORMAL, POSITION, mean
from renderer.render import render_frame
from renderer.scene.description import Light, Material, Sphere
from tests.renderer.builders import box, emitter, gray, icosphere, scene, settings, square
from tests.renderer.judge import assert_mean, limit, mean_and_error

pytestmark = pytest.mark.long  # needs two more kernels

FLOOR = square((0, 0, 0), (5, 0, 0), (0, 0, -5), 0)
WHITE = Material(base_color=gray(1.0))
BELOW = ((0, 0.5, -2), (0, 0, 0), 0.01)


def whitted(made, view, spp=4, **more):
    return render_frame(made, settings(*view, integrator="whitted", **more), spp)


def test_whitted_samples_a_square_light_at_its_centre():
    """Whitted ray tracing samples a square light only at its centre: the radiance is L A / h^2 / pi.

    Integration over the square would yield 0.752275 / pi.
    """
    made = scene([WHITE, emitter(1.0)], (FLOOR, square((0, 1, 0), (0.5, 0, 0), (0, 0, 0.5), 1)))
    np.testing.assert_allclose(mean(whitted(made, BELOW, 16), 24), 1 / math.pi, rtol=1e-3)


@pytest.mark.parametrize("degrees", [0, 50])
def test_whitted_sphere_light_has_its_solid_angle(degrees):
    distance, radius = 3.0, 0.8
    a = math.radians(degrees)
    made = scene([WHITE, emitter(2.0)], (FLOOR,), (Sphere((distance * math.sin(a), distance * math.cos(a), 0.0), radius, 1),))
    solid = 2 * math.pi * (1 - math.sqrt(1 - (radius / distance) ** 2))
    np.testing.assert_allclose(mean(whitted(made, BELOW), 24), 2.0 / math.pi * solid * math.cos(a), rtol=1e-3)


def test_whitted_shadow_has_no_penumbra():
    blocker = square((0, 0.5, 0), (0.25, 0, 0), (0, 0, 0.25), 2)
    light = square((0, 1, 0), (0.4, 0, 0), (0, 0, 0.4), 1)
    made = scene([WHITE, emitter(1.0), Material(base_color=gray(0.0))], (FLOOR, light, blocker))
    # Straight down between blocker and floor, from just below the blocker
    view = ((0, 0.49, 0), (0, 0, 0), 2 * math.degrees(math.atan(1 / 0.49)))
    picture = mean(whitted(made, view, 1, size=64), 24)[..., 0]
    place = mean(whitted(made, view, 1, size=64), 24, POSITION)
    inside = np.maximum(abs(place[..., 0]), abs(place[..., 2]))
    assert not picture[inside < 0.49].any()
    open_floor = (inside > 0.51) & (inside < 0.9)
    square_distance = place[..., 0] ** 2 + place[..., 2] ** 2 + 1
    np.testing.assert_allclose(picture[open_floor], (0.64 / math.pi / square_distance**2)[open_floor], rtol=2e-3)


def test_whitted_with_many_samples_equals_direct_light():
    light = square((0, 2, 0), (0.8, 0, 0), (0, 0, 0.8), 1)
    made = scene([Material(base_color=gray(0.7)), emitter(3.0)], (FLOOR, light, box(0, 0.3, (0.5, 0.3, 0))))
    view = ((0, 2, 5), (0, 0.5, 0), 30)
    expected, error = mean_and_error(render_frame(made, settings(*view, integrator="direct"), 256))
    found, own = mean_and_error(whitted(made, view, 64, light_samples=8))
    assert abs(found - expected) < limit(1) * math.hypot(error, own)
    assert math.hypot(error, own) < 0.005 * expected


def test_ambient_light_is_added_to_diffuse_surfaces():
    made = scene([Material(base_color=(0.2, 0.4, 0.6)), Material(kind="mirror")], (FLOOR,), (Sphere((0, 9, 0), 1.0, 1),))
    found = mean(whitted(made, BELOW, ambient=(0.5, 1.0, 2.0)), 24)
    np.testing.assert_allclose(found, np.broadcast_to((0.1, 0.4, 1.2), found.shape), rtol=1e-6)


@pytest.mark.parametrize("polished", [Material(kind="mirror", base_color=gray(0.8)), "metal"])
def test_whitted_follows_mirrors_and_polished_metals(polished):
    if polished == "metal":
        polished = Material(kind="metallic_roughness", base_color=gray(0.8), metallic=1.0, roughness=0.02)
    mirrors = tuple(square((0, y, 0), (s * 2, 0, 0), (0, 0, 2), 0) for y, s in ((1, 1), (-1, -1)))
    made = scene([polished], mirrors, environment=3.0)
    sums = whitted(made, ((0, 0, 0), (math.tan(math.radians(60)), 1, 0), 0.01), 64, max_depth=3)
    assert mean(sums, 24).mean() == pytest.approx(3.0 * 0.8, rel=1e-5 if polished.kind == "mirror" else 0.06)


def test_whitted_glass_follows_fresnel():
    slab = tuple(square((0, 0, z), (s * 9, 0, 0), (0, 9, 0), 0) for z, s in ((0.1, 1), (-0.1, -1)))
    behind = square((0, 0, -2), (9, 0, 0), (0, 9, 0), 1)
    made = scene([Material(kind="glass", base_color=gray(1.0), ior=1.5), emitter(1.0)], (*slab, behind))
    assert_mean(whitted(made, ((0, 0, 3), (0, 0, 0), 0.5), 256, max_depth=64), 0.923077, slack=1e-4)


def test_whitted_has_no_diffuse_interreflection():
    """Inside an emitting sphere of albedo a, Whitted ray tracing has only the first reflection, path tracing all of them."""
    furnace = scene([emitter(0.5, 0.5, double_sided=True)], spheres=(Sphere((0, 0, 0), 1.0),))
    assert_mean(whitted(furnace, ((0.3, 0.2, 0.1), (1, 0, 0), 70), 64), 0.75, slack=1e-4)


def test_whitted_point_light_irradiance():
    made = scene([WHITE], (FLOOR,), lights=(Light("point", gray(math.pi), (0, 2, 0)),))
    np.testing.assert_allclose(mean(whitted(made, BELOW), 24), 0.25, rtol=1e-4)


def test_whitted_max_depth_1_shows_visible_emission():
    made = scene([Material(base_color=gray(0.8)), emitter(3.0)], (FLOOR, square((0, 1, 0), (0.5, 0, 0), (0, 0, 0.5), 1)))
    assert not mean(whitted(made, BELOW, max_depth=1), 24).any()


@pytest.mark.parametrize("distance", [0.0, 0.5, 1.5])
@pytest.mark.parametrize("sampler", ["sobol", "independent"])
def test_occlusion_inside_a_sphere(distance, sampler):
    """A share of 1 - D^2 / 4 of cosine-weighted directions inside a unit sphere are free up to the distance D.

    At angle theta to the normal the opposite wall is 2 cos(theta) away.
    """
    ball = scene([Material(base_color=gray(0.3))], spheres=(Sphere((0, 0, 0), 1.0),))
    asked = settings((0.3, 0.2, 0.1), (1, 0, 0), 70, integrator="ao", ao_distance=distance, sampler=sampler)
    sums = render_frame(ball, asked, 256)
    if distance == 0:
        assert not mean(sums, 24).any()
    else:
        assert_mean(sums, 1 - distance**2 / 4, slack=1e-4, tests=4)


def test_ambient_occlusion_of_convex_body_is_white():
    for made in (scene([WHITE], (icosphere(2),)), scene([emitter(9.0, 0.1)], spheres=(Sphere((0, 0, 0), 1.0),), environment=4.0)):
        sums = render_frame(made, settings((0, 0, 4), (0, 0, 0), 40, integrator="ao"), 4)
        assert (mean(sums, 24) == 1).all()


def test_first_hit_planes_are_those_of_the_path_tracer():
    made = scene(
        [Material(base_color=(0.2, 0.4, 0.6)), Material(kind="metallic_roughness", metallic=1.0, roughness=0.3)],
        (FLOOR, box(1, 0.4, (0, 0.4, 0))),
        environment=1.0,
    )
    view = ((0, 2, 6), (0, 0.5, 0), 40)
    path, *others = (render_frame(made, settings(*view, integrator=i), 4) for i in ("path", "whitted", "ao", "direct"))
    for other in others:
        for plane in (ALBEDO, NORMAL, DEPTH, POSITION):
            np.testing.assert_array_equal(other[plane], path[plane])
