"""Tests of glTF points and lines: dropped with a warning, or shown as balls and tubes of a given thickness."""

import json

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.scene.normals import face_normals
from tests.renderer.scene.builders import Gltf

CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 0)], np.float32)


def drawn(mode, colors=False):
    g = Gltf()
    more = {"COLOR_0": np.array([(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)], np.float32)} if colors else {}
    g.mesh(CORNERS, mode=mode, **more)
    return g.glb()


def mesh_of_lines(scene, mode, thickness=0.1, **options):
    text = json.dumps({"shapes": [{"type": "mesh", "file": "m.glb", "thickness": thickness}]})
    return scene("s.yaml", text, {"m.glb": drawn(mode, **options)}).meshes[0]


@pytest.mark.parametrize(("mode", "length"), [(1, 1.0), (2, 2 + 2**0.5), (3, 2.0)])
def test_lines_become_tubes(scene, mode, length):
    mesh = mesh_of_lines(scene, mode)
    side = 2 * 0.05 * np.sin(np.pi / 8)
    ends = 8 * 0.05**2 * np.sin(np.pi / 4) / 2
    faces = face_normals(mesh.positions, mesh.triangles)
    count = {1: 1, 2: 3, 3: 2}[mode]
    assert np.linalg.norm(faces, axis=1).sum() / 2 == pytest.approx(8 * side * length + 2 * count * ends, rel=1e-5)
    assert (np.einsum("tc,tc->t", faces, mesh.normals[mesh.triangles].mean(axis=1)) > 0).all()


def test_points_become_colored_spheres(scene):
    mesh = mesh_of_lines(scene, 0, colors=True)
    middles = mesh.positions.reshape(4, -1, 3).mean(axis=1)
    np.testing.assert_allclose(middles, CORNERS, atol=1e-6)
    assert np.linalg.norm(mesh.positions.reshape(4, -1, 3) - CORNERS[:, None], axis=2) == pytest.approx(0.05, rel=1e-5)
    assert mesh.colors.reshape(4, -1, 4)[:, 0, :3].tolist() == [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]]


def test_missing_thickness_causes_a_note(scene):
    g = Gltf()
    g.mesh()
    g.mesh(CORNERS, mode=3)
    description = scene("m.glb", g.glb())
    assert any("{type: mesh, file: m.glb, thickness: 0.01}" in w for w in description.warnings)


def test_thickness_is_rejected_for_other_formats(scene):
    text = json.dumps({"shapes": [{"type": "mesh", "file": "a.obj", "thickness": 1}]})
    with pytest.raises(SceneError, match="has no points or lines"):
        scene("s.yaml", text, {"a.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"})
