"""Tests of each material's interior medium, and of the accepted media fields of a scene file."""

from __future__ import annotations

import json

import numpy as np
import pytest

from renderer.arrays import rows
from renderer.arrays.kernel_variant import variant_of
from renderer.errors import SceneError
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Light, Material, Medium, SceneDescription, Sphere
from renderer.scene.material_packing import pack
from renderer.scene.media import list_media

FOG = {"sigma_a": (0.1, 0.1, 0.1), "sigma_s": (1.0, 2.0, 3.0), "g": 0.5}


def listed(*materials: Material, medium: Medium | None = None):
    return list_media(SceneDescription(materials=list(materials), medium=medium))


def test_media_are_listed_once_after_the_world_medium() -> None:
    found = listed(Material(), Material(kind="interface", **FOG), Material(kind="glass"), Material(kind="glass", **FOG))
    assert found.material_medium.tolist() == [-1, 1, 0, 1]
    assert found.medium == pytest.approx(np.array([[0.0] * 8, [0.1, 0.1, 0.1, 1.0, 2.0, 3.0, 0.5, 0.0]]))


def test_world_medium_is_first() -> None:
    found = listed(Material(kind="glass"), medium=Medium(**FOG))
    assert found.medium[0, 3:7].tolist() == [1.0, 2.0, 3.0, 0.5]
    assert found.material_medium.tolist() == [1]
    assert not found.medium[1].any()


def test_absorbing_glass_alone_needs_no_medium() -> None:
    """Glass that only absorbs needs no medium: kernels without media handle absorption."""
    found = listed(Material(kind="glass", sigma_a=(1.0, 1.0, 1.0)), Material(kind="interface"))
    assert not found.medium.any()
    assert found.material_medium.tolist() == [-1, -1]


@pytest.mark.parametrize(
    ("material", "has"),
    [
        (Material(kind="glass", thin=True, **FOG), False),
        (Material(kind="metallic_roughness", **FOG), False),
        (Material(kind="metallic_roughness", transmission=0.5, **FOG), True),
        (Material(kind="metallic_roughness", diffuse_transmission=0.5, **FOG), True),
        (Material(kind="metallic_roughness", diffuse_transmission=0.5), False),
    ],
)
def test_materials_with_an_interior(material: Material, has: bool) -> None:
    found = listed(Material(kind="interface", sigma_s=(9.0, 9.0, 9.0)), material)
    assert (found.material_medium[1] >= 0) == has


def test_absorption_from_sigma_or_attenuation() -> None:
    glass = Material(kind="glass", sigma_a=(0.1, 0.2, 0.3), attenuation_color=(0.5, 0.5, 0.5), attenuation_distance=2.0)
    packed = pack(SceneDescription(materials=[glass]))
    expected = np.array((0.1, 0.2, 0.3)) + np.log(2) / 2
    assert packed.material[0, rows.ABSORPTION : rows.ABSORPTION + 3] == pytest.approx(expected)
    assert packed.material_flags[0] & rows.ABSORBING


def test_too_many_media_are_an_error() -> None:
    fogs = [Material(kind="interface", sigma_s=(1.0, 1.0, 1.0 + i)) for i in range(rows.MOST_MEDIA)]
    with pytest.raises(SceneError, match="1023 are supported"):
        listed(*fogs)


@pytest.mark.parametrize("wrong", [{"sigma_a": (-1.0, 0.0, 0.0)}, {"sigma_s": (np.nan, 0.0, 0.0)}, {"g": 1.0}])
def test_invalid_medium_is_an_error(wrong) -> None:
    with pytest.raises(SceneError, match="world's medium"):
        listed(medium=Medium(**wrong))
    with pytest.raises(SceneError, match="it must be"):
        pack(SceneDescription(materials=[Material(kind="interface", **wrong)]))


