"""Tests that images baked from nodes have the values that Blender's formulas yield for each texel."""

from __future__ import annotations

import colorsys

import numpy as np
import pytest

from blender.rayfarm_addon.scene.color_nodes import BLENDS, hsv, rgb
from blender.rayfarm_addon.scene.image_nodes import Painted, Painter
from blender.rayfarm_addon.scene.images import from_srgb
from blender.rayfarm_addon.scene.model import Scene, TextureUse
from blender.rayfarm_addon.scene.nodes import Blend, ConstantValue, Product
from blender.rayfarm_addon.scene.pictures import Pictures
from blender.rayfarm_addon.scene.textures import Values
from renderer.image.read import read as read_image
from tests.blender.fake_nodes import Image, Node, at, image_node, linked, ramp

SPOTS = np.random.default_rng(5).random((3, 4, 3)).astype(np.float32)
LINEAR = from_srgb(SPOTS)


def spots(space: str = "sRGB") -> Node:
    return image_node(Image("spots", SPOTS, space))


def read(node: Node, default: object = (0.8, 0.8, 0.8), output: str | int = 0):
    scene = Scene()
    return Values(scene, "paint", set()).read(
        at(node, output), list(default) if isinstance(default, tuple) else default, "colour"
    ), scene


def texels(node: Node, output: str | int = 0) -> np.ndarray:
    found, scene = read(node, output=output)
    assert isinstance(found.image, Painted), scene.warnings
    assert found.use is not None
    assert found.factor == 1.0
    return found.image.texels[..., :3]


def test_color_ramp_of_an_image() -> None:
    stops = ((0.2, (1.0, 0.0, 0.0)), (0.8, (0.0, 0.5, 1.0)))
    node = linked(spots(), Node("VALTORGB", {"Fac": 0.5}, ("Color", "Alpha"), color_ramp=ramp(*stops)), "Fac")
    grey = LINEAR @ (0.2126, 0.7152, 0.0722)
    wanted = np.stack([np.interp(grey, [0.2, 0.8], [a, b]) for a, b in zip(stops[0][1], stops[1][1], strict=True)], axis=-1)
    np.testing.assert_allclose(texels(node), wanted, atol=1e-3)


def test_hue_saturation_value_node() -> None:
    numbers = {"Hue": 0.7, "Saturation": 1.2, "Value": 0.6, "Fac": 0.5, "Color": None}
    found = texels(linked(spots(), Node("HUE_SAT", numbers), "Color"))
    for color, made in zip(LINEAR.reshape(-1, 3), found.reshape(-1, 3), strict=True):
        h, s, v = colorsys.rgb_to_hsv(*color)
        turned = colorsys.hsv_to_rgb((h + 0.7 + 0.5) % 1, min(s * 1.2, 1), v * 0.6)
        np.testing.assert_allclose(made, 0.5 * color + 0.5 * np.array(turned), atol=1e-5)


def test_rgb_to_hsv_round_trip() -> None:
    np.testing.assert_allclose(rgb(hsv(LINEAR)), LINEAR, atol=1e-6)


@pytest.mark.parametrize("how", sorted(BLENDS))
def test_blend_with_factor_zero_returns_the_first_input(how: str) -> None:
    zero = np.zeros((3, 4, 1), np.float32)
    np.testing.assert_allclose(BLENDS[how](zero, LINEAR, LINEAR[::-1]), LINEAR, atol=1e-6)


def test_mix_node_with_arithmetic_factor() -> None:
    """A Mix node is baked to the blend of its inputs: an image overlaid with a colour.

    The mix factor is the square of another image's green channel.
    """
    mix = Node("MIX_RGB", {"Fac": 0.5, "Color1": None, "Color2": (0.9, 0.3, 0.2, 1)}, blend_type="OVERLAY", use_clamp=False)
    power = Node("MATH", {"a": 0.5, "b": 2.0, "c": 0.0}, ("Value",), operation="POWER", use_clamp=False)
    linked(linked(spots(), Node("SEPARATE_COLOR", {"Color": None}, ("Red", "Green", "Blue"), mode="RGB"), 0), power, 0, "Green")
    linked(spots(), linked(power, mix, 0), 1)
    t = LINEAR[..., 1:2] ** 2
    b = np.array([0.9, 0.3, 0.2])
    wanted = np.where(LINEAR < 0.5, LINEAR * (1 - t + 2 * t * b), 1 - (1 - t + 2 * t * (1 - b)) * (1 - LINEAR))
    np.testing.assert_allclose(texels(mix), wanted, atol=1e-5)


