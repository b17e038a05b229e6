"""Tests of scenes with closed-form solutions: the mean is within three standard errors, estimated from the film."""

import math
from pathlib import Path

import numpy as np
import pytest

from renderer.arrays.kernel_variant import variant_of
from renderer.film import ALBEDO, DEPTH, NORMAL, mean
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Image, Instance, Material, SceneDescription, Sphere, Texture
from renderer.scene.load import read
from renderer.scene.readers.strands import Strand, strands_mesh
from renderer.settings import RenderSettings
from tests.renderer.builders import box, disk, emitter, gray, scene, settings, square
from tests.renderer.judge import assert_mean, mean_and_error

SCENES = Path(__file__).parents[2] / "scenes"
WHITE = Material(base_color=gray(1.0))
FLOOR = square((0, 0, 0), (5, 0, 0), (0, 0, -5), 0)  # faces +y


@pytest.mark.parametrize("shape", ["sphere", "box"])
@pytest.mark.parametrize("segments", [1, 2, 5])
def test_furnace_by_number_of_segments(shape, segments):
    shapes = {"spheres": (Sphere((0, 0, 0), 1.0),)} if shape == "sphere" else {"meshes": (box(0),)}
    furnace = scene([emitter(0.5, 0.5, double_sided=True)], **shapes)
    sums = render_frame(furnace, settings((0.3, 0.2, 0.1), (1, 0, 0), 70, max_depth=segments), 64)
    assert_mean(sums, 0.5 * sum(0.5**i for i in range(segments)), slack=1e-4)


@pytest.mark.parametrize("albedo", [0.5, 0.9])
def test_furnace_of_unlimited_depth(albedo):
    furnace = scene([emitter(1 - albedo, albedo, double_sided=True)], spheres=(Sphere((0, 0, 0), 1.0),))
    sums = render_frame(furnace, settings((0.3, 0.2, 0.1), (1, 0, 0), 70, max_depth=400), 128)
    assert_mean(sums, 1.0, slack=1e-4)


@pytest.mark.parametrize("degrees", [0, 50])
def test_sphere_light(degrees):
    distance, radius = 3.0, 0.8
    a = math.radians(degrees)
    light = Sphere((distance * math.sin(a), distance * math.cos(a), 0.0), radius, 1)
    lit = scene([WHITE, emitter(2.0)], (FLOOR,), (light,))
    sums = render_frame(lit, settings((0, 1, -2), (0, 0, 0), 0.01, max_depth=2), 64)
    assert_mean(sums, 2.0 * (radius / distance) ** 2 * math.cos(a), slack=1e-4)


def test_unit_square_light():
    lit = scene([WHITE, emitter(1.0)], (FLOOR, square((0, 1, 0), (0.5, 0, 0), (0, 0, 0.5), 1)))
    sums = render_frame(lit, settings((0, 0.5, -2), (0, 0, 0), 0.01, max_depth=2), 256)
    assert_mean(sums, 0.752275 / math.pi, slack=1e-4)


def test_square_light_is_one_sided():
    lit = scene([WHITE, emitter(1.0)], (FLOOR, square((0, 1, 0), (0.5, 0, 0), (0, 0, -0.5), 1)))
    assert mean_and_error(render_frame(lit, settings((0, 0.5, -2), (0, 0, 0), max_depth=3), 4))[0] == 0


def test_coaxial_disk():
    radius, height = 0.7, 1.1
    lit = scene([WHITE, emitter(1.0)], (FLOOR, disk(radius, height, 512, 1)))
    sums = render_frame(lit, settings((0, 0.5, -2), (0, 0, 0), 0.01, max_depth=2), 256)
    assert_mean(sums, radius**2 / (radius**2 + height**2), slack=1e-4)


@pytest.mark.parametrize(("arrangement", "factor"), [("parallel", 0.1998249), ("perpendicular", 0.2000438)])
def test_form_factors(arrangement, factor):
    receiver = square((0, 0, 0), (0.5, 0, 0), (0, 0, -0.5), 0)
    light = (
        square((0, 1, 0), (0.5, 0, 0), (0, 0, 0.5), 1)
        if arrangement == "parallel"
        else square((0, 0.5, 0.5), (0, 0.5, 0), (0.5, 0, 0), 1)
    )
    # A plane viewed perpendicularly is sampled uniformly by area, so the picture's mean is the receiver's.
    eye = (0.0, 0.9, 0.0)
    sums = render_frame(
        scene([WHITE, emitter(1.0)], (receiver, light)),
        settings(eye, (0, 0, 0), 2 * math.degrees(math.atan(0.5 / 0.9)), max_depth=2),
        256,
    )
    assert_mean(sums, factor, slack=1e-4)


