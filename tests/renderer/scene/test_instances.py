"""Tests of which meshes are instanced, and of the compiled scene's data for instances."""

import numpy as np
import pytest

from renderer.arrays.rows import PART_MATERIAL, PART_OBJECT
from renderer.errors import SceneError
from renderer.scene.compile import compile_scene, summarise
from renderer.scene.description import Instance, Material, SceneDescription
from renderer.scene.geometry import flatten
from renderer.scene.instances import plan_instancing
from renderer.scene.readers import shapes
from tests.renderer.builders import icosphere


def moved(x, scale=1.0):
    transform = np.diag([scale, scale, scale, 1.0])
    transform[0, 3] = x
    return transform


def many(meshes, copies, materials=None, **more):
    """Returns a description of a scene with `copies` instances of every mesh, each at its own place."""
    return SceneDescription(
        meshes=meshes,
        instances=[Instance(m, moved(5.0 * i), name=f"copy {i}") for i in range(copies) for m in range(len(meshes))],
        materials=materials or [Material()],
        **more,
    )


def test_small_meshes_are_instanced_if_there_are_many_copies():
    ball = icosphere(3)  # 1280 triangles
    assert plan_instancing(many([ball], 20)).groups == []
    sharing = plan_instancing(many([ball], 30))
    assert sharing.copied == []
    assert [g.instances for g in sharing.groups] == [list(range(30))]
    assert plan_instancing(many([ball], 1)).groups == []
    assert plan_instancing(many([shapes.quad("q")], 5000)).groups == []


def test_large_scenes_instance_every_repeated_mesh(monkeypatch):
    monkeypatch.setattr("renderer.scene.instances._LARGE", 1000)
    assert len(plan_instancing(many([icosphere(2)], 4)).groups) == 1
    assert plan_instancing(many([icosphere(2)], 3)).groups == []


def test_meshes_placed_together_share_one_tree():
    description = many([icosphere(3), icosphere(3, material=1), icosphere(3)], 30, [Material(), Material()])
    description.instances.append(Instance(2, moved(-50.0)))  # the third mesh also has an instance of its own
    groups = plan_instancing(description).groups
    assert [g.meshes for g in groups] == [[0, 1], [2]]
    compiled = compile_scene(description)
    assert len(compiled.to_world) == 61
    assert len(compiled.triangle) == 3 * 1280
    assert len(np.unique(compiled.bvh.instance_root)) == 2
    assert sorted(np.bincount(compiled.part[compiled.triangle[:, 3], PART_MATERIAL])) == [1280, 2560]


def test_emitters_are_copied_into_world_space():
    description = many([icosphere(3)], 40, [Material(), Material(emission=(1.0, 0.0, 0.0))])
    for i in (3, 7):
        description.instances[i].material = 1
    sharing = plan_instancing(description)
    assert sharing.copied == [3, 7]
    compiled = compile_scene(description)
    assert len(compiled.light_primitive) == 2 * 1280
    assert (compiled.triangle_light[2 * 1280 :] == -1).all()
    assert (compiled.instance_material == -1).all()
    description.meshes[0].material = 1  # the mesh's own material is emissive, the replacement is not
    for instance in description.instances:
        instance.material = 0
    compiled = compile_scene(description)
    assert len(compiled.to_world) == 40
    assert len(compiled.light_primitive) == 0


def test_flat_and_extreme_transforms_are_copied():
    description = many([icosphere(3)], 40)
    description.instances[0].transform = np.diag([1.0, 1.0, 0.0, 1.0])
    description.instances[1].transform = np.diag([1.0, 1.0, 1e-8, 1.0])
    assert plan_instancing(description).copied == [0, 1]


def test_instances_keep_their_names_and_materials_and_the_scene_its_bounds():
    description = many([icosphere(3)], 40, [Material("grey"), Material("red")])
    description.instances[5].material = 1
    description.instances[6].name = "copy 5"
    compiled = compile_scene(description)
    assert compiled.instance_material.tolist() == [1 if i == 5 else -1 for i in range(40)]
    assert compiled.instance_object.tolist() == [0, 1, 2, 3, 4, 5, 5, *range(6, 39)]
    assert (compiled.part[compiled.triangle[:, 3], PART_OBJECT] == -1).all()
    summary = summarise(description, compiled)
    assert summary["objects"][4:7] == ["copy 4", "copy 5", "copy 7"]
    assert summary["counts"]["triangles"] == 40 * 1280
    assert summary["counts"]["unique_triangles"] == 1280
    flat = flatten(description)
    np.testing.assert_allclose(compiled.bounds, [flat.position.min(0), flat.position.max(0)], atol=1e-5)
    eye = np.array(summary["cameras"][-1]["view"]["eye"])
    assert 100 < np.linalg.norm(eye - [97.5, 0, 0]) < 500  # all instances are in view


def test_instanced_triangles_count_once(monkeypatch):
    monkeypatch.setattr("renderer.scene.geometry.MAX_TRIANGLES", 2000)
    assert len(compile_scene(many([icosphere(3)], 1000)).to_world) == 1000
    with pytest.raises(SceneError, match="repeated meshes counted once"):
        compile_scene(many([icosphere(3), icosphere(3)], 1000))


def test_instance_beyond_float32_range_is_an_error():
    description = many([icosphere(3)], 40)
    description.instances[0].transform[0, 3] = 1e30
    with pytest.raises(SceneError, match="too large for 32-bit numbers"):
        compile_scene(description)
