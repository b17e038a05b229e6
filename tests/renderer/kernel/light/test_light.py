"""Tests of light sampling: directions follow the stated pdf, and both MIS strategies compute the same pdf for a direction."""

import math
from dataclasses import replace

import numpy as np
import pytest

from renderer.bvh.traverse import NO_PRIMITIVE, closest_hit, new_stack
from renderer.jit import entry, subroutine
from renderer.kernel import vec
from renderer.kernel.light.lights import environment_seen, primitive_light_pdf, sample_light
from renderer.kernel.surface.surface import is_emissive, surface_at
from renderer.reference import Packed, by_reference
from renderer.scene.description import Environment, Material, Sky, Sphere
from renderer.scene.lights import with_light_choice
from tests.grids import grid
from tests.renderer.builders import as_rendered, emitter, gray, scene, square
from tests.renderer.bvh.rays import trace
from tests.renderer.judge import assert_uniform, direction_test, limit

N = 300_000
TESTS = 15
P = (0.1, -0.2, 0.3)
NO_NORMAL = (0.0, 0.0, 0.0)  # lit from all sides
NORMAL = (0.6, 0.48, 0.64)


@subroutine
def _sample_all(made, p, n, u, direction, end, radiance, pdf):
    for i in range(len(u)):
        light = sample_light(made, (p[0], p[1], p[2]), (n[0], n[1], n[2]), u[i, 0], (u[i, 1], u[i, 2]), None)
        pdf[i] = light.pdf
        for k in range(3):
            direction[i, k] = light.direction[k]
            end[i, k] = light.end[k]
            radiance[i, k] = light.radiance[k]


@entry
def _sample(made, p, n, u, direction, end, radiance, pdf):
    _sample_all(by_reference(made), p, n, u, direction, end, radiance, pdf)


@subroutine
def _density_of_all(made, stack, p, n, direction, pdf):
    """Writes the density used for the MIS weight: that of the environment, or of the first light that a ray hits."""
    o = (p[0], p[1], p[2])
    for i in range(len(direction)):
        d = (direction[i, 0], direction[i, 1], direction[i, 2])
        pdf[i] = environment_seen(made, d, True)[1]
        hit = closest_hit(made.bvh, stack, o, d, np.float32(np.inf), None)
        if hit.primitive != NO_PRIMITIVE:
            surface = surface_at(made, o, d, hit)
            if is_emissive(surface):
                cosine = -vec.dot(surface.geometric, d)
                pdf[i] += primitive_light_pdf(made, surface.light, o, (n[0], n[1], n[2]), surface.point, cosine, True, None)


@entry
def _density(made, stack, p, n, direction, pdf):
    _density_of_all(by_reference(made), stack, p, n, direction, pdf)


def sample(made, p=P, n=N, seed=0, normal=NO_NORMAL):
    """Returns n light samples at point p as arrays (direction, end, radiance, pdf).

    normal: the surface normal at p, or zero for a point in a medium.
    """
    u = np.random.default_rng(seed).random((n, 3), np.float32)
    vectors = [np.zeros((n, 3), np.float32) for _ in range(3)]
    pdf = np.zeros(n, np.float32)
    _sample(Packed(as_rendered(made)), np.array(p, np.float32), np.array(normal, np.float32), u, *vectors, pdf)
    return *vectors, pdf


def density(made, p=P, normal=NO_NORMAL):
    def values(w):
        out = np.zeros(len(w), np.float32)
        _density(
            Packed(as_rendered(made)),
            new_stack(),
            np.array(p, np.float32),
            np.array(normal, np.float32),
            np.ascontiguousarray(w),
            out,
        )
        return out

    return values


def sky():
    """Returns a sky image of 8 x 16 texels, most of them dark, one a hundred times as bright."""
    pixels = np.random.default_rng(4).gamma(0.5, size=(8, 16, 1)).repeat(3, 2)
    pixels[2, 5] = 20.0
    return pixels.astype(np.float32)


TRIANGLES = (square((0, 0, 2), (1, 0, 0), (0, -0.7, 0.2), 1), square((-1.5, 0.5, 0), (0, 0, 0.4), (0.1, 0.6, 0), 1))
LONE = replace(TRIANGLES[0], triangles=TRIANGLES[0].triangles[:1])
SCENES = {
    "a triangle": lambda: scene([Material(), emitter(2.0, double_sided=True)], (LONE,)),
    "parallelograms": lambda: scene([Material(), emitter(2.0, double_sided=True)], TRIANGLES),
    "a sphere": lambda: scene([Material(), emitter(2.0)], spheres=(Sphere((1, 1, 1), 0.6, 1),)),
    "a sphere around": lambda: scene([Material(), emitter(2.0, double_sided=True)], spheres=(Sphere((0.5, 0, 0), 2.0, 1),)),
    "an image of a sky": lambda: scene([Material()], (square((0, 0, -9), (1, 0, 0), (0, 1, 0), 0),), environment=sky()),
    "a constant sky": lambda: scene([Material()], (square((0, 0, -9), (1, 0, 0), (0, 1, 0), 0),), environment=0.7),
    "a sky with a sun": lambda: scene(
        [Material()],
        (square((0, 0, -9), (1, 0, 0), (0, 1, 0), 0),),
        environment=Environment(sky=Sky(40.0, 20.0, sun_size=30.0), rotation=50.0),
    ),
    "all of them": lambda: scene(
        [Material(), emitter(2.0, double_sided=True)], TRIANGLES, (Sphere((1, -2, -1), 0.8, 1),), environment=sky()
    ),
}


