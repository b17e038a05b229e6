"""Tests of glTF morph targets by their default weights, and of skins in their rest pose."""

import numpy as np
import pytest

from renderer.errors import SceneError
from tests.renderer.scene.builders import TRIANGLE, Gltf, world

UP = np.tile(np.array([0, 0, 1], np.float32), (3, 1))


def morphing(default, **node):
    g = Gltf()
    g.mesh(NORMAL=UP)
    first = {"POSITION": g.array(np.float32([(1, 0, 0), (0, 2, 0), (0, 0, 3)])), "NORMAL": g.array(UP)}
    second = {"POSITION": g.array(np.float32([(0, 0, 1)] * 3))}
    g.root["meshes"][0]["primitives"][0]["targets"] = [first, second]
    g.root["meshes"][0]["weights"] = default
    g.root["nodes"][0] |= node
    return g


def test_morph_targets_by_weights(scene):
    mesh = scene("a.glb", morphing([0.5, 0.25]).glb()).meshes[0]
    np.testing.assert_allclose(mesh.positions, TRIANGLE + np.float32([(0.5, 0, 0.25), (0, 1, 0.25), (0, 0, 1.75)]))
    np.testing.assert_allclose(mesh.normals, 1.5 * UP)


def test_node_weights_override_mesh_weights(scene):
    g = morphing([0.5, 0.25], weights=[0, 1])
    g.node(mesh=0)
    g.node(mesh=0)
    description = scene("a.glb", g.glb())
    assert [i.mesh for i in description.instances] == [0, 1, 1]
    np.testing.assert_allclose(description.meshes[0].positions, TRIANGLE + np.float32([0, 0, 1]))


def bony(joints, weights, matrices=None):
    """Builds a triangle skinned to two bones: one translates by (10, 0, 0), one rotates by 90 degrees about z and scales by 2."""
    g = Gltf()
    half = np.sqrt(0.5)
    more = {"NORMAL": UP, "JOINTS_0": np.array(joints, np.uint8), "WEIGHTS_0": np.array(weights, np.float32)}
    g.mesh(**more)
    g.root["nodes"][0] |= {"skin": 0, "translation": [99, 99, 99]}
    g.node(translation=[10, 0, 0])
    g.node(rotation=[0, 0, half, half], scale=[2, 2, 2])
    g.root["skins"] = [{"joints": [1, 2]}]
    if matrices is not None:
        g.root["skins"][0]["inverseBindMatrices"] = g.array(np.array(matrices, np.float32).transpose(0, 2, 1).reshape(-1, 16))
    return g


def test_skinned_vertices_ignore_the_node_transform(scene):
    g = bony([(0, 1, 0, 0)] * 3, [(1, 0, 0, 0), (0, 1, 0, 0), (0.5, 0.5, 0, 0)])
    description = scene("a.glb", g.glb())
    np.testing.assert_allclose(world(description)[0], [(10, 0, 0), (0, 2, 0), (4, 0.5, 0)], atol=1e-6)
    normals = description.meshes[0].normals
    np.testing.assert_allclose(normals / np.linalg.norm(normals, axis=1, keepdims=True), UP, atol=1e-6)


def test_inverse_bind_matrices_are_applied_first(scene):
    bind = np.tile(np.eye(4), (2, 1, 1))
    bind[1, :3, 3] = (1, 0, 0)
    g = bony([(1, 0, 0, 0)] * 3, [(1, 0, 0, 0)] * 3, bind)
    np.testing.assert_allclose(world(scene("a.glb", g.glb()))[0], [(0, 2, 0), (0, 4, 0), (-2, 2, 0)], atol=1e-6)


def test_weights_need_not_sum_to_one(scene):
    g = bony([(0, 1, 0, 0)] * 3, [(3, 0, 0, 0), (0, 0.25, 0, 0), (0, 0, 0, 0)])
    np.testing.assert_allclose(world(scene("a.glb", g.glb()))[0], [(10, 0, 0), (0, 2, 0), (0, 1, 0)], atol=1e-6)


def test_too_many_instances_are_rejected(scene, monkeypatch):
    monkeypatch.setattr("renderer.scene.readers.gltf.meshes.MAX_VERTICES", 5)
    g = bony([(0, 0, 0, 0)] * 3, [(1, 0, 0, 0)] * 3)
    g.node(mesh=0, skin=0)
    with pytest.raises(SceneError, match="more than 5 vertices"):
        scene("a.glb", g.glb())


def test_faults_are_reported(scene):
    g = bony([(2, 0, 0, 0)] * 3, [(1, 0, 0, 0)] * 3)
    description = scene("a.glb", g.glb())
    assert len(description.instances) == 1
    assert any("has 2 joints, but the mesh refers to 3" in warning for warning in description.warnings)
    g.root["skins"] = [{"joints": []}]
    description = scene("a.glb", g.glb())
    assert len(description.instances) == 1
    assert any("skins[0].joints" in warning for warning in description.warnings)
