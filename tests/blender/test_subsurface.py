"""Tests of the exported interior of materials: volumes by Cycles' formulas, and subsurface scattering from its radii."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from blender.rayfarm_addon.scene import subsurface
from blender.rayfarm_addon.scene.fibres import HAIR
from blender.rayfarm_addon.scene.model import Scene
from blender.rayfarm_addon.scene.nodes import source_of
from blender.rayfarm_addon.scene.surfaces import Surfaces
from blender.rayfarm_addon.scene.volumes import Medium, medium_of
from blender.rayfarm_addon.scene.world import read_world
from tests.blender.fake_nodes import Node, at, linked

VOLUME, BSDF = ("Volume",), ("BSDF",)
MEDIUM, SUBSURFACE = "RAYFARM_materials_medium", "RAYFARM_materials_subsurface"


def scatter(density: float = 2.0, g: float = 0.25, phase: str = "HENYEY_GREENSTEIN", color: Any = (0.8, 0.4, 0.2, 1.0)) -> Node:
    return Node("VOLUME_SCATTER", {"Color": color, "Density": density, "Anisotropy": g}, VOLUME, phase=phase)


def absorption(density: float = 3.0) -> Node:
    return Node("VOLUME_ABSORPTION", {"Color": (0.9, 0.5, 0.0, 1.0), "Density": density}, VOLUME)


def principled(**more: Any) -> Node:
    said = {"Color": (0.5, 0.25, 1.0, 1.0), "Density": 4.0, "Anisotropy": -0.5, "Absorption Color": (0.25, 0.0, 0.0, 1.0)}
    said |= {"Emission Strength": 0.0, "Blackbody Intensity": 0.0, **more}
    return Node("PRINCIPLED_VOLUME", said, VOLUME)


def read(node: Node) -> tuple[Medium | None, list[str]]:
    told: list[str] = []
    return medium_of(source_of(at(node))[0], told.append), told


def close(found: Medium | None, sigma_a: Any, sigma_s: Any, g: float) -> None:
    assert found is not None
    assert (*found.sigma_a, *found.sigma_s, found.g) == pytest.approx((*sigma_a, *sigma_s, g))


@pytest.mark.parametrize(
    ("node", "sigma_a", "sigma_s", "g"),
    [
        (scatter(), (0, 0, 0), (1.6, 0.8, 0.4), 0.25),
        (scatter(-1.0), (0, 0, 0), (0, 0, 0), 0.25),
        (absorption(), (0.3, 1.5, 3), (0, 0, 0), 0),
        # In Cycles a strongly scattering colour absorbs less, and absorption uses the square root of its colour.
        (principled(), (4 * 0.5 * 0.5, 4 * 0.75, 0), (2, 1, 4), -0.5),
        (
            Node(
                "VOLUME_COEFFICIENTS",
                {"Absorption Coefficients": (1.0, 2.0, 3.0), "Scatter Coefficients": (4.0, 5.0, 6.0), "Anisotropy": 0.5},
                VOLUME,
            ),
            (1, 2, 3),
            (4, 5, 6),
            0.5,
        ),
    ],
)
def test_volume_coefficients(node: Node, sigma_a: Any, sigma_s: Any, g: float) -> None:
    found, told = read(node)
    close(found, sigma_a, sigma_s, g)
    assert told == []


def test_added_and_mixed_volumes() -> None:
    both = linked(absorption(), linked(scatter(), Node("ADD_SHADER", {"a": None, "b": None}, ("Shader",)), 0), 1)
    close(read(both)[0], (0.3, 1.5, 3), (1.6, 0.8, 0.4), 0.25)
    half = Node("MIX_SHADER", {"Fac": 0.25, "a": None, "b": None}, ("Shader",))
    found, told = read(linked(scatter(g=0.8), linked(scatter(), half, 1), 2))
    close(found, (0, 0, 0), (1.6, 0.8, 0.4), 0.75 * 0.25 + 0.25 * 0.8)
    assert told == []
    thinned = Node("MIX_SHADER", {"Fac": 0.25, "a": None, "b": None}, ("Shader",))
    close(read(linked(scatter(), thinned, 2))[0], (0, 0, 0), (0.4, 0.2, 0.1), 0.25)


@pytest.mark.parametrize(
    ("node", "sentence"),
    [
        (linked(Node("TEX_NOISE", {}, ("Fac",)), scatter(), "Density"), "input Density of its volume varies in Blender"),
        (scatter(phase="RAYLEIGH"), "not Rayleigh"),
        (principled(**{"Emission Strength": 1.0}), "the emission of its volume is left out"),
        (Node("EMISSION", {"Color": (1.0, 1.0, 1.0, 1.0), "Strength": 1.0}, ("Emission",)), "Emission is left out of its volume"),
        (Node("SCRIPT", {}, VOLUME), "Script is left out of its volume"),
    ],
)
def test_unsupported_volume_settings_are_named(node: Node, sentence: str) -> None:
    assert any(sentence in each for each in read(node)[1])


def material(surface: Node | None = None, volume: Node | None = None) -> tuple[dict[str, Any], list[str]]:
    """Returns the glTF JSON and the messages that the add-on writes for a material."""
    output = Node("OUTPUT_MATERIAL", {"Surface": None, "Volume": None, "Displacement": None}, ())
    for node, name in ((surface, "Surface"), (volume, "Volume")):
        if node is not None:
            linked(node, output, name)
    tree = SimpleNamespace(get_output_node=lambda engine: output, nodes=[])
    source = SimpleNamespace(name="m", name_full="m", pass_index=0, use_nodes=True, node_tree=tree)
    scene = Scene()
    return scene.materials[Surfaces(scene, set()).add(source)].gltf, scene.warnings


def glass(weight: float = 1.0) -> Node:
    return Node("BSDF_PRINCIPLED", {"Base Color": (1.0, 1.0, 1.0, 1.0), "Transmission Weight": weight, "IOR": 1.4}, BSDF)


def clear() -> Node:
    return Node("BSDF_TRANSPARENT", {"Color": (1.0, 1.0, 1.0, 1.0)}, BSDF)


@pytest.mark.parametrize(("surface", "is_bare"), [(None, True), (clear(), True), (glass(), False)])
def test_volume_fills_transmissive_surfaces(surface: Node | None, is_bare: bool) -> None:
    said, warnings = material(surface, scatter())
    assert said["extensions"][MEDIUM] == {
        "sigmaA": [0, 0, 0],
        "sigmaS": pytest.approx([1.6, 0.8, 0.4]),
        "g": 0.25,
        "isInterface": is_bare,
    }
    assert warnings == []


def test_volume_in_opaque_surface_causes_a_warning() -> None:
    said, warnings = material(glass(0.0), scatter())
    assert MEDIUM not in said["extensions"]
    assert warnings == ["Material m: its volume is left out, since its surface is opaque."]
    said, warnings = material(None, Node("SCRIPT", {}, VOLUME))
    assert said["extensions"][MEDIUM]["isInterface"]
    assert warnings == ["Material m: Script is left out of its volume."]


def beneath(weight: float = 0.5, method: str = "RANDOM_WALK", **more: Any) -> Node:
    said = {"Base Color": (0.8, 0.5, 0.2, 1.0), "Subsurface Weight": weight, "Subsurface Radius": (1.0, 0.2, 0.1)}
    said |= {"Subsurface Scale": 0.5, "Subsurface Anisotropy": 0.3, "Subsurface IOR": 1.4, **more}
    return Node("BSDF_PRINCIPLED", said, BSDF, subsurface_method=method)


def test_subsurface_radius_to_mean_free_path() -> None:
    said, warnings = material(beneath())
    found = said["extensions"][SUBSURFACE]
    assert found["subsurfaceRadius"] == pytest.approx([(1 - 0.3) * c * 0.5 / (4 * math.pi) for c in (1.0, 0.2, 0.1)])
    assert (found["subsurfaceFactor"], found["subsurfaceAnisotropy"]) == (0.5, 0.3)
    assert warnings == []
    assert SUBSURFACE not in material(beneath(0.0))[0].get("extensions", {})


def test_skin_radius_is_a_diffusion_length() -> None:
    """For the subsurface method Skin, the radius is exported as a diffusion length (Jensen et al. 2001).

    With the exported mean free path and the albedo that follows from it, a half-space has the given colour.
    """
    found = material(beneath(method="RANDOM_WALK_SKIN"))[0]["extensions"][SUBSURFACE]
    inner = -1.44 / 1.4**2 + 0.71 / 1.4 + 0.668 + 0.0636 * 1.4
    for color, radius, path in zip((0.8, 0.5, 0.2), (0.5, 0.1, 0.05), found["subsurfaceRadius"], strict=True):
        albedo = 1 - (path / (1 - 0.3) / radius) ** 2 / 3
        root = math.sqrt(3 * (1 - albedo))
        seen = albedo / 2 * (1 + math.exp(-4 / 3 * (1 + inner) / (1 - inner) * root)) * math.exp(-root)
        assert seen == pytest.approx(color, abs=1e-4)
        assert subsurface.albedo_of(color, 1.4) == pytest.approx(albedo)


def test_subsurface_scattering_node() -> None:
    said = {
        "Color": (0.8, 0.5, 0.2, 1.0),
        "Scale": 0.1,
        "Radius": (1.0, 0.5, 0.25),
        "IOR": 1.4,
        "Anisotropy": 0.0,
        "Normal": None,
    }
    found, warnings = material(Node("SUBSURFACE_SCATTERING", said, ("BSSRDF",), falloff="RANDOM_WALK"))
    assert found["extensions"][SUBSURFACE]["subsurfaceRadius"] == pytest.approx([c / (4 * math.pi) for c in (0.1, 0.05, 0.025)])
    assert found["pbrMetallicRoughness"]["baseColorFactor"][:3] == [0.8, 0.5, 0.2]
    assert found["extensions"]["KHR_materials_specular"]["specularFactor"] == 0.0
    assert warnings == []


def test_hair_has_its_colour() -> None:
    """A hair shader is exported with the colour that hair of its absorption has (Chiang et al. 2016)."""
    said = {"Color": (0.1, 0.1, 0.1, 1.0), "Melanin": 0.0, "Melanin Redness": 0.5, "Tint": (0.6, 0.3, 0.1, 1.0)}
    said |= {"Radial Roughness": 0.3, "Absorption Coefficient": (0.0, 0.0, 0.0)}

    def seen(**changed: Any) -> Any:
        node = Node("BSDF_HAIR_PRINCIPLED", {**said, **changed}, BSDF, parametrization=kind)
        return material(node)[0]["pbrMetallicRoughness"]["baseColorFactor"][:3]

    kind = "MELANIN"
    assert seen() == pytest.approx([0.6, 0.3, 0.1])
    brown = seen(Melanin=0.8, Tint=(1.0, 1.0, 1.0, 1.0))
    assert 0.2 > brown[0] > brown[1] > brown[2] > 0
    kind = "ABSORPTION"
    assert seen() == [1, 1, 1]
    kind = "COLOR"
    assert seen() == [0.1, 0.1, 0.1]


def test_hair_keeps_its_roughness() -> None:
    said = {"Color": (0.1, 0.1, 0.1, 1.0), "Roughness": 0.25, "Radial Roughness": 0.4, "Offset": 0.05, "IOR": 1.45}
    found, warnings = material(Node("BSDF_HAIR_PRINCIPLED", said, BSDF, parametrization="COLOR", model="CHIANG"))
    assert found["extensions"][HAIR] == {"betaM": 0.25, "betaN": 0.4, "tilt": -0.05, "ior": 1.45}
    assert warnings == []
    assert HAIR not in material(beneath(0.0))[0].get("extensions", {})
    said |= {"Aspect Ratio": 0.7, "Reflection": 1.0, "Transmission": 0.5, "Secondary Reflection": 0.0}
    found, warnings = material(Node("BSDF_HAIR_PRINCIPLED", said, BSDF, parametrization="COLOR", model="HUANG"))
    lobes = {"model": "huang", "alpha": 0.25, "aspectRatio": 0.7, "r": 1.0, "tt": 0.5, "trt": 0.0}
    assert found["extensions"][HAIR] == {"betaM": 0.25, "betaN": 0.4, "tilt": -0.05, "ior": 1.45, **lobes}
    assert warnings == []


def test_connected_radius_causes_a_warning() -> None:
    node = linked(Node("TEX_NOISE", {}, ("Color",)), beneath(), "Subsurface Radius")
    said, warnings = material(node)
    assert said["extensions"][SUBSURFACE]["subsurfaceRadius"][0] == pytest.approx((1 - 0.3) * 0.5 / (4 * math.pi))
    assert any("nodes of its subsurface radius are ignored" in each for each in warnings)


def test_world_volume_hides_the_environment() -> None:
    output = Node("OUTPUT_WORLD", {"Surface": None, "Volume": None}, ())
    linked(scatter(0.1), output, "Volume")
    linked(Node("BACKGROUND", {"Color": (1.0, 1.0, 1.0, 1.0), "Strength": 1.0}, ("Background",)), output, "Surface")
    tree = SimpleNamespace(get_output_node=lambda engine: output, nodes=[output])
    scene = Scene()
    found = read_world(scene, SimpleNamespace(use_nodes=True, node_tree=tree, color=(1.0, 1.0, 1.0)))
    assert found.color == [0, 0, 0]
    assert found.medium == {"sigma_a": [0, 0, 0], "sigma_s": pytest.approx([0.08, 0.04, 0.02]), "g": 0.25}
    assert scene.warnings == []