@grid(
    ("name", "normal"),
    [*((name, NO_NORMAL) for name in SCENES), ("parallelograms", NORMAL)],
    ordinary=("parallelograms", "a sphere", "a sky with a sun"),
)
def test_light_directions_follow_the_mis_density(name, normal):
    made = SCENES[name]()
    direction, _, _, pdf = sample(made, n=150_000, normal=normal)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1, atol=1e-6)
    kept = np.where((pdf > 0)[:, None], direction, np.nan)
    direction_test(kept, density(made, normal=normal), TESTS, (48, 48), 24, name)


@pytest.mark.parametrize("normal", [NO_NORMAL, NORMAL])
@pytest.mark.parametrize("name", SCENES)
def test_both_mis_strategies_use_one_density(name, normal):
    """The pdf returned by `sample_light` equals the pdf used for a BSDF ray that hits the same point."""
    made = SCENES[name]()
    direction, _, radiance, pdf = sample(made, n=20_000, normal=normal)
    again = density(made, normal=normal)(direction)
    good = pdf > 0
    close = np.isclose(again[good], pdf[good], rtol=2e-3)
    if name == "all of them":  # there the pdf is that of the sky plus that of a light in front of it
        close |= again[good] > pdf[good]
    assert close.mean() > 0.998  # some points are on the border of a texel or a light
    assert radiance[good].any(axis=1).mean() > 0.5


def test_a_light_is_chosen_by_its_power():
    """Two spheres, one with 3 times the radiance and half the radius, are chosen by power, the sky with a fixed probability."""
    made = scene([emitter(3.0), emitter(1.0)], spheres=(Sphere((5, 0, 0), 0.5, 0), Sphere((-5, 0, 0), 1.0, 1)), environment=0.01)
    direction, _, radiance, _ = sample(with_light_choice(made, "power"))
    chance = float(made.environment_frame[3])
    from_sky = np.isclose(radiance[:, 0], 0.01)
    assert abs(from_sky.mean() - chance) < limit(2) * math.sqrt(chance * (1 - chance) / N)
    first = (direction[~from_sky, 0] > 0).mean()
    expected = 0.99 * 3 * 0.25 / (3 * 0.25 + 1) + 0.01 / 2
    assert abs(first - expected) < limit(2) * math.sqrt(expected * (1 - expected) / (~from_sky).sum())


def test_uniform_choice_includes_the_environment():
    made = scene([emitter(3.0), emitter(1.0)], spheres=(Sphere((5, 0, 0), 0.5, 0), Sphere((-5, 0, 0), 1.0, 1)), environment=0.01)
    direction, _, radiance, _ = sample(with_light_choice(made, "uniform"))
    from_sky = np.isclose(radiance[:, 0], 0.01)
    first = ~from_sky & (direction[:, 0] > 0)
    for found in (from_sky, first, ~from_sky & ~first):
        assert abs(found.mean() - 1 / 3) < limit(3) * math.sqrt(2 / 9 / N)


def test_sample_ends_lie_just_before_the_light():
    made = SCENES["parallelograms"]()
    direction, end, _, pdf = sample(made, n=5000)
    good = pdf > 0
    o = np.array(P, np.float32)
    along = ((end[good] - o) * direction[good]).sum(1)
    assert not trace(made.bvh, o, end[good] - o, 1.0).shadow.any()
    assert trace(made.bvh, o, direction[good], along * np.float32(1 + 1e-4)).shadow.mean() > 0.999


def test_triangle_points_are_uniform_by_area():
    """Points are uniform by area on a square with vertex colours and alpha, which is not a parallelogram light."""
    lamp = square((0, 0, 2), (1, 0, 0), (0, -1, 0), 1)
    lamp.colors = np.ones((len(lamp.positions), 4), np.float32)
    made = scene([Material(), emitter(1.0)], (lamp,))
    assert len(made.light_primitive) == 2
    _, end, _, _ = sample(made)
    cell = np.clip(((end[:, :2].astype(float) + 1) * 16).astype(int), 0, 31)
    assert_uniform(np.bincount(cell[:, 0] * 32 + cell[:, 1], minlength=1024), TESTS)


@pytest.mark.parametrize("distance", [1.001, 1.01, 2.0, 1e3, 1e5])
def test_sphere_pdf_is_one_over_solid_angle(distance):
    """1 / pdf is the solid angle 2 pi (1 - cos), from next to the sphere to so far away that 1 - cos is 5e-11."""
    made = scene([emitter(1.0)], spheres=(Sphere((0, 0, 0), 1.0, 0),))
    direction, _, radiance, pdf = sample(made, (0, 0, distance))
    sine2 = 1 / distance**2
    solid_angle = 2 * math.pi * sine2 / (1 + math.sqrt(1 - sine2))
    facing = (pdf > 0) & (radiance[:, 0] > 0)
    inverse = 1 / np.maximum(pdf, 1e-30).astype(float)
    assert facing.all()
    np.testing.assert_allclose(inverse, solid_angle, rtol=2e-4)
    assert (np.hypot(direction[:, 0], direction[:, 1]) <= math.sqrt(sine2) * (1 + 1e-4)).all()


def test_without_lights_nothing_is_sampled():
    made = scene([Material(base_color=gray(0.5))], TRIANGLES[:1] and (square((0, 0, 2), (1, 0, 0), (0, 1, 0), 0),))
    _, _, radiance, pdf = sample(made, n=1000)
    assert not pdf.any()
    assert not radiance.any()
    assert not density(made)(np.eye(3, dtype=np.float32)).any()