def test_convex_diffuse_body_in_constant_light():
    lit = scene([Material(base_color=gray(0.6))], spheres=(Sphere((0, 0, 0), 1.0),), environment=2.0)
    sums = render_frame(lit, settings((0, 0, 3), (0, 0, 0), 20), 16)
    assert_mean(sums, 1.2, slack=1e-4)


def test_earth_sized_sphere_has_no_ring_artefacts():
    ground = scene([Material(base_color=gray(0.5))], spheres=(Sphere((0, -1e5, 0), 1e5),), environment=1.0)
    sums = render_frame(ground, settings((0, 1.5, 0), (0, 0.0, -20), 6, size=48), 64)
    for row in range(0, 48, 4):  # ring-shaped shadows would show as rows of the picture
        assert_mean(sums[:, row : row + 4], 0.5)


def test_lossless_glass_is_invisible_in_constant_light():
    glass = scene([Material(kind="glass", base_color=gray(1.0))], spheres=(Sphere((0, 0, 0), 1.0),), environment=1.0)
    sums = render_frame(glass, settings((0, 0, 3), (0, 0, 0), 30, max_depth=200), 64)
    assert_mean(sums, 1.0, slack=1e-3)


def test_glass_slab():
    slab = tuple(square((0, 0, z), (s * 9, 0, 0), (0, 9, 0), 0) for z, s in ((0.1, 1), (-0.1, -1)))
    behind = square((0, 0, -2), (9, 0, 0), (0, 9, 0), 1)
    lit = scene([Material(kind="glass", base_color=gray(1.0), ior=1.5), emitter(1.0)], (*slab, behind))
    sums = render_frame(lit, settings((0, 0, 3), (0, 0, 0), 0.5, max_depth=64), 256)
    assert_mean(sums, 0.923077, slack=1e-4)


@pytest.mark.parametrize("ior", [1.0, 1.5])
def test_absorbing_slab(ior):
    """A slab transmits (1 - r)^2 t / (1 - (r t)^2) at normal incidence, with Fresnel reflectance r and t = exp(-sigma d)."""
    thickness, left = 0.2, 0.4  # attenuation of white light after a distance of 1
    slab = tuple(square((0, 0, z), (s * 9, 0, 0), (0, 9, 0), 0) for z, s in ((thickness / 2, 1), (-thickness / 2, -1)))
    behind = square((0, 0, -2), (9, 0, 0), (0, 9, 0), 1)
    tinted = Material(kind="glass", base_color=gray(1.0), ior=ior, attenuation_color=gray(left), attenuation_distance=1.0)
    sums = render_frame(scene([tinted, emitter(1.0)], (*slab, behind)), settings((0, 0, 3), (0, 0, 0), 0.5, max_depth=64), 256)
    passed = left**thickness
    reflected = ((ior - 1) / (ior + 1)) ** 2
    assert_mean(sums, (1 - reflected) ** 2 * passed / (1 - (reflected * passed) ** 2), slack=1e-4)


def test_half_transmitting_white_shell_in_constant_light():
    """A shell that reflects half of the light and transmits the other half is invisible in constant light."""
    shell = Material(kind="metallic_roughness", base_color=gray(1.0), specular=0.0, diffuse_transmission=0.5)
    lit = scene([shell], spheres=(Sphere((0, 0, 0), 1.0),), environment=1.0)
    assert_mean(render_frame(lit, settings((0, 0, 3), (0, 0, 0), 30, max_depth=200), 64), 1.0, slack=0.01)


WHITES = {
    "metal": Material(kind="metallic_roughness", base_color=gray(1.0), metallic=1.0, roughness=0.7),
    "smooth metal": Material(kind="metallic_roughness", base_color=gray(1.0), metallic=1.0, roughness=0.1),
    "plastic": Material(kind="metallic_roughness", base_color=gray(1.0), roughness=0.3),
    "rough plastic": Material(kind="metallic_roughness", base_color=gray(1.0), roughness=1.0),
    "rough glass": Material(kind="glass", base_color=gray(1.0), roughness=0.5),
    "rougher glass": Material(kind="glass", base_color=gray(1.0), roughness=0.9),
    "pane": Material(kind="glass", base_color=gray(1.0), roughness=0.5, thin=True),
}


