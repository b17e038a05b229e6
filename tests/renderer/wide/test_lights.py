"""Tests that light sampling for eight points has the same bits as for each point alone."""

import functools

import numpy as np
import pytest

from renderer.arrays.kernel_variant import strip_absent_features, variant_of
from renderer.jit import entry, template
from renderer.kernel.fetch import row
from renderer.kernel.light.environment import environment_light, sample_cdf, sample_cdf_row, sample_environment
from renderer.kernel.light.lights import choose_light, environment_seen, primitive_light_pdf, sample_light, sample_one_light
from renderer.scene.compile import compile_scene
from renderer.scene.cutpoints import cutpoints
from renderer.scene.description import Environment, Image, Instance, Light, Material, SceneDescription, Sky, Sphere, Texture
from renderer.scene.lights import cumulative, with_light_choice
from renderer.wide.rows import load_ints
from renderer.wide.values import to_int, u32
from tests.renderer.builders import emitter, gray, icosphere, scene, square
from tests.renderer.wide.both import LANES, assert_same_bits, both, keep

pytestmark = pytest.mark.long  # pictures cover this in tests/renderer/kernel/backends/test_features.py

N = 8 * 500


@template
def in_both(formula, made, width, given, order, eight, one):
    """Evaluates a formula that reads the scene `made`, for eight rows of `given` at a time and for each alone.

    Otherwise as both.in_both, which stores the results in `eight` and `one`.
    """
    for i in range(0, len(given), LANES):
        number = load_ints(order, np.uintp(i))
        keep(eight, i, number, formula(made, row(given, number, width)))
        for j in range(i, i + LANES):
            keep(one, j, j, formula(made, row(given, j, width)))


def of(kernel, made, given, count):
    return both(functools.partial(kernel, made), given, count)


FLOOR = (square((0, 0, -9), (1, 0, 0), (0, 1, 0), 0),)


def plain(made):
    """Returns the scene with its absent features removed, as the kernel variant that renders it receives it."""
    return strip_absent_features(made, variant_of(made))


def sky():
    pixels = np.random.default_rng(4).gamma(0.5, size=(8, 16, 3)).astype(np.float32)
    pixels[2, 5] = 20.0
    return pixels


SKIES = {
    "an image": sky,
    "one colour": lambda: 0.7,
    "a sun": lambda: Environment(sky=Sky(40.0, 20.0, sun_size=30.0), rotation=50.0),
}


@template
def _environment_formula(made, given):
    d, pdf = sample_environment(made, given[0], (given[1], given[2]))
    light, density = environment_light(made, (given[3], given[4], given[5]), given[0] < np.float32(0.5))
    pdfs = pdf, density
    return d + light + pdfs  # Numba refuses starred tuples in a function that takes a scene


@entry
def _environment(made, given, order, eight, one):
    in_both(_environment_formula, made, 6, given, order, eight, one)


