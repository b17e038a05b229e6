"""Tests of glTF nodes with meshes, instances, cameras, lights and names."""

import numpy as np
import pytest

from renderer.scene.compile import compile_scene
from tests.renderer.scene.builders import TRIANGLE, Gltf, world


def test_node_transforms_in_both_notations(scene):
    g = Gltf()
    leaf = g.mesh()
    half = np.sqrt(0.5)
    leaf |= {"translation": [1, 2, 3], "rotation": [0, 0, half, half], "scale": [2, 3, 4]}  # 90 degrees about z
    g.root["scenes"][0]["nodes"] = [1]
    g.node(top=False, children=[0], matrix=[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 10, 20, 30, 1])
    np.testing.assert_allclose(world(scene("a.glb", g.glb()))[0], [(11, 22, 33), (11, 24, 33), (8, 22, 33)], atol=1e-6)


def test_shared_mesh_is_stored_once(scene):
    g = Gltf()
    g.mesh()
    g.node(mesh=0, translation=[5, 0, 0])
    description = scene("a.glb", g.glb())
    assert len(description.meshes) == 1
    np.testing.assert_array_equal(world(description, 1)[0], TRIANGLE + np.float32([5, 0, 0]))


def test_nodes_outside_the_scene_are_ignored(scene):
    g = Gltf()
    g.mesh()
    g.node(top=False, mesh=0)
    assert len(scene("a.glb", g.glb()).instances) == 1


def test_camera_looks_along_minus_z(scene):
    g = Gltf()
    g.mesh()
    g.root["cameras"] = [
        {"type": "perspective", "name": "lens", "perspective": {"yfov": np.radians(50), "znear": 0.1}},
        {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1.5, "znear": 0, "zfar": 1}},
    ]
    half = np.sqrt(0.5)
    g.node(name="left", camera=0, translation=[1, 2, 3], rotation=[0, half, 0, half])  # 90 degrees about y: faces -x
    g.node(camera=1)
    description = scene("a.glb", g.glb())
    camera, flat = description.cameras
    assert camera.name == "left"
    assert camera.view.fov == pytest.approx(50)
    assert camera.view.eye == (1, 2, 3)
    direction = np.subtract(camera.view.target, camera.view.eye)
    np.testing.assert_allclose(direction / np.linalg.norm(direction), (-1, 0, 0), atol=1e-12)
    assert (flat.view.projection, flat.view.height) == ("orthographic", 3)
    assert (camera.view.near, flat.view.near) == (0.1, 0)


def test_punctual_lights_along_minus_z(scene):
    g = Gltf()
    g.mesh()
    spot = {"innerConeAngle": np.radians(20), "outerConeAngle": np.radians(30)}
    lights = [
        {"type": "point", "intensity": 683, "color": [1, 0.5, 0], "range": 4},
        {"type": "spot", "intensity": 1366, "spot": spot},
        {"type": "directional", "name": "sun"},
    ]
    g.root["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    g.root["extensionsUsed"] = ["KHR_lights_punctual"]
    half = np.sqrt(0.5)
    for i, name in enumerate(("lamp", "beam", "")):
        place = {"translation": [1, 2, 3], "rotation": [-half, 0, 0, half], "scale": [2, 3, 4]}  # -z rotated downwards
        g.node(name=name, extensions={"KHR_lights_punctual": {"light": i}}, **place)
    description = scene("a.glb", g.glb())
    lamp, beam, sun = description.lights
    assert [light.kind for light in description.lights] == ["point", "spot", "directional"]
    assert [light.name for light in description.lights] == ["lamp", "beam", "sun"]
    np.testing.assert_allclose(lamp.intensity, (1, 0.5, 0))
    np.testing.assert_allclose(sun.intensity, [1 / 683] * 3)
    np.testing.assert_allclose((beam.inner_cone, beam.outer_cone), (20, 30))
    np.testing.assert_allclose(beam.direction, (0, -1, 0), atol=1e-12)
    assert beam.position == (1, 2, 3)
    compile_scene(description)
    assert description.environment is None  # with explicit lights, no default environment is added
    assert description.warnings == []


def test_mesh_gpu_instancing(scene):
    g = Gltf()
    node = g.mesh()
    half = np.sqrt(0.5)
    places = np.array([(1, 0, 0), (0, 2, 0)], np.float32)
    turns = np.array([(0, 0, 0, 1), (0, 0, half, half)], np.float32)  # 90 degrees about z
    attributes = {"TRANSLATION": g.array(places), "ROTATION": g.array(turns)}
    node |= {"name": "tree", "scale": [2, 2, 2], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}}
    g.root["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    description = scene("a.glb", g.glb())
    assert [i.name for i in description.instances] == ["tree [0]", "tree [1]"]
    assert len(description.meshes) == 1
    np.testing.assert_allclose(world(description, 0)[0], TRIANGLE * 2 + np.float32([2, 0, 0]), atol=1e-6)
    np.testing.assert_allclose(world(description, 1)[0], [(0, 4, 0), (0, 6, 0), (-2, 4, 0)], atol=1e-6)


def test_objects_are_named_after_their_nodes(scene):
    g = Gltf()
    for name in ("chair", "chair", ""):
        g.mesh()["name"] = name
    g.root["meshes"][2]["name"] = "table"
    g.root["meshes"][0]["primitives"] *= 2
    assert [i.name for i in scene("a.glb", g.glb()).instances] == ["chair", "chair", "chair (2)", "table"]


def test_hidden_nodes_are_not_shown(scene):
    g = Gltf()
    g.mesh()
    g.mesh()["extensions"] = {"KHR_node_visibility": {"visible": False}}
    assert len(scene("a.glb", g.glb()).instances) == 1


@pytest.mark.long
def test_deep_node_chain_is_read(scene):
    """A deep chain of nodes, each slightly offset from its parent, is read; only a node with two parents or a cycle is damage."""
    g = Gltf()
    g.mesh()
    count = 5_000  # five times Python's recursion limit
    g.root["nodes"] = [{"children": [i + 1], "translation": [0.25, 0, 0]} for i in range(count - 1)] + [{"mesh": 0}]
    g.root["scenes"] = [{"nodes": [0]}]
    np.testing.assert_allclose(world(scene("a.glb", g.glb()))[0], TRIANGLE + np.float32([(count - 1) / 4, 0, 0]), atol=1e-3)
    for last, children in ((7, [8, 9]), (count - 1, [0])):
        g.root["nodes"][last]["children"] = children
        description = scene("a.glb", g.glb())
        assert len(description.instances) == 1
        assert any("has two parents or is its own ancestor" in warning for warning in description.warnings)
        g.root["nodes"][7]["children"] = [8]
