"""Tests that .blend files with artists' habits have the meshes, sizes and positions of Blender's own dependency graph.

Needs a Python with bpy, which `python3 farm.py peers` installs.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from renderer.scene.animation import Moment
from renderer.scene.description import SceneDescription
from renderer.scene.load import Shot
from tests.peers.blender import TO_Y_UP, written_by
from tests.renderer.scene.builders import world

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]

NEAR = 1e-4
NAMES = (
    *("libraries", "instances", "nodes", "growing", "modifiers", "keys", "rigs", "layers", "textures", "colors", "units"),
    "names",
    "large",
)
# Words of the warnings about what differs from Blender.
SAID = {
    "layers": ("Camera markers of the timeline", "view layer", "scene"),
    "textures": ("Missing images: gone.png",),
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Yields the folder written by blend_habits.py; meanwhile, our reader opens .blend files with the Blender that wrote them."""
    with written_by("blend_habits.py", tmp_path_factory.mktemp("habits")) as folder:
        yield folder


@pytest.mark.parametrize("name", NAMES)
def test_what_is_shown_is_where_blender_has_it(name: str, made: Path) -> None:
    told = json.loads((made / "told.json").read_text())[name]
    shot = Shot(made, f"{name}.blend")
    for frame, expected in told.items():
        found = shot.scene_at(Moment(int(frame)))
        ours = bodies(found)
        assert len(ours) == len(expected), (frame, [each[0] for each in ours], [each[0] for each in expected], found.warnings)
        for what, least, most, count in expected:
            ends = np.array([least, most]) @ TO_Y_UP.T
            ends = np.sort(ends, axis=0)
            near = NEAR * max(1.0, float(np.abs(ends).max()))
            same = [each for each in ours if each[2] == count and np.abs(each[1] - ends).max() < near]
            assert same, (frame, what, ends.tolist(), count, [(n, b.tolist(), c) for n, b, c in ours], found.warnings)
            ours = [each for each in ours if each is not same[0]]
    for words in SAID.get(name, ()):
        assert any(words in sentence for sentence in found.warnings), (words, found.warnings)


def bodies(found: SceneDescription) -> list[tuple[str, Any, int]]:
    """Returns name, bounds (2, 3) and triangle count of each object of the scene."""
    parts: dict[Any, list[Any]] = {}
    for number, instance in enumerate(found.instances):
        mesh = found.meshes[instance.mesh]
        if not found.materials[mesh.material].lamp:
            parts.setdefault(instance.name, []).append(world(found, number).reshape(-1, 3))
    gathered = {name: np.concatenate(each) for name, each in parts.items()}
    return [(name, np.stack([each.min(axis=0), each.max(axis=0)]), len(each) // 3) for name, each in gathered.items()]


def test_colours_of_points_and_corners_are_those_of_blender(made: Path) -> None:
    """Colour attributes per point and per corner, stored as bytes or floats, have Blender's values.

    In the four test meshes, red rises over the mesh, green is 0.25 and blue 0.5.
    """
    found = Shot(made, "colors.blend").scene_at(Moment(1))
    colors = [mesh.colors for mesh in found.meshes if mesh.colors is not None]
    assert len(colors) == 4
    for each in colors:
        red, green, blue = np.asarray(each, float)[:, :3].T
        np.testing.assert_allclose([red.min(), red.max()], [0.1, 0.9], atol=0.01)
        np.testing.assert_allclose(green, 0.25, atol=0.01)
        np.testing.assert_allclose(blue, 0.5, atol=0.01)


def test_pictures_that_came_along_are_there_whatever_their_kind(made: Path) -> None:
    found = Shot(made, "textures.blend").scene_at(Moment(1))
    shown = {material.name: material.base_color_texture for material in found.materials}
    assert shown["packed"] is not None
    assert shown["sequence"] is not None
    assert shown["missing"] is None
    assert any(name.startswith("tiles") and texture is not None for name, texture in shown.items()), (shown, found.warnings)


def test_what_goes_past_the_exporter_has_its_materials_and_uvs(made: Path) -> None:
    """A mesh too large for Blender's exporter keeps its materials and both UV sets.

    One UV set covers the unit square; in the other, all coordinates are the same point.
    """
    found = Shot(made, "large.blend").scene_at(Moment(1))
    parts = [mesh for mesh in found.meshes if len(mesh.triangles) > 1000]
    assert sorted(found.materials[mesh.material].name for mesh in parts) == ["left", "right"]
    for mesh in parts:
        assert mesh.normals is not None
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-4)
        up = mesh.normals[:, 1] > 0.5
        assert up.all()
        assert mesh.uvs is not None
        assert np.ptp(mesh.uvs, axis=0).min() > 0.4
