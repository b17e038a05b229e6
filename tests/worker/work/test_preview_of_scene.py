"""Tests of the preview that a reader draws before it compiles a scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from protocol.mesh import decode_mesh
from renderer.errors import SceneError
from renderer.scene.compile import compile_scene
from renderer.scene.description import Instance, Material, Mesh, SceneDescription
from worker.reading.prepare import draw_preview


def triangle(scale: float = 1.0) -> SceneDescription:
    mesh = Mesh("triangle", np.eye(3, dtype=np.float32), np.arange(3, dtype=np.int32)[None])
    return SceneDescription(meshes=[mesh], instances=[Instance(0, np.diag([scale, scale, scale, 1.0]))], materials=[Material()])


def test_preview_is_written_with_cameras(tmp_path: Path) -> None:
    found = draw_preview(triangle(), tmp_path / "mesh")
    assert found is not None
    assert [camera["name"] for camera in found["cameras"]] == ["auto"]
    assert len(decode_mesh((tmp_path / "mesh").read_bytes()).triangles) == 1


def test_scene_without_possible_preview_is_left_to_compiling(tmp_path: Path) -> None:
    """Cameras cannot be as far away as this scene needs. The error of the preview would hide the one that names the mesh."""
    description = triangle(1e30)
    assert draw_preview(description, tmp_path / "mesh") is None
    with pytest.raises(SceneError, match="Mesh triangle: its position is too large"):
        compile_scene(description)
