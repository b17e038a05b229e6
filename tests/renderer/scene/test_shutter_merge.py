"""Tests of detecting moving parts in files, and of separating them from static parts in the compiled scene."""

import numpy as np
import pytest

from renderer.arrays.scene import flat
from renderer.scene.animation import Moment
from renderer.scene.compile import compile_scene, summarise
from renderer.scene.description import Environment, Instance, Material, SceneDescription, Sphere
from renderer.scene.instances import plan_instancing
from renderer.scene.load import Shot
from renderer.scene.readers import shapes
from tests.renderer.builders import icosphere
from tests.renderer.bvh.rays import trace
from tests.renderer.scene.builders import TRIANGLE, Gltf, clip


def moving(description):
    """Returns two sets of instance names: the moving ones, and those whose mesh deforms."""
    moved = {i.name for i in description.instances if i.moves}
    return moved, {i.name for i in description.instances if description.meshes[i.mesh].deforms}


def test_gltf_channels_determine_moving_parts(scene):
    g = Gltf()
    for name in ("floor", "arm", "finger", "face", "lamp", "blinker", "idle", "skinned", "statue"):
        g.mesh(TRIANGLE + len(g.root["nodes"]), material=len(g.root["nodes"]))
        g.root["nodes"][-1]["name"] = name
    g.root["materials"] = [{} for _ in g.root["nodes"]]
    g.root["nodes"][1]["children"] = [2]
    g.root["scenes"][0]["nodes"].remove(2)
    g.root["meshes"][3]["primitives"][0]["targets"] = [{"POSITION": g.array(TRIANGLE)}]
    for mesh in (7, 8):
        g.root["meshes"][mesh]["primitives"][0]["attributes"] |= {
            "JOINTS_0": g.array(np.zeros((3, 4), np.uint8)),
            "WEIGHTS_0": g.array(np.tile(np.float32([1, 0, 0, 0]), (3, 1))),
        }
    g.node(name="joint")
    g.node(name="still joint")
    g.root["skins"] = [{"joints": [9]}, {"joints": [10]}]
    g.root["nodes"][7]["skin"], g.root["nodes"][8]["skin"] = 0, 1
    ends = [0, 1]
    clip(
        g,
        "all",
        (1, "translation", ends, [(0, 0, 0), (1, 0, 0)], "LINEAR"),
        (3, "weights", ends, [0, 1], "LINEAR"),
        (6, "translation", ends, [(0, 0, 1), (0, 0, 1)], "LINEAR"),
        (9, "rotation", ends, [(0, 0, 0, 1), (0, 0, 1, 0)], "LINEAR"),
        ("/materials/4/emissiveFactor", "pointer", ends, [(0, 0, 0), (1, 1, 1)], "LINEAR"),
        ("/nodes/5/extensions/KHR_node_visibility/visible", "pointer", ends, np.uint8([1, 0]), "STEP"),
    )
    description = scene("all.glb", g.glb())
    assert moving(description) == ({"arm", "finger", "lamp", "blinker"}, {"face", "skinned"})


def test_scene_file_keys_determine_moving_parts(scene):
    turning = "{rotate: {axis: y, degrees: {keys: [[0, 0], [1, 90]]}}}"
    description = scene(
        "a.yaml",
        f"""
materials:
  plain: {{}}
  beacon: {{emission: {{keys: [[0, 0], [1, 5]]}}}}
  tinted: {{color: {{keys: [[0, '#ff0000'], [1, '#00ff00']]}}}}
shapes:
  - {{type: cube, name: floor}}
  - {{type: cube, name: tinted, material: tinted}}
  - {{type: cube, name: lamp, material: beacon}}
  - type: group
    name: crane
    transform: [{turning}]
    shapes: [{{type: cube, name: arm}}, {{type: sphere, name: hook}}]
  - {{type: lathe, name: vase, profile: {{keys: [[0, [[1, 0], [1, 1]]], [1, [[2, 0], [1, 1]]]]}}}}
  - {{type: sphere, name: ball, center: {{keys: [[0, [0, 0, 0]], [1, [0, 5, 0]]]}}}}
  - {{type: sphere, name: globe}}
""",
    )
    assert moving(description) == ({"lamp", "crane/arm"}, {"vase"})
    assert {s.name for s in description.spheres if s.moves} == {"crane/hook", "ball"}


def test_numbered_meshes_deform(tmp_path):
    (tmp_path / "a.0001.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    description = Shot(tmp_path, "a.####.obj").scene_at(Moment(1))
    assert all(mesh.deforms for mesh in description.meshes)


def turned(degrees, x=0.0):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0, s, x], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1.0]])