@pytest.mark.parametrize("name", WHITES)
def test_white_materials_in_a_white_furnace(name):
    """White materials on a sphere are invisible in constant light, at all angles and with light from both sides."""
    ball = scene([WHITES[name]], (), (Sphere((0, 0, 0), 1.0),), environment=1.0)
    sums = render_frame(ball, settings((0, 0, 8), (0, 0, 0), 14.6, max_depth=200), 48)
    assert_mean(sums, 1.0, slack=8e-3 if "glass" in name else 2e-3, tests=len(WHITES))


@pytest.mark.long
@pytest.mark.parametrize("count", [1, 501])
def test_white_hair_in_a_white_furnace(count):
    """Bent strands of white hair are invisible in constant light: every fibre scatters what it receives."""
    turns = np.linspace(0, 4, 14)
    helix = np.column_stack([0.4 * np.cos(turns), turns / 2 - 1, 0.4 * np.sin(turns)])
    strands = [Strand(helix * (s, 1, s), np.full(len(turns), 0.08)) for s in np.linspace(0.5, 2, count)]
    lit = scene([Material(kind="hair", base_color=gray(1.0))], (strands_mesh(strands, fibres=True),), environment=1.0)
    assert variant_of(lit) == "hair" and len(lit.tangent) > 0
    assert_mean(render_frame(lit, settings((0, 0, 6), (0, 0, 0), 30, max_depth=400), 64), 1.0, slack=2e-3, tests=2)


@pytest.mark.long
@pytest.mark.parametrize("aspect", [1.0, 0.5])
def test_white_hair_of_facets_in_a_white_furnace(aspect):
    turns = np.linspace(0, 4, 14)
    helix = np.column_stack([0.4 * np.cos(turns), turns / 2 - 1, 0.4 * np.sin(turns)])
    mesh = strands_mesh([Strand(helix, np.full(len(turns), 0.08))], fibres=True, aspect=aspect)
    white = Material(kind="hair", model="huang", base_color=gray(1.0), ior=1.55, tilt=0.0, aspect_ratio=aspect)
    lit = scene([white], (mesh,), environment=1.0)
    assert variant_of(lit) == "huang" and len(lit.uv1) == (0 if aspect == 1 else len(lit.position))
    assert_mean(render_frame(lit, settings((0, 0, 6), (0, 0, 0), 30, max_depth=400), 64), 1.0, slack=3e-3, tests=2)


def test_image_environment_irradiance():
    rng = np.random.default_rng(5)
    sky = rng.gamma(0.3, 1.0, (8, 16, 1)).repeat(3, 2).astype(np.float32)
    up = scene([WHITE], (FLOOR,), environment=sky)
    sums = render_frame(up, settings((0, 1, -2), (0, 0, 0), 0.01, max_depth=2), 256)
    v = (np.arange(4096) + 0.5) / 4096
    rows = v * 8 - 0.5
    top = np.clip(np.floor(rows).astype(int), 0, 7)
    below = np.clip(np.floor(rows).astype(int) + 1, 0, 7)
    t = (rows - np.floor(rows))[:, None]
    ring = (sky[top, :, 0] * (1 - t) + sky[below, :, 0] * t).mean(1)  # linear interpolation in u preserves each row's mean
    theta = v * np.pi
    expected = (ring * np.clip(np.cos(theta), 0, None) * np.sin(theta)).sum() * np.pi / 4096 * 2
    assert_mean(sums, expected, slack=1e-3)


@pytest.mark.parametrize("rotation", [0, 90])
def test_environment_orientation(rotation):
    sky = np.zeros((4, 8, 3), np.float32)
    sky[:, 5:7] = 1.0  # the columns around +x
    small = square((0, -50, 0), (0.1, 0, 0), (0, 0, -0.1), 0)
    description = SceneDescription(
        meshes=[small],
        instances=[Instance(0)],
        materials=[WHITE],
        images=[Image("sky", sky, srgb=False)],
        environment=Environment(image=0, rotation=rotation),
    )
    towards = (1, 0, 0) if rotation == 0 else (0, 0, -1)  # +x rotated about +y, counter-clockwise seen from above
    compiled = compile_scene(description)
    assert mean(render_frame(compiled, settings((0, 0, 0), towards, 10, size=4), 1), 24).min() > 0.99
    assert mean(render_frame(compiled, settings((0, 0, 0), tuple(-x for x in towards), 10, size=4), 1), 24).max() == 0


