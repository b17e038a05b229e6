"""Tests that Blender's lights, converted to a scene file, have the same flux."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from blender.rayfarm_addon.scene.lights import add_light, constant_emission_factor
from blender.rayfarm_addon.scene.model import Scene
from blender.rayfarm_addon.scene.temperature import blackbody
from tests.blender.fake_nodes import Node, linked


def lamp(kind: str, place: np.ndarray | None = None, seen: dict[str, bool] | None = None, **more: Any) -> Scene:
    told = {
        "type": kind,
        "color": (1.0, 1.0, 1.0),
        "energy": 10.0,
        "use_nodes": False,
        "shadow_soft_size": 0.5,
        "spot_blend": 0.2,
    }
    told |= {"spot_size": 1.0, "angle": 0.2, "shape": "RECTANGLE", "size": 2.0, "size_y": 0.5, "spread": math.pi}
    thing = SimpleNamespace(data=SimpleNamespace(**{**told, **more}), **(seen or {}))
    scene = Scene()
    add_light(scene, thing, "lamp", np.eye(4) if place is None else place)
    return scene


@pytest.mark.parametrize("is_soft", [True, False])
def test_point_light_becomes_sphere_or_facing_disk(is_soft: bool) -> None:
    scene = lamp("POINT", use_soft_falloff=is_soft)
    made = scene.lamp_materials["lamp"]
    assert made.get("facing", False) == is_soft
    assert made["emission"][0] * math.pi * 0.5**2 == pytest.approx(10 / (4 * math.pi))  # intensity of the source
    (light,) = lamp("SPOT", use_soft_falloff=is_soft).lights
    assert light.get("facing", False) == is_soft


def test_unnormalized_power_is_per_square_metre() -> None:
    """If a light's "Normalize" option is off, its power is per square metre of the light."""
    area = lamp("AREA", normalize=False).lamp_materials["lamp"]["emission"][0]
    assert area == pytest.approx(10 / math.pi)
    point = lamp("POINT", normalize=False).lamp_materials["lamp"]["emission"][0]
    assert point == pytest.approx(10 / math.pi)
    (sun,) = lamp("SUN", normalize=False).lights
    assert sun["intensity"][0] == pytest.approx(10 * math.pi * math.sin(0.1) ** 2)
    wide = np.diag([3.0, 2.0, 1.0, 1.0])
    whole = lamp("AREA", wide).lamp_materials["lamp"]["emission"][0]
    assert whole == pytest.approx(10 / (math.pi * 6.0 * 1.0))


def test_sun_visibility_matches_blender() -> None:
    assert lamp("SUN").lights[0]["seen"] == "always"
    assert lamp("SUN", seen={"visible_camera": False}).lights[0]["seen"] == "mirrored"
    assert "seen" not in lamp("SUN", angle=0.0).lights[0]


def test_unsupported_lamp_settings_are_named() -> None:
    assert lamp("AREA", use_shadow=False).warnings == ["Lamp lamp: casts shadows here, though not in Blender."]


def test_lamps_illuminate_the_lobes_that_see_them() -> None:
    seen = {"visible_glossy": False, "visible_volume_scatter": False}
    assert lamp("AREA", seen=seen).lamps[0]["visible_to"] == ["camera", "diffuse", "transmission"]
    assert lamp("SUN", seen=seen).lights[0]["visible_to"] == ["diffuse", "transmission"]
    assert "visible_to" not in lamp("AREA").lamps[0]


def test_constant_lamp_nodes_are_evaluated() -> None:
    """Nodes connected to a lamp's colour and strength are evaluated: a black body, and a product.

    Without a Light Falloff node, the falloff is quadratic.
    """
    body = Node("BLACKBODY", {"Temperature": 3000.0})
    falls = Node("LIGHT_FALLOFF", {"Strength": 2.0, "Smooth": 0.0}, ("Quadratic", "Linear"))
    for output, wanted in (("Quadratic", [2 * c for c in blackbody(3000.0)]), ("Linear", None)):
        shines = Node("EMISSION", {"Color": (1.0, 1.0, 1.0, 1.0), "Strength": 1.0}, ("Emission",))
        linked(falls, linked(body, shines, "Color"), "Strength", output)
        end = linked(shines, Node("OUTPUT_LIGHT", {"Surface": None}, ()), "Surface")
        found = constant_emission_factor(SimpleNamespace(get_output_node=lambda engine, end=end: end))
        assert found == (None if wanted is None else pytest.approx(wanted, rel=1e-6))


def test_lamps_have_the_temperature_of_their_setting_or_node() -> None:
    warm = {"use_temperature": True, "temperature": 2700.0, "temperature_color": tuple(blackbody(2700.0))}
    assert lamp("AREA", **warm).lamp_materials["lamp"]["emission_temperature"] == 2700.0
    assert lamp("SUN", **warm).lights[0]["temperature"] == 2700.0
    assert "temperature" not in lamp("SUN", **warm, color=(1.0, 0.5, 0.5)).lights[0]
    body, shines = Node("BLACKBODY", {"Temperature": 3000.0}), Node("EMISSION", {"Color": None, "Strength": 1.0}, ("Emission",))
    end = linked(linked(body, shines, "Color"), Node("OUTPUT_LIGHT", {"Surface": None}, ()), "Surface")
    tree = SimpleNamespace(get_output_node=lambda engine: end)
    assert lamp("SPOT", use_nodes=True, node_tree=tree).lights[0]["temperature"] == 3000.0
    assert "temperature" not in lamp("SPOT", use_nodes=True, node_tree=tree, **warm).lights[0]


def test_blackbody_color_matches_blender() -> None:
    assert blackbody(3000) == pytest.approx([1.7708, 0.8443, 0.2722])
    assert blackbody(100) == blackbody(800)
    assert blackbody(5600)[0] == pytest.approx(1.133, abs=0.005)