def zoo(angle=20.0, marked=True):
    """Returns a scene at `angle` with static, moving and deforming parts.

    Static: a floor, 30 balls and a sphere. Moving: two bodies of two meshes each, a lamp and a sphere. Deforming: a ball.
    """
    ball, lump = icosphere(3), icosphere(2)
    lump.positions = lump.positions * np.float32([1.0, 1.0 + angle / 100, 1.0]) + np.float32([0, 4, 0])
    lump.deforms = marked
    lamp = icosphere(1, material=1)
    instances = [Instance(0, np.diag([40.0, 40, 40, 1]), name="floor")]
    instances += [Instance(1, turned(0, 3.0 * i - 40), name=f"ball {i}") for i in range(30)]
    for i in range(2):
        instances += [Instance(m, turned(angle, 6.0 * i - 3), name=f"body {i}", moves=marked) for m in (2, 3)]
    instances += [Instance(4, turned(angle, -9.0), name="lamp", moves=marked), Instance(5, name="lump")]
    return SceneDescription(
        meshes=[shapes.quad("q"), ball, shapes.cube("c"), icosphere(1), lamp, lump],
        instances=instances,
        spheres=[Sphere((angle / 10, 3, 3), 1.0, name="moves", moves=marked), Sphere((0, 3, -3), 1.0, name="still")],
        materials=[Material(), Material(emission=(1.0, 2.0, 3.0))],
        environment=Environment(),
    )


def test_moving_parts_are_separated():
    sharing = plan_instancing(zoo())
    assert sharing.copied == [0]
    assert [group.meshes for group in sharing.groups] == [[1]]
    assert [(group.meshes, group.instances) for group in sharing.bodies] == [([2, 3], [31, 33])]
    assert sharing.loose == [35, 36]
    assert plan_instancing(zoo(marked=False)).bodies == plan_instancing(zoo(marked=False)).loose == []


@pytest.mark.parametrize("angle", [0.0, 33.0])
def test_separated_scene_has_the_same_hits(angle):
    apart, whole = zoo(angle), zoo(angle, marked=False)
    ours, theirs = compile_scene(apart), compile_scene(whole)
    rng = np.random.default_rng(1)
    o = rng.uniform((-45, 0.1, -8), (45, 9, 8), (20_000, 3)).astype(np.float32)
    d = rng.standard_normal((20_000, 3)).astype(np.float32)
    a, b = trace(ours.bvh, o, d), trace(theirs.bvh, o, d)
    close = np.isclose(a.t, b.t, rtol=1e-4, atol=1e-5)
    assert close.mean() > 0.9995
    assert (a.shadow == b.shadow).mean() > 0.9995

    def object_of(scene, hits):
        triangles = len(scene.triangle)
        found = np.full(len(hits.primitive), -9)
        sphere = hits.primitive >= triangles
        found[sphere] = scene.sphere_object[hits.primitive[sphere] - triangles]
        surface = (hits.primitive >= 0) & ~sphere
        found[surface] = scene.part[scene.triangle[hits.primitive[surface], 3], 1]
        inside = hits.instance >= 0
        found[inside] = scene.instance_object[hits.instance[inside]]
        return found

    assert (object_of(ours, a) == object_of(theirs, b)).mean() > 0.9995
    assert len(np.unique(object_of(ours, a))) >= 34
    np.testing.assert_allclose(np.sort(ours.light_area), np.sort(theirs.light_area), rtol=1e-5)
    mine, other = summarise(apart, ours), summarise(whole, theirs)
    assert mine["counts"]["unique_triangles"] == 2 + 1280 + 12 + 80 + 80 + 320
    for key in ("objects", "materials"):
        assert mine[key] == other[key]
    np.testing.assert_allclose(mine["bounds"], other["bounds"], rtol=0.05)


def test_static_parts_have_equal_bits_in_all_frames():
    one, other = (flat(compile_scene(zoo(angle))) for angle in (0.0, 33.0))
    # Offsets of parts do not depend on the moment: the loose part is the last, and only its tree may change in size.
    assert {name for name in one if one[name].shape != other[name].shape} <= {"bvh.node", "bvh.packet", "light_node"}
    still = 40 * 1024 // 12  # number of elements in the first part's pages
    for name in ("position", "normal", "triangle"):
        np.testing.assert_array_equal(one[name][:still], other[name][:still])
    np.testing.assert_array_equal(one["bvh.node"][128:384], other["bvh.node"][128:384])
    changed = {name for name in one if not np.array_equal(one[name], other[name])}
    assert "to_world" in changed
    assert not changed & {"part", "uv", "material", "sphere_object", "triangle"}


def test_static_scene_is_one_tree():
    compiled = compile_scene(zoo(marked=False))
    assert compiled.bvh.instance_root[0] < len(compiled.bvh.node)
    assert (compiled.part[:, 1] >= -1).all()
