"""Tests of editing a GLB file: existing content is preserved, and added content can be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from renderer.blender.inside.glb import Glb
from renderer.blender.inside.large import restore_large_meshes
from renderer.scene.load import read
from tests.renderer.scene.builders import Gltf, world

SQUARE = np.array([(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0)], np.float32)


class Meant:
    """A substitute for a mesh as the add-on exports it: with Blender's axes, and with one part per material."""

    positions = SQUARE
    normals = np.tile(np.float32((0, 0, 1)), (4, 1))
    uvs = (SQUARE[:, :2],)
    fibres = np.tile(np.float32((0, 0, 1, 0.5)), (4, 1))
    parts = ((0, np.array([0, 1, 2, 0, 2, 3], np.uint32)),)


def test_stand_in_is_replaced_by_the_real_mesh(tmp_path: Path) -> None:
    g = Gltf()
    g.mesh()
    path = tmp_path / "a.glb"
    path.write_bytes(g.glb())
    before = world(read(tmp_path, "a.glb"))
    glb = Glb(path)
    glb.document["meshes"][0]["name"] = "large"
    glb.write(path)
    np.testing.assert_array_equal(world(read(tmp_path, "a.glb")), before)
    restore_large_meshes(path, {"other": Meant, "large": Meant})
    found = read(tmp_path, "a.glb")
    corners = world(found)
    assert corners.shape == (2, 3, 3)
    np.testing.assert_allclose(corners.reshape(-1, 3).max(axis=0), (2, 0, 0))  # Blender's +Z is glTF's +Y
    np.testing.assert_allclose(corners.reshape(-1, 3).min(axis=0), (0, 0, -1))
    assert found.meshes[0].normals is not None
    np.testing.assert_allclose(found.meshes[0].normals, np.tile((0, 1, 0), (4, 1)))
    np.testing.assert_allclose(found.meshes[0].tangents, np.tile((0, 1, 0, 1), (4, 1)))
    np.testing.assert_allclose(found.meshes[0].diameters, 0.5)


def test_non_glb_data_is_rejected(tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(b"glXF" + bytes(40))
    with pytest.raises(ValueError, match=r"a\.glb is not a GLB"):
        Glb(tmp_path / "a.glb")
