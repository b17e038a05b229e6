"""Tests that vertices have Blender's positions, in Alembic files and in meshes of .blend files that modifiers deform.

Needs a Python with bpy, which `python3 farm.py peers` installs.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.scene.animation import Moment
from renderer.scene.load import Shot, read
from tests.peers.blender import TO_Y_UP, written_by
from tests.peers.values import NEAR, meshes_apart

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Yields the folder written by alembic_kit.py; meanwhile, our reader opens .blend files with the Blender that wrote them."""
    with written_by("alembic_kit.py", tmp_path_factory.mktemp("alembic")) as folder:
        yield folder


@pytest.mark.parametrize("name", ["shot.abc", "shot.blend"])
def test_what_moves_and_bends_is_where_blender_has_it(name: str, made: Path) -> None:
    told = json.loads((made / "told.json").read_text())[name]
    shot = Shot(made, name)
    sheets = []
    for frame, said in told.items():
        found = shot.scene_at(Moment(int(frame)))
        assert list(meshes_apart(found, said)) == [], f"frame {frame}"
        eye = TO_Y_UP @ np.array(said["eye"])[:3, 3]
        np.testing.assert_allclose(found.cameras[0].view.eye, eye, atol=NEAR * 10)
        assert not [words for words in found.warnings if "stands still" in words]
        sheets.append(next(np.array(vertices) for mesh, _, vertices in said["meshes"] if mesh.startswith("sheet")))
        assert {mesh.deforms for mesh in found.meshes} == {True, False}
    assert np.abs(sheets[0] - sheets[1]).max() > 0.1


def test_a_damaged_file_is_refused_with_a_sentence(made: Path, tmp_path: Path) -> None:
    whole = (made / "shot.abc").read_bytes()
    for name, data in (("none.abc", b"Ogawa"), ("half.abc", whole[: len(whole) // 2]), ("text.abc", b"hello " * 100)):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(SceneError, match=rf"{name}: "):
            read(tmp_path, name)