def test_constant_inputs_yield_a_constant() -> None:
    node = Node("MATH", {"a": 3.0, "b": 4.0, "c": 0.5}, ("Value",), operation="MULTIPLY_ADD", use_clamp=False)
    found, scene = read(node, 0.5)
    assert found.image is None
    assert found.factor == pytest.approx(12.5)
    assert scene.warnings == []


def test_unsupported_nodes_are_named() -> None:
    noise = Node("TEX_NOISE", {"Vector": None})
    found, scene = read(linked(noise, Node("GAMMA", {"Color": None, "Gamma": 2.0}), 0))
    assert found.image is None
    assert scene.warnings == ["Material paint: what makes its colour (Gamma) is not read; a plain value stands for it."]


def test_images_with_different_mappings_are_not_mixed() -> None:
    turned = spots()
    place = Node(
        "MAPPING",
        {"Vector": None, "Location": (0, 0, 0), "Rotation": (0, 0, 1.0), "Scale": (1, 1, 1)},
        ("Vector",),
        vector_type="POINT",
    )
    linked(place, turned, "Vector")
    mix = Node("MIX_RGB", {"Fac": 0.5, "Color1": None, "Color2": None}, blend_type="ADD", use_clamp=False)
    found, scene = read(linked(spots(), linked(turned, mix, 2), 1))
    assert found.image is None
    assert len(scene.warnings) == 1


def test_blend_of_shaders_is_baked() -> None:
    found = Values(Scene(), "paint", set()).read(
        Blend(at(spots("Non-Color")), ConstantValue(0.2), ConstantValue([1.0, 0.0, 0.0])), [0.0] * 3, "colour"
    )
    share = SPOTS @ np.array([0.2126, 0.7152, 0.0722], np.float32)
    np.testing.assert_allclose(found.image.texels[..., 0], 0.2 + 0.8 * share, atol=1e-5)
    np.testing.assert_allclose(found.image.texels[..., 1], 0.2 - 0.2 * share, atol=1e-5)


def test_heights_are_converted_to_slopes() -> None:
    """A height map is exported as a normal map with the slope of the heights.

    The heights rise by 1/8 per texel, a texel is half a unit wide, and the bump distance is 0.5: the slope is 1/8.
    """
    rising = np.repeat(np.arange(8, dtype=np.float32)[None, :, None] / 8, 3, axis=2).repeat(4, axis=0)
    bump = Node("BUMP", {"Strength": 1.0, "Distance": 0.5, "Height": None, "Normal": None}, ("Normal",), invert=False)
    linked(image_node(Image("rising", rising, "Non-Color")), bump, "Height")
    values = Values(Scene(), "paint", set())
    from blender.rayfarm_addon.scene.nodes import source_of

    found = values.bumps(source_of(at(bump))[0], lambda uv_set: (4.0, 1.0))
    assert found is not None
    normal = found.image.texels[1, 3, :3] * 2 - 1
    slope = 0.5 * (1 / 8) / 0.5
    np.testing.assert_allclose(normal, np.array([-slope, 0, 1]) / np.hypot(slope, 1), atol=1e-6)
    assert values.bumps(source_of(at(bump))[0], lambda uv_set: None) is None


def test_color_on_number_input_becomes_luminance() -> None:
    """A colour connected to a number input is converted to its luminance, not to its alpha or its green channel."""
    scene = Scene()
    found, _ = read(spots("Non-Color"), 1.0)
    picture = Pictures(scene, "paint").packed([(found, 3)], found, True)
    assert picture is not None
    content = scene.images[picture.image].content
    assert isinstance(content, bytes)
    alpha = read_image(content, "a.png")[..., 3] / 255
    np.testing.assert_allclose(alpha, SPOTS @ np.array([0.2126, 0.7152, 0.0722]), atol=2 / 255)


def test_product_above_one_is_scaled_down() -> None:
    found = Painter("paint", lambda _: TextureUse("")).paint(Product(at(spots("Non-Color")), ConstantValue(3.0)), "light")
    assert isinstance(found, tuple)
    most = found[0].scale_down()
    assert most == pytest.approx(3 * SPOTS.max(), rel=1e-5)
    np.testing.assert_allclose(found[0].texels[..., :3] * most, 3 * SPOTS, atol=1e-5)
