"""Side by side with Blender: a shot exported by it stands at each frame where Blender says it does.

Needs a Python with bpy: `python3 farm.py peers` makes one.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from renderer.scene.animation import Moment
from renderer.scene.load import Shot
from tests.peers.blender import python_with_bpy
from tests.renderer.scene.builders import world

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]

TO_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
NEAR = 1e-4


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> tuple[Shot, dict[str, Any]]:
    """The shot as we open it, and what Blender says of each of its frames."""
    python = python_with_bpy()
    if python is None:
        pytest.skip("no Python with bpy is here; `python3 farm.py peers` makes one")
    folder = tmp_path_factory.mktemp("shot")
    script = Path(__file__).with_name("blender_shot.py")
    done = subprocess.run(
        [python, script, folder / "shot.glb", folder / "shot.json"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return Shot(folder, "shot.glb"), json.loads((folder / "shot.json").read_text())


@pytest.mark.parametrize("frame", [0, 7, 13, 24, 40])
def test_vertices_cameras_and_lights_are_where_blender_has_them(shot: tuple[Shot, dict[str, Any]], frame: int) -> None:
    ours, theirs = shot[0].at(Moment(frame)), shot[1][str(frame)]
    numbers = {instance.name: i for i, instance in enumerate(ours.instances)}
    assert set(numbers) == set(theirs["vertices"]) == {"mast", "yard", "flag", "tube"}
    for name, vertices in theirs["vertices"].items():
        expected = np.array(vertices) @ TO_Y_UP.T
        found = world(ours, numbers[name]).reshape(-1, 3)
        apart = np.linalg.norm(found[:, None] - expected[None], axis=2)
        assert apart.min(axis=1).max() < NEAR, f"a vertex of {name} is where Blender has none"
        assert apart.min(axis=0).max() < NEAR, f"a vertex of {name} is missing"
    (camera,) = ours.cameras
    matrix = np.array(theirs["matrices"]["camera"])
    np.testing.assert_allclose(camera.view.eye, TO_Y_UP @ matrix[:3, 3], atol=NEAR)
    forward = np.subtract(camera.view.target, camera.view.eye)
    np.testing.assert_allclose(forward / np.linalg.norm(forward), TO_Y_UP @ -matrix[:3, 2], atol=NEAR)
    (lamp,) = ours.lights
    matrix = np.array(theirs["matrices"]["lamp"])
    np.testing.assert_allclose(lamp.position, TO_Y_UP @ matrix[:3, 3], atol=NEAR)
    np.testing.assert_allclose(lamp.direction, TO_Y_UP @ -matrix[:3, 2], atol=NEAR)


@pytest.mark.parametrize("frame", [0, 7, 13, 24, 40])
def test_what_blender_writes_as_pointers_is_what_it_shows(shot: tuple[Shot, dict[str, Any]], frame: int) -> None:
    ours, theirs = shot[0].at(Moment(frame)), shot[1][str(frame)]["numbers"]
    assert not [warning for warning in ours.warnings if "animated" in warning]
    paint = next(material for material in ours.materials if material.name == "paint")
    np.testing.assert_allclose(paint.base_color, theirs["color"], rtol=1e-5)
    assert paint.roughness == pytest.approx(theirs["roughness"], rel=1e-5)
    np.testing.assert_allclose(paint.emission, theirs["emission"] * np.array([1, 0.5, 0.25]), rtol=1e-5)
    np.testing.assert_allclose(ours.lights[0].intensity, theirs["energy"] * np.array(theirs["light"]), rtol=1e-5)
    assert ours.cameras[0].view.fov == pytest.approx(theirs["fov"], rel=1e-5)


def test_it_moves(shot: tuple[Shot, dict[str, Any]]) -> None:
    """So that what is compared is no shot that stands still."""
    places = [shot[1][str(frame)]["vertices"] for frame in (0, 13, 40)]
    for name in ("mast", "yard", "flag", "tube"):
        for a, b in ((0, 1), (1, 2)):
            assert np.abs(np.array(places[a][name]) - np.array(places[b][name])).max() > 0.1