KERNEL_VARIANTS = {
    "an interface of nothing": ({"material": Material(kind="interface")}, "full"),
    "glass that absorbs": ({"material": Material(kind="glass", sigma_a=(1.0, 1.0, 1.0))}, "full"),
    "an interface that absorbs": ({"material": Material(kind="interface", sigma_a=(1.0, 1.0, 1.0))}, "media"),
    "milk": ({"material": Material(kind="glass", **FOG)}, "media"),
    "wax": ({"material": Material(subsurface=0.1)}, "media"),
    "a world": ({"material": Material(), "medium": Medium(sigma_a=(0.1, 0.0, 0.0))}, "media"),
    "a world of nothing": ({"material": Material(), "medium": Medium()}, "plain"),
}


@pytest.mark.parametrize("name", KERNEL_VARIANTS)
def test_media_select_the_media_variant(name: str) -> None:
    more, variant = KERNEL_VARIANTS[name]
    scene = SceneDescription(
        materials=[more["material"]], medium=more.get("medium"), spheres=[Sphere((0, 0, 0), 1.0)], environment=Environment()
    )
    compiled = compile_scene(scene)
    assert variant_of(compiled) == variant
    assert variant_of(compiled, camera_moves=True) == ("moving-media" if variant == "media" else "moving")


def test_scene_file_media(scene) -> None:
    document = {
        "medium": {"sigma_s": 0.5, "sigma_a": [0.1, 0.2, 0.3], "g": -0.2},
        "materials": {"fog": {"kind": "interface", "sigma_s": [1, 2, 3], "g": 0.4}},
        "shapes": [{"type": "cube", "material": "fog"}],
    }
    found = scene("s.yaml", json.dumps(document))
    assert found.medium == Medium((0.1, 0.2, 0.3), (0.5, 0.5, 0.5), -0.2)
    (fog,) = found.materials
    assert (fog.kind, fog.sigma_s, fog.g) == ("interface", (1, 2, 3), 0.4)


@pytest.mark.parametrize("field", ["color", "emission", "opacity", "texture", "roughness", "subsurface"])
def test_interface_rejects_surface_fields(scene, field: str) -> None:
    document = {
        "materials": {"fog": {"kind": "interface", field: 1 if field != "texture" else "t"}},
        "shapes": [{"type": "cube"}],
    }
    with pytest.raises(SceneError, match=f"{field}.*has no meaning for the kind interface"):
        scene("s.yaml", json.dumps(document))


@pytest.mark.parametrize("wrong", [{"g": 1}, {"sigma_s": -1}, {"sigma_s": [1, 2]}, {"density": 1}])
def test_medium_errors_name_the_line(scene, wrong) -> None:
    with pytest.raises(SceneError, match=r"s\.yaml, line 1"):
        scene("s.yaml", json.dumps({"medium": wrong, "shapes": [{"type": "quad"}]}))


LAMP = Material(base_color=(0.0, 0.0, 0.0), emission=(9.0, 9.0, 9.0))
THIN, WHITE = Medium(sigma_s=(0.1, 0.1, 0.1)), Material()
LAMPS = {
    "a point and a ball": (THIN, 0.1, [Light("point", (5.0, 5.0, 5.0), (0.0, 2.0, 0.0))], 2),
    "a sun": (THIN, 0.1, [Light("directional", (5.0, 5.0, 5.0), direction=(0.0, -1.0, 0.0))], 1),
    "a large ball": (THIN, 4.0, [], 0),
    "a medium that absorbs": (Medium(sigma_a=(0.1, 0.1, 0.1)), 0.1, [], 0),
    "no medium": (None, 0.1, [], 0),
}


@pytest.mark.parametrize("name", LAMPS)
def test_small_lamps_are_listed_where_media_scatter(name: str) -> None:
    medium, radius, lights, expected = LAMPS[name]
    spheres = [Sphere((3.0, 0.0, 0.0), radius, 0), Sphere((-9.0, 0.0, 0.0), 2.0, 1)]
    compiled = compile_scene(SceneDescription(materials=[LAMP, WHITE], medium=medium, spheres=spheres, lights=lights))
    assert len(compiled.pivot) == expected
    assert (variant_of(compiled) == "lit-media") == (expected > 0)
    if expected:
        assert compiled.pivot[-1, 4] == 1
        assert (np.diff(compiled.pivot[:, 4]) > 0).all()
