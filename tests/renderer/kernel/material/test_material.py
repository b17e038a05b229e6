"""Tests of materials at a point: textures, vertex colours, alpha, absorption, dispersion."""

import numpy as np
import pytest

from renderer.arrays.rows import ABSORBING, ABSORPTION, COLUMNS
from renderer.jit import entry, subroutine
from renderer.kernel.fetch import columns
from renderer.kernel.material.material import (
    LAYER_SLOTS,
    colored_index,
    emission,
    fetch_material,
    has_flag,
    opacity,
    relative_index,
)
from renderer.reference import Packed, by_reference
from renderer.scene.compile import compile_scene
from renderer.scene.description import Image, Instance, Material, SceneDescription, Texture
from tests.renderer.builders import as_rendered, square
from tests.renderer.kernel.subject import facing_up

ZERO, ONE = np.float32(0), np.float32(1)
UP = (ZERO, ZERO, ONE)
_ABSORBING = np.uint32(ABSORBING)
FRAME = ((ONE, ZERO, ZERO), (ZERO, ONE, ZERO), UP)


@subroutine
def _write_material(scene, surface, frame, layers, throughput, u, out):
    """Writes to `out`: base colour, metallic, roughness, opacity, absorption, emission; eta and throughput after dispersion."""
    material = fetch_material(scene, surface, frame, layers, None)
    values = material.base[0], material.base[1], material.base[2], material.metallic, material.roughness
    for k in range(5):
        out[k] = values[k]
    out[5] = opacity(scene, surface.material, surface.uv, surface.uv1, surface.color[3], None)
    absorbs = has_flag(scene, surface.material, _ABSORBING)
    taken = columns(scene.material, surface.material, COLUMNS, ABSORPTION, 3) if absorbs else (ZERO, ZERO, ZERO)
    light = emission(scene, surface.material, surface.uv, surface.uv1, surface.front, None)
    ior, left = colored_index(scene, surface.material, throughput, u)
    for k in range(3):
        out[6 + k] = taken[k]
        out[9 + k] = light[k]
        out[13 + k] = left[k]
    out[12] = relative_index(ior, surface.front)


@entry
def _look(scene, surface, frame, layers, throughput, u, out):
    _write_material(by_reference(scene), surface, frame, layers, throughput, u, out)


def compiled(material, images=(), textures=()):
    """Returns the compiled scene of one square with this material."""
    mesh = square((0, 0, 0), (1, 0, 0), (0, 1, 0), 0)
    mesh.uvs = mesh.uvs1 = np.zeros((4, 2), np.float32)
    description = SceneDescription(meshes=[mesh], instances=[Instance(0)], materials=[material])
    description.images, description.textures = list(images), list(textures)
    return compile_scene(description)


def look_at(scene, uv=(0.5, 0.5), uv1=(0.5, 0.5), color=(1, 1, 1, 1), front=True, u=0.5, carried=(1, 1, 1)):
    """Returns the material kernel's results, by name, at a surface point with the given texture coordinates and vertex colour.

    front: whether it is seen from the front. u: a random number. carried: the path's throughput.
    """
    uv, uv1, color, carried = (tuple(np.float32(v) for v in values) for values in (uv, uv1, color, carried))
    surface = facing_up(uv=uv, uv1=uv1, color=color, front=front)
    out = np.zeros(16, np.float32)
    _look(Packed(as_rendered(scene)), surface, FRAME, np.zeros(LAYER_SLOTS, np.float32), carried, np.float32(u), out)
    return {
        "base": out[:3], "metallic": out[3], "roughness": out[4], "opacity": out[5], "absorption": out[6:9],
        "emission": out[9:12], "eta": out[12], "throughput": out[13:],
    }  # fmt: skip


def look(material, images=(), textures=(), **at):
    """Returns the material kernel's results, by name, at a point of a square with this material; `at`: arguments of `look_at`."""
    return look_at(compiled(material, images, textures), **at)


def texels(*rows):
    """Returns a uint8 RGBA image with the given rows."""
    return Image("i", np.array(rows, np.uint8), srgb=False)


