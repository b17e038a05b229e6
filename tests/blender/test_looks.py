"""Shaders and mixes of them in terms of one principled BSDF."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from blender.rayfarm_addon.scene.looks import look_of
from blender.rayfarm_addon.scene.model import Scene
from blender.rayfarm_addon.scene.nodes import constant, followed
from blender.rayfarm_addon.scene.surfaces import Surfaces
from tests.blender.fake_nodes import Node, at, linked

OUT = ("BSDF",)


def diffuse(*color: float) -> Node:
    return Node("BSDF_DIFFUSE", {"Color": (*color, 1.0), "Roughness": 0.0, "Normal": None}, OUT)


def glossy(*color: float, roughness: float = 0.2) -> Node:
    return Node("BSDF_GLOSSY", {"Color": (*color, 1.0), "Roughness": roughness, "Normal": None}, OUT)


def clear() -> Node:
    return Node("BSDF_TRANSPARENT", {"Color": (1.0, 1.0, 1.0, 1.0)}, OUT)


def mixed(first: Node, second: Node, share: float | Node = 0.5) -> Node:
    mix = Node("MIX_SHADER", {"Fac": share if isinstance(share, float) else 0.5, "a": None, "b": None}, ("Shader",))
    linked(second, linked(first, mix, 1), 2)
    return mix if isinstance(share, float) else linked(share, mix, 0)


def looked(node: Node) -> tuple[Any, list[str]]:
    told: list[str] = []
    look = look_of(followed(at(node))[0], told.append)
    assert look is not None
    return lambda name: constant(look.input(name)), told


def material(node: Node) -> tuple[dict[str, Any], list[str]]:
    """glTF's JSON of it, as the add-on writes it."""
    output = Node("OUTPUT_MATERIAL", {"Surface": None, "Volume": None, "Displacement": None}, ())
    linked(node, output, "Surface")
    tree = SimpleNamespace(get_output_node=lambda engine: output)
    source = SimpleNamespace(name="m", name_full="m", pass_index=0, use_nodes=True, node_tree=tree)
    scene = Scene()
    return scene.materials[Surfaces(scene, set()).add(source)].gltf, scene.warnings


def test_a_mix_is_what_lies_between() -> None:
    told, said = looked(mixed(glossy(1.0, 0.0, 0.0, roughness=0.2), glossy(0.0, 0.0, 1.0, roughness=0.6), 0.25))
    assert told("Metallic") == 1.0
    assert told("Roughness") == pytest.approx(0.3)
    assert told("Base Color") == pytest.approx([0.75, 0, 0.25])
    assert said == ["of two roughnesses that are mixed, one between is shown"]


@pytest.mark.parametrize("is_first", [True, False])
def test_a_mix_of_matt_and_metal_reflects_as_much(is_first: bool) -> None:
    matt, metal = diffuse(0.6, 0.0, 0.0), glossy(0.0, 0.9, 0.0, roughness=0.3)
    told, said = looked(mixed(matt, metal, 0.25) if is_first else mixed(metal, matt, 0.75))
    assert told("Roughness") == 0.3
    assert told("Base Color")[:3] == pytest.approx([0.6, 0, 0])
    assert told("Specular Tint")[:3] == pytest.approx([0.0, 0.9, 0.0])
    assert ((told("IOR") - 1) / (told("IOR") + 1)) ** 2 == pytest.approx(0.25)
    assert told("Metallic") is None
    assert said == []


def test_a_mix_with_what_is_clear_is_alpha() -> None:
    for share, node in ((0.3, mixed(clear(), diffuse(0.2, 0.7, 0.2), 0.3)), (0.7, mixed(diffuse(0.2, 0.7, 0.2), clear(), 0.3))):
        told, _ = looked(node)
        assert told("Alpha") == pytest.approx(share)
        assert told("Base Color") == pytest.approx([0.2, 0.7, 0.2])
        found, warnings = material(node)
        assert found["pbrMetallicRoughness"]["baseColorFactor"] == pytest.approx([0.2, 0.7, 0.2, share])
        assert found["alphaMode"] == "BLEND"
        assert warnings == []
    told, _ = looked(mixed(mixed(clear(), diffuse(0.2, 0.7, 0.2), 0.5), diffuse(0.2, 0.7, 0.2), 0.5))
    assert told("Alpha") == pytest.approx(0.75)


def test_a_reflection_by_fresnel_lies_on_what_is_matt() -> None:
    node = mixed(
        diffuse(0.1, 0.3, 0.6), glossy(1.0, 1.0, 1.0, roughness=0.1), Node("FRESNEL", {"IOR": 1.6, "Normal": None}, ("Fac",))
    )
    found, warnings = material(node)
    assert found["pbrMetallicRoughness"] == {
        "baseColorFactor": pytest.approx([0.1, 0.3, 0.6, 1.0]),
        "metallicFactor": 0.0,
        "roughnessFactor": 0.1,
    }
    assert found["extensions"]["KHR_materials_ior"]["ior"] == pytest.approx(1.6)
    assert warnings == []


def test_glass_that_casts_no_shadow_is_glass() -> None:
    """The trick by which shadow rays pass glass: a mix by what kind of ray it is."""
    glass = Node("BSDF_GLASS", {"Color": (1.0, 1.0, 1.0, 1.0), "Roughness": 0.0, "IOR": 1.5, "Normal": None}, OUT)
    ray = Node("LIGHT_PATH", {}, ("Is Camera Ray", "Is Shadow Ray"))
    mix = mixed(glass, clear())
    found, warnings = material(linked(ray, mix, 0, "Is Shadow Ray"))
    assert found["extensions"]["KHR_materials_transmission"]["transmissionFactor"] == 1.0
    assert "alphaMode" not in found
    assert warnings == ["Material m: of shaders that are for different rays the camera's is shown to all."]


def test_light_through_a_leaf() -> None:
    leaf = Node("BSDF_TRANSLUCENT", {"Color": (0.4, 0.7, 0.1, 1.0), "Normal": None}, OUT)
    found, _ = material(mixed(diffuse(0.2, 0.5, 0.1), leaf, 0.4))
    assert found["pbrMetallicRoughness"]["baseColorFactor"] == pytest.approx([0.2, 0.5, 0.1, 1.0])
    through = found["extensions"]["KHR_materials_diffuse_transmission"]
    assert through["diffuseTransmissionFactor"] == pytest.approx(0.4)
    assert through["diffuseTransmissionColorFactor"] == pytest.approx([0.4, 0.7, 0.1])


def test_what_shines_and_is_added() -> None:
    add = Node("ADD_SHADER", {"a": None, "b": None}, ("Shader",))
    shining = Node("EMISSION", {"Color": (0.2, 0.4, 1.0, 1.0), "Strength": 3.0}, OUT)
    found, warnings = material(linked(shining, linked(diffuse(0.7, 0.7, 0.7), add, 0), 1))
    assert found["pbrMetallicRoughness"]["baseColorFactor"] == pytest.approx([0.7, 0.7, 0.7, 1.0])
    light = [c * found["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"] for c in found["emissiveFactor"]]
    assert light == pytest.approx([0.6, 1.2, 3.0])
    assert warnings == []
