"""Tests of writing meshes from arrays as .glb, validated by trimesh; invalid ones are refused with an error message."""

from __future__ import annotations

import io

import numpy as np
import pytest
import trimesh

from rayfarm.library.glb import mesh_as_glb
from renderer.errors import SceneError

BALL = trimesh.creation.icosphere(1)
ARRAYS = {"positions": BALL.vertices, "triangles": BALL.faces}


def test_trimesh_reads_same_arrays() -> None:
    data = mesh_as_glb("ball", {**ARRAYS, "normals": BALL.vertex_normals, "colors": np.abs(BALL.vertices)})
    found = trimesh.load(io.BytesIO(data), file_type="glb", process=False).geometry["ball"]
    np.testing.assert_allclose(found.vertices, BALL.vertices, atol=1e-6)
    np.testing.assert_array_equal(found.faces, BALL.faces)
    np.testing.assert_allclose(found.vertex_normals, BALL.vertex_normals, atol=1e-6)
    np.testing.assert_allclose(found.visual.vertex_colors[:, :3] / 255, np.abs(BALL.vertices), atol=1 / 255)


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"positions": None}, "needs positions"),
        ({"positions": BALL.vertices[:, :2]}, r"shape \(42, 2\)"),
        ({"positions": BALL.vertices * np.nan}, "not finite"),
        ({"positions": "here"}, "not an array of numbers"),
        ({"triangles": BALL.faces + 40}, "the mesh has 42"),
        ({"triangles": BALL.faces - 1}, "counted from 0"),
        ({"triangles": BALL.faces.astype(float)}, "whole numbers"),
        ({"triangles": None}, "whole numbers"),
        ({"normals": BALL.vertices[:7]}, "of 7 vertices"),
        ({"uvs": BALL.vertices}, r"take \(V, 2\)"),
    ],
)
def test_invalid_mesh_is_rejected(changed: dict[str, object], sentence: str) -> None:
    with pytest.raises(SceneError, match=sentence):
        mesh_as_glb("ball", {**ARRAYS, **changed})