GRAY_HALF = texels([[51, 102, 153, 128]])


@pytest.mark.long
def test_texture_and_vertex_colors_are_multiplied():
    material = Material(
        kind="metallic_roughness", base_color=(0.5, 1, 1), metallic=0.5, roughness=1.0, base_color_texture=0,
        metallic_roughness_texture=0,
    )  # fmt: skip
    found = look(material, [GRAY_HALF], [Texture(0)], color=(1, 0.5, 1, 1))
    np.testing.assert_allclose(found["base"], (0.1, 0.2, 0.6), rtol=1e-5)
    assert found["metallic"] == pytest.approx(0.3)
    assert found["roughness"] == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("mode", "alpha", "cutoff", "expected"),
    [("opaque", 0.2, 0.5, 1), ("blend", 0.5, 0.5, 0.5 * 128 / 255 * 0.8), ("mask", 0.9, 0.37, 0), ("mask", 0.9, 0.35, 1)],
)
def test_alpha_is_product_of_factor_texture_and_vertex(mode, alpha, cutoff, expected):
    material = Material(opacity=alpha, alpha_mode=mode, alpha_cutoff=cutoff, base_color_texture=0)
    assert look(material, [GRAY_HALF], [Texture(0)], color=(1, 1, 1, 0.8))["opacity"] == pytest.approx(expected)


def test_texture_uses_its_uv_set_and_transform():
    checks = texels([[0, 0, 0, 255], [255, 255, 255, 255]])
    plain = Material(base_color=(1, 1, 1), base_color_texture=0)
    assert look(plain, [checks], [Texture(0)], uv=(0.25, 0), uv1=(0.75, 0))["base"][0] == 0
    assert look(plain, [checks], [Texture(0, uv_set=1)], uv=(0.25, 0), uv1=(0.75, 0))["base"][0] == 1
    moved = Texture(0, transform=(0.0, 1.0, 0.5, 1.0, 0.0, 0.0))
    assert look(plain, [checks], [moved], uv=(0.9, 0.25))["base"][0] == 1


def test_emission_is_one_sided_or_double_sided():
    assert (look(Material(emission=(1, 2, 3)))["emission"] == (1, 2, 3)).all()
    assert not look(Material(emission=(1, 2, 3)), front=False)["emission"].any()
    assert look(Material(emission=(1, 2, 3), double_sided=True), front=False)["emission"].any()


def test_attenuation_color_at_attenuation_distance():
    inside = Material(kind="glass", attenuation_color=(0.5, 0.25, 1), attenuation_distance=2.0)
    np.testing.assert_allclose(np.exp(-2 * look(inside)["absorption"]), (0.5, 0.25, 1), rtol=1e-5)
    assert not look(Material(attenuation_color=(0.5, 0.5, 0.5), attenuation_distance=1.0))["absorption"].any()
    assert not look(Material(kind="glass"))["absorption"].any()


@pytest.mark.parametrize("front", [True, False])
def test_dispersion_keeps_one_channel_and_is_unbiased(front):
    """Dispersion keeps one colour channel per path, and is unbiased.

    The indices of red and blue differ from green's by (n - 1) 0.025 dispersion; see KHR_materials_dispersion.
    """
    prism = compiled(Material(kind="glass", ior=1.5, dispersion=2.0))
    carried = np.array((0.2, 0.3, 0.5))
    mean, steps = np.zeros(3), 1000
    for i in range(steps):
        found = look_at(prism, front=front, u=(i + 0.5) / steps, carried=carried)
        mean += found["throughput"] / steps
        channel = int(np.flatnonzero(found["throughput"])[0])
        assert np.count_nonzero(found["throughput"]) == 1
        ior = 1.5 + (channel - 1) * 0.5 * 0.025 * 2
        assert found["eta"] == pytest.approx(ior if front else 1 / ior)
    np.testing.assert_allclose(mean, carried, rtol=1e-3)
    again = look_at(prism, front=front, u=0.9, carried=(0.0, 0.7, 0.0))
    np.testing.assert_allclose(again["throughput"], (0, 0.7, 0), rtol=1e-6)