def unit(rng, n):
    d = rng.standard_normal((n, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


@pytest.mark.parametrize("name", SKIES)
def test_environment_sampling_for_eight_lanes(name):
    made = plain(scene([Material()], FLOOR, environment=SKIES[name]()))
    rng = np.random.default_rng(1)
    d = unit(rng, N)
    d[:8] = (0, 1, 0), (0, -1, 0), (0, 0, 1), (-0.0, 0, 1), (0, 0, -1), (0, 1.0000001, 0), (1, 0, 0), (-1, 0, 0)
    eight, one = of(_environment, made, np.concatenate([rng.random((N, 3)), d], 1), 8)
    assert_same_bits(eight, one)


@template
def _tables_formula(tables, given):
    cdf, cdfs, start, starts = tables
    i, rest, width = sample_cdf(cdf, given[0])
    k, again, _ = sample_cdf_row(cdfs, starts, np.uint32(2), given[1])
    j, _, _ = sample_cdf_row(cdf, start, np.uint32(0), given[0])
    return i, rest, width, j, k, again


@entry
def _choices(tables, given, order, eight, one):
    in_both(_tables_formula, tables, 2, given, order, eight, one)


@pytest.mark.parametrize("count", [1, 5, 9, 300])
def test_cdf_choices_for_eight_lanes(count):
    rng = np.random.default_rng(count)
    cdfs = np.stack([cumulative(rng.random(count) ** 3 * (rng.random(count) > 0.3) + 1e-9) for _ in range(3)])
    tables = cdfs[2].copy(), cdfs, cutpoints(cdfs[2]), cutpoints(cdfs)
    u = rng.random((N, 2), np.float32)
    edges = cdfs[2][cdfs[2] < 1]
    u[: len(edges), 1] = u[: len(edges), 0] = edges
    eight, one = of(_choices, tables, u, 6)
    np.testing.assert_array_equal(eight, one)
    np.testing.assert_array_equal(one[0], one[3])
    np.testing.assert_array_equal(one[0], np.searchsorted(cdfs[2], u[:, 0], "right") - 1)


@template
def _lights_formula(made, given):
    p, n, hit = (given[0], given[1], given[2]), (given[3], given[4], given[5]), (given[6], given[7], given[8])
    u, number = (given[9], given[10]), u32(to_int(given[12]))
    light, chance = choose_light(made, p, n, given[11])
    one, any_ = sample_one_light(made, number, p, n, u, None), sample_light(made, p, n, given[11], u, None)
    pdf = primitive_light_pdf(made, u32(to_int(given[13])), p, n, hit, abs(given[3]), given[4] < np.float32(0.5), None)
    seen = environment_seen(made, n, given[10] < np.float32(0.5))
    numbers = light, any_.alone, one.alone, chance, pdf, seen[1], any_.pdf, one.pdf
    return numbers + seen[0] + any_.direction + any_.end + any_.radiance + one.direction + one.end + one.radiance


@entry
def _lights(made, given, order, eight, one):
    in_both(_lights_formula, made, 14, given, order, eight, one)


SHINING = [Material(), emitter(2.0, double_sided=True), emitter(3.0)]
TRIANGLES = (square((0, 0, 2), (1, 0, 0), (0, -0.7, 0.2), 1), square((-1.5, 0.5, 0), (0, 0, 0.4), (0.1, 0.6, 0), 2))
LAMP = Sphere((0.5, 0, 0), 2.0, 1)  # contains most of the points
BALL = Sphere((1, 1, 1), 0.6, 2)
BULBS = (Light("point", gray(3), (0, 3, 0), radius=0.2), Light("directional", gray(0.5), direction=(0, -1, 0.2), angle=2.0))


def textured():
    """Returns an emissive mesh with random texels and fading vertices, a ball with the same, and a sky."""
    mesh = square((0, 0, 2), (1, 0, 0), (0, -0.7, 0.2), 1)
    mesh.uvs = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    mesh.colors = np.linspace(0, 1, 16, dtype=np.float32).reshape(4, 4)
    codes = np.random.default_rng(5).integers(0, 256, (8, 8, 4)).astype(np.uint8)
    veil = Material(emission=(3.0, 2.0, 1.0), emission_texture=0, double_sided=True, opacity=0.7, alpha_mode="blend")
    return compile_scene(
        SceneDescription(
            meshes=[mesh, square((-1.5, 0.5, 0), (0, 0, 0.4), (0.1, 0.6, 0), 0)],
            instances=[Instance(0), Instance(1)],
            spheres=[Sphere((1, 1, 1), 0.6, 1)],
            materials=[emitter(2.0), veil],
            textures=[Texture(0)],
            images=[Image("texels", codes), Image("sky", sky(), srgb=False)],
            environment=Environment(image=1),
        )
    )


LIGHTS = {
    "parallelograms": lambda: with_light_choice(scene(SHINING, TRIANGLES), "power"),
    "triangles": lambda: with_light_choice(scene(SHINING, (icosphere(0, 1, 0.7, (-0.5, 1.0, 0.3)),)), "power"),
    "spheres": lambda: with_light_choice(scene(SHINING, spheres=(LAMP, BALL)), "power"),
    "parallelograms, spheres and a sky": lambda: with_light_choice(
        scene(SHINING, TRIANGLES, (LAMP, BALL), environment=sky()), "power"
    ),
    "without a body": lambda: with_light_choice(scene(SHINING, TRIANGLES, (BALL,), lights=BULBS), "power"),
    "a tree": lambda: scene(SHINING, TRIANGLES, (LAMP, BALL), 0.3, BULBS),  # the default choice of lights
    "textures": textured,
}


# Scenes of the full variant need everything compiled again.
FULL = ("without a body", "a tree", "textures")


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.long] if name in FULL else []) for name in LIGHTS])
def test_light_sampling_for_eight_lanes(name):
    made = plain(LIGHTS[name]())
    rng = np.random.default_rng(2)
    lights = len(made.light_primitive)
    bodies = np.flatnonzero(made.light_primitive < len(made.triangle) + len(made.sphere))
    p, hit = rng.uniform(-2.5, 2.5, (2, N, 3))
    p[::50], p[1::50] = (0, 0, 2), (1, 1, 1)  # points in a light's plane and in a light's centre
    numbers = rng.integers(0, lights, N), rng.choice(bodies, N)
    eight, one = of(_lights, made, np.concatenate([p, unit(rng, N), hit, rng.random((N, 3)), np.stack(numbers, 1)], 1), 29)
    assert_same_bits(eight, one)
