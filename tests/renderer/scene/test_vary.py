"""Tests of varied scenes: what a variation changes, what it leaves alone, and that frames do not depend on earlier ones."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rayfarm.stage import OpenScene
from renderer.arrays.scene import flat
from renderer.errors import RayfarmError
from renderer.scene.animation import Moment
from renderer.scene.description import SceneDescription
from renderer.scene.load import Shot
from renderer.variation import Variation

SCENE: dict[str, Any] = {
    "environment": {"color": [0.5, 0.6, 0.7]},
    "materials": {"blue": {"color": [0.1, 0.2, 0.9]}, "shiny": {"color": 0.5, "metallic": 1.0, "roughness": 0.3}},
    "lights": [{"type": "point", "name": "bulb", "position": [0, 2, 0], "intensity": [2, 3, 4]}],
    "shapes": [
        {
            "type": "quad",
            "name": "floor",
            "material": "blue",
            "transform": [{"rotate": {"axis": "x", "degrees": -90}}, {"scale": 3}],
        },
        {"type": "cube", "name": "crate", "material": "shiny", "transform": [{"scale": 0.2}, {"translate": [1, 0.2, 0]}]},
        {"type": "sphere", "name": "ball", "material": "blue", "center": [-1, 0.3, 0], "radius": 0.3},
    ],
}


def shot(folder: Path, vary: dict[str, Any]) -> Shot:
    (folder / "scene.yaml").write_text(json.dumps(SCENE))
    return Shot(folder, "scene.yaml", variation=Variation.parse(vary))


def at(folder: Path, vary: dict[str, Any], frame: int = 0) -> SceneDescription:
    return shot(folder, vary).scene_at(Moment(frame))


def place(found: SceneDescription, name: str) -> np.ndarray:
    return next(each.transform for each in found.instances if each.name == name)


def test_objects_turn_and_scale_about_their_centre_and_move(tmp_path: Path) -> None:
    still = at(tmp_path, {"lights": {"*": {"power": 1}}})
    values = {"turn": 90, "scale": 2, "move": {"choice": [[0.5, 0, 0]]}}
    found = at(tmp_path, {"objects": {"crate": values, "ball": {"move": [0, 1, 0], "scale": 0.5}}})
    corner = np.array([1.0, 1.0, 1.0, 1.0])  # of the cube's mesh: at (1.2, 0.4, 0.2)
    np.testing.assert_allclose(place(still, "crate") @ corner, [1.2, 0.4, 0.2, 1], atol=1e-12)
    np.testing.assert_allclose(place(found, "crate") @ corner, [1.5 + 0.4, 0.2 + 0.4, -0.4, 1], atol=1e-12)
    np.testing.assert_array_equal(place(found, "floor"), place(still, "floor"))
    assert found.spheres[0].center == (-1.0, 1.3, 0.0) and found.spheres[0].radius == pytest.approx(0.15)
    assert found.variation["objects"]["crate"] == {"turn": 90.0, "scale": 2.0, "move": (0.5, 0.0, 0.0)}
    tumbled = place(at(tmp_path, {"objects": {"crate": {"tumble": True}}}), "crate")
    linear = tumbled[:3, :3] / 0.2
    np.testing.assert_allclose(linear @ linear.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(tumbled @ [0, 0, 0, 1], [1, 0.2, 0, 1], atol=1e-12)
    assert np.linalg.det(linear) > 0 and not np.allclose(linear, np.eye(3), atol=0.01)


def test_materials_lights_and_environment(tmp_path: Path) -> None:
    vary = {
        "objects": {"ball": {"material": "shiny"}},
        "materials": {
            "shiny": {"roughness": {"uniform": [0.5, 0.9]}, "color": 0.25},
            "blue": {"emission": 2, "power": [1, 2, 3]},
        },
        "lights": {"bulb": {"power": 2, "color": [1, 0.5, 0], "move": [0, 0, 1]}},
        "environment": {"strength": 3, "rotation": {"uniform": [0, 360]}, "color": [1, 1, 0]},
    }
    found = at(tmp_path, vary)
    named = {each.name: each for each in found.materials}
    assert 0.5 <= (named["shiny"].roughness or 0) < 0.9 and named["shiny"].base_color == (0.25, 0.25, 0.25)
    assert named["shiny"].roughness == found.variation["materials"]["shiny"]["roughness"]
    assert named["blue"].emission == (2.0, 4.0, 6.0)
    assert found.materials[found.spheres[0].material].name == "shiny"
    assert found.lights[0].intensity == (4.0, 3.0, 0.0) and found.lights[0].position == (0.0, 2.0, 1.0)
    assert found.environment is not None and found.environment.color == (0.5, 0.6, 0.0) and found.environment.strength == 3
    assert found.environment.rotation == found.variation["environment"]["rotation"]
    sky = at(tmp_path, {"environment": {"light": {"choice": ["sky:30,20"]}}}).environment
    assert sky is not None and sky.sky is not None and sky.sky.sun_elevation == 30


def test_a_frame_does_not_depend_on_earlier_ones_and_every_holds_its_variation(tmp_path: Path) -> None:
    vary = {
        "every": 2,
        "objects": {"crate": {"move": {"uniform": [[-1, 0, -1], [1, 0, 1]]}, "material": {"choice": ["blue", "shiny"]}}},
        "materials": {"blue": {"color": {"uniform": [0, 1]}}},
        "environment": {"light": {"choice": ["sky:30,20", "sky:50,90"]}, "rotation": {"uniform": [0, 360]}},
    }
    for asked in (
        vary,
        {"objects": {"crate": vary["objects"]["crate"] | {"material": "shiny"}, "ball": {"scale": {"uniform": [1, 2]}}}},
    ):
        stage = OpenScene(shot(tmp_path, asked))
        found = []
        for frame in range(3):
            compiled, summary = stage.scene_at(Moment(frame))
            fresh, alone = OpenScene(shot(tmp_path, asked)).scene_at(Moment(frame))
            assert summary["variation"] == alone["variation"]
            for name, array in flat(fresh).items():
                np.testing.assert_array_equal(flat(compiled)[name], array, err_msg=f"{name} of frame {frame}")
            found.append(summary["variation"])
        assert len({json.dumps(each) for each in found}) == (2 if "every" in asked else 3)
    between = shot(tmp_path, vary).between_frames(Moment(1.0))
    assert between.keys == 0 and between.variation == shot(tmp_path, vary).scene_at(Moment(0)).variation


@pytest.mark.parametrize(
    ("vary", "message"),
    [
        ({"objects": {"cup*": {"scale": 2}}}, r"vary.objects: 'cup\*' is none of the scene's; it has floor, crate, ball"),
        (
            {"objects": {"crate": {"material": "gold"}}},
            "vary.objects.crate.material is 'gold'; the scene's materials are blue, shiny",
        ),
        ({"objects": {"crate": {"scale": 0}}}, "vary.objects: scale is 0; it must be from 1e-06"),
        ({"materials": {"wood": {"color": 1}}}, "vary.materials: 'wood' is none of the scene's"),
        (
            {"materials": {"blue": {"roughness": 1}}},
            "vary.materials.blue has 'roughness'; a material of kind diffuse has kind",
        ),
        ({"materials": {"shiny": {"roughness": 7}}}, "vary.materials.shiny.roughness is 7; it must be from 0 to 1"),
        ({"materials": {"shiny": {"roughness": "rough"}}}, "vary.materials.shiny.roughness has another kind of value"),
        ({"lights": {"lamp": {"power": 1}}}, "vary.lights: 'lamp' is none of the scene's; it has bulb"),
        ({"lights": {"bulb": {"power": -1}}}, "vary.lights: power is -1; it must be from 0"),
        ({"environment": {"light": "hall.hdr"}}, "hall.hdr: the environment is not among the scene's files"),
    ],
)
def test_what_does_not_fit_the_scene_is_one_sentence(tmp_path: Path, vary: dict[str, Any], message: str) -> None:
    with pytest.raises(RayfarmError, match=message):
        at(tmp_path, vary)
