"""Tests that each shader node of Blender, and each mix of shaders, is exported as a single principled BSDF."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from blender.rayfarm_addon.scene.model import Scene
from blender.rayfarm_addon.scene.nodes import constant_value, source_of
from blender.rayfarm_addon.scene.shader_mix import principled_look
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


def principled_constants(node: Node) -> tuple[Any, list[str]]:
    told: list[str] = []
    look = principled_look(source_of(at(node))[0], told.append)
    assert look is not None
    return lambda name: constant_value(look.input(name)), told


def material(node: Node) -> tuple[dict[str, Any], list[str]]:
    """Returns the glTF JSON and the messages that the add-on writes for a material."""
    output = Node("OUTPUT_MATERIAL", {"Surface": None, "Volume": None, "Displacement": None}, ())
    linked(node, output, "Surface")
    tree = SimpleNamespace(get_output_node=lambda engine: output, nodes=[])
    source = SimpleNamespace(name="m", name_full="m", pass_index=0, use_nodes=True, node_tree=tree)
    scene = Scene()
    return scene.materials[Surfaces(scene, set()).add(source)].gltf, scene.warnings


def test_mix_of_shaders_interpolates_parameters() -> None:
    told, said = principled_constants(mixed(glossy(1.0, 0.0, 0.0, roughness=0.2), glossy(0.0, 0.0, 1.0, roughness=0.6), 0.25))
    assert told("Metallic") == 1.0
    assert told("Roughness") == pytest.approx(0.3)
    assert told("Base Color") == pytest.approx([0.75, 0, 0.25])
    assert said == ["its two mixed roughnesses are replaced by their mean"]


@pytest.mark.parametrize("is_first", [True, False])
def test_mix_of_diffuse_and_metal_keeps_the_reflectance(is_first: bool) -> None:
    matt, metal = diffuse(0.6, 0.0, 0.0), glossy(0.0, 0.9, 0.0, roughness=0.3)
    told, said = principled_constants(mixed(matt, metal, 0.25) if is_first else mixed(metal, matt, 0.75))
    assert told("Roughness") == 0.3
    assert told("Base Color")[:3] == pytest.approx([0.6, 0, 0])
    assert told("Specular Tint")[:3] == pytest.approx([0.0, 0.9, 0.0])
    assert ((told("IOR") - 1) / (told("IOR") + 1)) ** 2 == pytest.approx(0.25)
    assert told("Metallic") is None
    assert said == []


def test_mix_with_transparent_becomes_alpha() -> None:
    for share, node in ((0.3, mixed(clear(), diffuse(0.2, 0.7, 0.2), 0.3)), (0.7, mixed(diffuse(0.2, 0.7, 0.2), clear(), 0.3))):
        told, _ = principled_constants(node)
        assert told("Alpha") == pytest.approx(share)
        assert told("Base Color") == pytest.approx([0.2, 0.7, 0.2])
        found, warnings = material(node)
        assert found["pbrMetallicRoughness"]["baseColorFactor"] == pytest.approx([0.2, 0.7, 0.2, share])
        assert found["alphaMode"] == "BLEND"
        assert warnings == []
    told, _ = principled_constants(mixed(mixed(clear(), diffuse(0.2, 0.7, 0.2), 0.5), diffuse(0.2, 0.7, 0.2), 0.5))
    assert told("Alpha") == pytest.approx(0.75)


def test_fresnel_mix_becomes_specular_over_diffuse() -> None:
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


def test_glass_with_transparent_shadow_rays_is_glass() -> None:
    """A glass shader that is mixed with a transparent one for shadow rays only is exported as plain glass."""
    glass = Node("BSDF_GLASS", {"Color": (1.0, 1.0, 1.0, 1.0), "Roughness": 0.0, "IOR": 1.5, "Normal": None}, OUT)
    ray = Node("LIGHT_PATH", {}, ("Is Camera Ray", "Is Shadow Ray"))
    mix = mixed(glass, clear())
    found, warnings = material(linked(ray, mix, 0, "Is Shadow Ray"))
    assert found["extensions"]["KHR_materials_transmission"]["transmissionFactor"] == 1.0
    assert "alphaMode" not in found
    assert warnings == ["Material m: of shaders mixed by Light Path, all rays see the one for the camera."]


def test_translucent_becomes_diffuse_transmission() -> None:
    leaf = Node("BSDF_TRANSLUCENT", {"Color": (0.4, 0.7, 0.1, 1.0), "Normal": None}, OUT)
    found, _ = material(mixed(diffuse(0.2, 0.5, 0.1), leaf, 0.4))
    assert found["pbrMetallicRoughness"]["baseColorFactor"] == pytest.approx([0.2, 0.5, 0.1, 1.0])
    through = found["extensions"]["KHR_materials_diffuse_transmission"]
    assert through["diffuseTransmissionFactor"] == pytest.approx(0.4)
    assert through["diffuseTransmissionColorFactor"] == pytest.approx([0.4, 0.7, 0.1])


def test_added_emission_shader() -> None:
    add = Node("ADD_SHADER", {"a": None, "b": None}, ("Shader",))
    shining = Node("EMISSION", {"Color": (0.2, 0.4, 1.0, 1.0), "Strength": 3.0}, OUT)
    found, warnings = material(linked(shining, linked(diffuse(0.7, 0.7, 0.7), add, 0), 1))
    assert found["pbrMetallicRoughness"]["baseColorFactor"] == pytest.approx([0.7, 0.7, 0.7, 1.0])
    light = [c * found["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"] for c in found["emissiveFactor"]]
    assert light == pytest.approx([0.6, 1.2, 3.0])
    assert warnings == []


def test_glossy_anisotropy_matches_cycles() -> None:
    """A Glossy node's anisotropy is converted so that the two roughness values equal those of Cycles.

    Cycles' alpha is roughness^2 * (1 - anisotropy) along the tangent and roughness^2 / (1 - anisotropy) across it.
    """
    for strength, turned in ((0.5, 0.35), (-0.5, 0.1)):
        node = Node("BSDF_GLOSSY", {"Color": (1, 1, 1, 1), "Roughness": 0.4, "Anisotropy": strength, "Rotation": 0.1}, OUT)
        told, _ = principled_constants(node)
        assert 1 - 0.9 * told("Anisotropic") == pytest.approx(0.5**2)
        assert told("Anisotropic Rotation") == pytest.approx(turned)


def test_conductor_keeps_reflectance_at_normal_incidence() -> None:
    numbers = {"IOR": (0.2, 0.9, 1.5), "Extinction": (3.9, 2.4, 1.9), "Roughness": 0.2}
    told, said = principled_constants(Node("BSDF_METALLIC", numbers, OUT, fresnel_type="PHYSICAL_CONDUCTOR"))
    wanted = [((n - 1) ** 2 + k * k) / ((n + 1) ** 2 + k * k) for n, k in zip(numbers["IOR"], numbers["Extinction"], strict=True)]
    assert told("Base Color") == pytest.approx(wanted)
    assert said == []


def test_glass_color_is_applied_as_a_root_per_surface() -> None:
    color = {"Base Color": (0.81, 0.64, 0.25, 1.0)}
    for weight, wanted in ((1.0, [0.9, 0.8, 0.5]), (0.0, [0.81, 0.64, 0.25])):
        told, said = principled_constants(Node("BSDF_PRINCIPLED", {**color, "Transmission Weight": weight}, OUT))
        assert told("Base Color") == pytest.approx(wanted)
        assert said == []
    _, said = principled_constants(Node("BSDF_PRINCIPLED", {**color, "Transmission Weight": 0.5}, OUT))
    assert said == ["transmitted light is tinted by its base color, darker than in Cycles"]


def test_tinted_transparent_shader_becomes_a_pane() -> None:
    told, said = principled_constants(Node("BSDF_TRANSPARENT", {"Color": (0.8, 0.5, 0.3, 1.0)}, OUT))
    assert (told("Transmission Weight"), told("IOR"), told("Roughness")) == (1.0, 1.0, 0.0)
    assert told("Base Color") == [0.8, 0.5, 0.3]
    assert said == []


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"Coat Weight": 1.0, "Coat IOR": 2.0}, "its coat has an index of refraction of 1.5"),
        ({"Sheen Weight": 0.5}, "its sheen follows glTF, which is brighter at grazing angles than Cycles"),
        ({"Metallic": 1.0, "Specular Tint": (0.5, 1, 1, 1)}, "the edge tint of its metal (specular tint) is ignored"),
        ({"IOR": 0.8}, "its index of refraction is below 1; 1 is used"),
        ({"Base Color": (2.0, 1, 1, 1)}, "its base color is clipped at 1"),
    ],
)
def test_differences_from_cycles_cause_warnings(values: dict[str, Any], sentence: str) -> None:
    assert principled_constants(Node("BSDF_PRINCIPLED", values, OUT))[1] == [sentence]
