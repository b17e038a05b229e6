"""Tests that displacement is exported as a bump map, or as one that moves the surface.

Its heights are in object space, and the surface is stretched differently in u and in v.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from blender.rayfarm_addon.scene.meshes import spans
from blender.rayfarm_addon.scene.model import Scene
from blender.rayfarm_addon.scene.surfaces import Surfaces
from renderer.image.read import read as read_image
from tests.blender.fake_nodes import Image, Node, image_node, linked

RISING = np.repeat(np.arange(8, dtype=np.float32)[None, :, None] / 8, 3, axis=2).repeat(4, axis=0)


class Density:
    """Substitute for the density of a mesh's UVs: a unit of u is 4 units long, a unit of v 2, on an object scaled by 2."""

    scale = 2.0

    def __call__(self, uv_set: int) -> tuple[float, float]:
        return 4.0, 2.0


def displaced(heights: Node | None, method: str = "BUMP", **more: Any) -> tuple[dict[str, Any], list[str], Scene]:
    shader = Node("BSDF_PRINCIPLED", {"Base Color": (0.5, 0.5, 0.5, 1.0), "Normal": None}, ("BSDF",))
    output = Node("OUTPUT_MATERIAL", {"Surface": None, "Volume": None, "Displacement": None}, ())
    linked(shader, output, "Surface")
    node = Node("DISPLACEMENT", {"Height": 0.0, "Midlevel": 0.5, "Scale": 0.25}, ("Displacement",), **{"space": "OBJECT", **more})
    if heights is not None:
        linked(heights, node, "Height")
    linked(node, output, "Displacement")
    tree = SimpleNamespace(get_output_node=lambda engine: output, nodes=[])
    source = SimpleNamespace(name="m", name_full="m", pass_index=0, use_nodes=True, node_tree=tree, displacement_method=method)
    scene = Scene()
    return scene.materials[Surfaces(scene, set()).add(source, Density())].gltf, scene.warnings, scene


@pytest.mark.parametrize(("space", "scale"), [("OBJECT", 2.0), ("WORLD", 1.0)])
def test_heights_are_converted_to_slopes(space: str, scale: float) -> None:
    said, warnings, scene = displaced(image_node(Image("rising", RISING, "Non-Color")), space=space)
    content = scene.images[said["normalTexture"].image].content
    assert isinstance(content, bytes)
    normal = read_image(content, "a.png")[1, 3, :3] / 127.5 - 1
    assert normal[0] / normal[2] == pytest.approx(-0.25 * scale / 4, abs=0.02)
    assert abs(normal[1]) < 0.01
    assert warnings == []


@pytest.mark.parametrize(("space", "scale"), [("OBJECT", 0.25), ("WORLD", 0.125)])
@pytest.mark.parametrize("method", ["DISPLACEMENT", "BOTH"])
def test_displacement_that_moves_the_surface(space: str, scale: float, method: str) -> None:
    said, warnings, scene = displaced(image_node(Image("rising", RISING, "Non-Color")), method, space=space)
    told = said["extensions"]["RAYFARM_materials_displacement"]
    assert (told["displacementScale"], told["displacementMidlevel"]) == (scale, 0.5)
    content = scene.images[told["displacementTexture"].image].content
    assert isinstance(content, bytes)
    pixels = read_image(content, "a.png")
    assert pixels.dtype == np.uint16
    np.testing.assert_allclose(pixels[..., 0], 65535 * RISING[..., 0], atol=0.5)
    assert "normalTexture" not in said
    assert warnings == []


@pytest.mark.parametrize("method", ["BUMP", "BOTH"])
def test_unsupported_displacement_causes_a_warning(method: str) -> None:
    noise = displaced(Node("TEX_NOISE", {"Vector": None}, ("Fac",)), method)
    assert any("its displacement is left out; only that by UV-mapped" in each for each in noise[1])
    assert "normalTexture" not in noise[0]
    assert "RAYFARM_materials_displacement" not in noise[0].get("extensions", {})


def test_surface_lengths_per_uv_unit() -> None:
    """The lengths of a surface per unit of u and per unit of v are 12 and 2.

    The surface is a rectangle of 6 by 2, rotated at random, whose UVs cover the left half of the unit square.
    """
    corners, uvs = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float), np.array([(0, 0), (0.5, 0), (0.5, 1), (0, 1)])
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    at = np.column_stack([corners * (6, 2), np.zeros(4)]) @ turn
    faces = np.array([(0, 1, 2), (0, 2, 3)])
    assert spans(at[faces], uvs[faces]) == pytest.approx((12, 2))
    assert spans(at[faces], np.zeros((2, 3, 2))) is None