@pytest.mark.parametrize("depth", [2, 5])
def test_mirror_reflectances_multiply(depth):
    """An oblique ray between two parallel mirrors hits them alternately, then leaves to the sky, dimmed by each reflection."""
    mirrors = tuple(square((0, y, 0), (s * 2, 0, 0), (0, 0, 2), 0) for y, s in ((1, 1), (-1, -1)))
    lit = scene([Material(kind="mirror", base_color=gray(0.8))], mirrors, environment=3.0)
    # The ray starts in the middle at 60 degrees to the normal: each crossing advances 2 tan 60 = 3.46, the first half of that.
    sums = render_frame(lit, settings((0, 0, 0), (math.tan(math.radians(60)), 1, 0), 0.01, max_depth=depth), 2)
    assert mean(sums, 24) == pytest.approx(3.0 * 0.8, rel=1e-5)


def test_textured_light_irradiance():
    """The irradiance below a light with bilinear texels is the integral over its area: E = sum of L cos cos' / d^2 dA."""
    codes = np.random.default_rng(8).integers(0, 256, (4, 4, 4)).astype(np.uint8)
    light = square((0, 1, 0), (0.5, 0, 0), (0, 0, 0.5), 1)
    light.uvs = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    description = SceneDescription(
        meshes=[FLOOR, light],
        instances=[Instance(0), Instance(1)],
        materials=[WHITE, Material(base_color=gray(0), emission=(2.0, 2.0, 2.0), emission_texture=0)],
        textures=[Texture(0, "clamp", "clamp")],
        images=[Image("squares", codes)],
    )
    n = 512
    place = (np.arange(n) + 0.5) / n
    texel = np.clip(place * 4 - 0.5, 0, 3)
    low = np.minimum(texel.astype(int), 2)
    t = texel - low
    level = codes[..., :3] / 255
    linear = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    rows = linear[low] * (1 - t)[:, None, None] + linear[low + 1] * t[:, None, None]
    radiance = 2 * (rows[:, low] * (1 - t)[:, None] + rows[:, low + 1] * t[:, None])
    z, x = np.meshgrid(place - 0.5, place - 0.5, indexing="ij")
    weight = (x * x + z * z + 1) ** -2 / n**2
    expected = (radiance * weight[..., None]).sum((0, 1)).mean() / math.pi
    lit = compile_scene(description)
    assert_mean(render_frame(lit, settings((0, 0.5, -2), (0, 0, 0), 0.01, max_depth=2), 256), expected, slack=1e-4)
    seen = render_frame(lit, settings((0, 0.9, 0), (0.25 - 1e-7, 1, 0.25), 0.01, max_depth=1), 1)
    direct = radiance[round(0.75 * n), round(0.75 * n)]
    np.testing.assert_allclose(mean(seen, 24).mean((0, 1)), direct, rtol=0.01)


def test_cornell_box_mean_matches_other_renderers():
    description = read(SCENES, "cornell-box.yaml")
    view = description.cameras[0].view
    sums = render_frame(compile_scene(description), RenderSettings(96, 96, view, max_depth=8, filter="box"), 192)
    assert_mean(sums, 0.1471, slack=0.01 - 3 * 0.003, most_error=0.003)


def test_first_hit_channels():
    plate = scene([Material(base_color=(0.2, 0.4, 0.6))], (square((0, 0, 0), (1, 0, 0), (0, 1, 0), 0),), environment=1.0)
    sums = render_frame(plate, settings((0, 0, 3), (0, 0, 0), 0.1, size=4), 2)
    np.testing.assert_allclose(mean(sums, 24, DEPTH), 3.0, rtol=1e-5)
    np.testing.assert_allclose(mean(sums, 24, NORMAL), np.broadcast_to([0, 0, 1], (4, 4, 3)), atol=1e-6)
    np.testing.assert_allclose(mean(sums, 24, ALBEDO), np.broadcast_to([0.2, 0.4, 0.6], (4, 4, 3)), rtol=1e-5)
