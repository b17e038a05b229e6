"""Tests of glTF animations: positions equal the specification's formulas, computed independently in float64."""

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.scene.animation import Clip, Moment
from renderer.scene.compile import compile_scene, summarise
from renderer.scene.load import Shot
from tests.renderer.scene.builders import POINTER, TRIANGLE, Gltf, clip, moving_gltf, world


def at(seconds, clip=None):
    """Returns the moment at `seconds`, a multiple of 1/4 s and so exactly a frame at 8 frames per second."""
    return Moment(8 * seconds, 8.0, clip)


def turn(degrees, axis):
    half = np.radians(degrees) / 2
    return [*(np.sin(half) * np.array(axis)), np.cos(half)]


def matrix(translation=(0, 0, 0), degrees=0.0, axis=(0, 0, 1), scale=(1, 1, 1)):
    """Returns T R S, with the rotation by Rodrigues' formula instead of quaternions."""
    x, y, z = np.array(axis, np.float64)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    result = np.eye(4)
    result[:3, :3] = (np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k) @ np.diag(scale)
    result[:3, 3] = translation
    return result


def arm():
    """Builds a triangle on a hand on an arm: the arm rotates about z, the hand moves and grows, and a camera is on the hand."""
    g = Gltf()
    g.node(children=[1], translation=[1, 0, 0])
    g.node(top=False, children=[2, 3])
    g.mesh()
    g.root["nodes"][2] |= {"translation": [0, 2, 0]}
    g.root["scenes"][0]["nodes"] = [0]
    g.root["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}]
    g.node(top=False, camera=0)
    return clip(
        g,
        "wave",
        (0, "rotation", [0, 1, 2], [turn(0, (0, 0, 1)), turn(90, (0, 0, 1)), turn(90, (0, 0, 1))], "LINEAR"),
        (1, "translation", [0.5, 1.5], [(0, 0, 0), (0, 0, 4)], "LINEAR"),
        (2, "scale", [0, 1], [(1, 1, 1), (2, 2, 2)], "STEP"),
    )


@pytest.mark.parametrize("seconds", [0, 0.25, 0.75, 1.0, 1.25, 3.0])
def test_animated_hierarchy_transforms(scene, seconds):
    description = scene("arm.glb", arm().glb(), moment=at(seconds))
    own = matrix((0, 2, 0), scale=[2.0 if seconds >= 1 else 1.0] * 3)
    hand = matrix((0, 0, 4 * np.clip(seconds - 0.5, 0, 1)))
    whole = matrix((1, 0, 0), 90 * min(seconds, 1)) @ hand
    place = whole @ own
    expected = TRIANGLE.astype(np.float64) @ place[:3, :3].T + place[:3, 3]
    np.testing.assert_allclose(world(description)[0], expected, atol=1e-6)
    view = description.cameras[0].view
    np.testing.assert_allclose(view.eye, whole[:3, 3], atol=1e-6)
    np.testing.assert_allclose(view.up, whole[:3, 1], atol=1e-6)
    assert description.clips == [Clip("wave", 0, 2)]
    assert not [w for w in description.warnings if "light" not in w]


def test_default_moment_and_frame_rate(scene):
    still = scene("arm.glb", arm().glb())
    assert np.array_equal(world(still), world(scene("arm.glb", arm().glb(), moment=Moment(0))))
    a, b = (scene("arm.glb", arm().glb(), moment=m) for m in (Moment(18), Moment(9, fps=12)))
    assert np.array_equal(world(a), world(b))
    assert not np.array_equal(world(a), world(still))


def test_shot_frames_do_not_depend_on_order(scene, tmp_path):
    alone = [scene("arm.glb", arm().glb(), moment=at(s)) for s in (0.75, 0.25, 1.5)]
    shot = Shot(tmp_path, "arm.glb")
    for s, expected in zip((0.75, 0.25, 1.5), alone, strict=True):
        found = shot.scene_at(at(s))
        assert np.array_equal(world(found), world(expected))
        assert found.warnings == expected.warnings


def bones(sets=1):
    """Builds a strip of three triangles skinned to two joints, one rotating and one moving; the bind pose is off the origin."""
    g = Gltf()
    rng = np.random.default_rng(3)
    points = rng.normal(size=(9, 3)).astype(np.float32)
    weights = rng.random((9, 4 * sets)).astype(np.float32)
    joints = rng.integers(0, 2, (9, 4 * sets)).astype(np.uint8)
    more = {f"JOINTS_{k}": joints[:, 4 * k : 4 * k + 4].copy() for k in range(sets)}
    more |= {f"WEIGHTS_{k}": weights[:, 4 * k : 4 * k + 4].copy() for k in range(sets)}
    g.mesh(points, NORMAL=points, **more)
    g.root["nodes"][0]["skin"] = 0
    g.node(children=[2], translation=[0, 1, 0])
    g.node(top=False, translation=[2, 0, 0])
    bind = np.array([np.linalg.inv(matrix((0, 1, 0))), np.linalg.inv(matrix((2, 1, 0)))])
    columns = bind.transpose(0, 2, 1).reshape(2, 16).astype(np.float32)
    g.root["skins"] = [{"joints": [1, 2], "inverseBindMatrices": g.array(columns)}]
    clip(
        g,
        "bend",
        (1, "rotation", [0, 2], [turn(0, (1, 0, 0)), turn(120, (1, 0, 0))], "LINEAR"),
        (2, "translation", [0, 2], [(2, 0, 0), (2, 0, 6)], "LINEAR"),
    )
    return g, points, joints, weights, bind


@pytest.mark.parametrize("sets", [1, 2, 3, 6])
@pytest.mark.parametrize("seconds", [0, 0.5, 1.25])
def test_animated_skins(scene, sets, seconds):
    g, points, joints, weights, bind = bones(sets)
    first = matrix((0, 1, 0), 60 * seconds, (1, 0, 0))
    moved = np.array([first, first @ matrix((2, 0, 3 * seconds))]) @ bind
    share = weights.astype(np.float64) / weights.astype(np.float64).sum(axis=1, keepdims=True)
    expected = np.zeros((9, 3))
    for v in range(9):
        blend = sum(share[v, k] * moved[joints[v, k]] for k in range(4 * sets))
        expected[v] = (blend @ [*points[v].astype(np.float64), 1])[:3]
    description = scene("bend.glb", g.glb(), moment=at(seconds))
    np.testing.assert_allclose(world(description).reshape(-1, 3), expected, atol=2e-6)


@pytest.mark.parametrize("seconds", [0, 0.25, 0.5, 1, 1.5, 2])
def test_cubic_morph_weights(scene, seconds):
    g = Gltf()
    g.mesh()
    ways = np.float32([[(1, 0, 0), (0, 2, 0), (0, 0, 3)], [(0, 0, 1)] * 3])
    g.root["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": g.array(w)} for w in ways]
    # For each key: incoming slopes, values, outgoing slopes, of both morph targets.
    keys = [[(0, 0), (0, 1), (1, 0)], [(2, 0), (1, 0.5), (0, 0)]]
    clip(g, "talk", (0, "weights", [0, 2], np.reshape(keys, -1), "CUBICSPLINE"))
    u, d = seconds / 2, 2.0
    value = [
        (2 * u**3 - 3 * u**2 + 1) * keys[0][1][k]
        + d * (u**3 - 2 * u**2 + u) * keys[0][2][k]
        + (3 * u**2 - 2 * u**3) * keys[1][1][k]
        + d * (u**3 - u**2) * keys[1][0][k]
        for k in range(2)
    ]
    expected = TRIANGLE.astype(np.float64) + value[0] * ways[0] + value[1] * ways[1]
    np.testing.assert_allclose(world(scene("talk.glb", g.glb(), moment=at(seconds)))[0], expected, atol=1e-6)


def two_clips():
    g = Gltf()
    g.mesh()
    clip(g, "walk", (0, "translation", [0, 1], [(0, 0, 0), (1, 0, 0)], "LINEAR"))
    clip(g, "jump", (0, "translation", [0.5, 2], [(0, 1, 0), (0, 4, 0)], "LINEAR"))
    clip(g, "grow", (0, "scale", [0, 1], [(1, 1, 1), (3, 3, 3)], "LINEAR"))
    return g


@pytest.mark.parametrize(
    ("asked", "place", "size"),
    [(None, (1, 0, 0), 1), ("walk", (1, 0, 0), 1), ("jump", (0, 2, 0), 1), ("1", (0, 2, 0), 1), ("all", (0, 2, 0), 3)],
)
def test_clip_is_selected_by_name_or_number(scene, asked, place, size):
    description = scene("two.glb", two_clips().glb(), moment=at(1, asked))
    np.testing.assert_allclose(description.instances[0].transform, matrix(place, scale=[size] * 3), atol=1e-6)
    assert description.clips == [Clip("walk", 0, 1), Clip("jump", 0.5, 2), Clip("grow", 0, 1)]
    assert summarise(description, compile_scene(description))["animations"] == ["walk", "jump", "grow"]


@pytest.mark.parametrize(
    ("asked", "places"), [(None, (1, 2)), ("all", (1, 2)), ("0", (1, 2)), ("walk", (1, 0)), ("1", (1, 0)), ("fly", (0, 2))]
)
def test_clips_with_disjoint_targets_are_combined(scene, asked, places):
    """Animation clips that move different nodes are combined, since Blender's exporter writes one clip per object's action."""
    g = Gltf()
    g.mesh()
    g.node(mesh=0)
    clip(g, "walk", (0, "translation", [0, 1], [(0, 0, 0), (1, 0, 0)], "LINEAR"))
    clip(g, "fly", (1, "translation", [0.5, 2], [(0, 0, 0), (0, 6, 0)], "LINEAR"))
    description = scene("two.glb", g.glb(), moment=at(1, asked))
    found = sorted(instance.transform[:3, 3].sum() for instance in description.instances)
    np.testing.assert_allclose(found, sorted(places), atol=1e-6)
    assert description.clips == [Clip("all", 0, 2), Clip("walk", 0, 1), Clip("fly", 0.5, 2)]
    assert not any("clip" in warning for warning in description.warnings)


def test_unknown_clip_error_lists_the_clips(scene):
    with pytest.raises(SceneError, match=r"two\.glb has no clip 'swim'; its clips are 0: walk, 1: jump, 2: grow"):
        scene("two.glb", two_clips().glb(), moment=at(1, "swim"))
    g = Gltf()
    g.mesh()
    with pytest.raises(SceneError, match=r"a\.glb has no clips; leave the clip out"):
        scene("a.glb", g.glb(), moment=at(0, "walk"))
    with pytest.raises(SceneError, match=r"a.obj has no clips; only glTF, USD and FBX files have them. Leave the clip out"):
        scene("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", moment=at(0, "walk"))


def test_animation_pointers(scene, png):
    description = scene("all.glb", moving_gltf(png).glb(), moment=at(0.5))
    assert not [w for w in description.warnings if "anim" in w]
    material = description.materials[0]
    assert (material.base_color, material.opacity) == ((0.5, 0.25, 0.125), 0.5)
    assert (material.roughness, material.transmission, material.clearcoat) == (0.5, 0.5, 0.5)
    assert material.emission == (2, 2, 0)
    assert (material.attenuation_distance, material.normal_scale) == (2, 2)
    assert description.textures[material.normal_texture].transform == (2, 0, 0.5, 0, 2, 1)
    assert description.textures[material.base_color_texture].transform == (2, 0, 0, 0, 3, 0)
    (light,) = description.lights
    np.testing.assert_allclose(light.intensity, (1, 0.5, 0.5))
    assert light.outer_cone == pytest.approx(np.degrees(0.4))
    assert description.cameras[0].view.fov == pytest.approx(np.degrees(1))
    assert description.cameras[1].view.height == 4
    shaped = next(i for i in description.instances if description.meshes[i.mesh].name == "mesh 1")
    morphed = description.meshes[shaped.mesh].positions
    rest = scene("all.glb", moving_gltf(png).glb(), moment=at(0)).meshes[shaped.mesh].positions
    np.testing.assert_allclose(morphed, 1.5 * rest, rtol=1e-6)  # the morph target equals the base shape


def test_animated_visibility(scene):
    g = Gltf()
    g.mesh()
    g.mesh()
    g.root["nodes"][1] |= {"extensions": {"KHR_node_visibility": {"visible": False}}}
    flags = {"input": g.array(np.float32([0, 1])), "output": g.array(np.uint8([0, 1])), "interpolation": "STEP"}
    pointer = {POINTER: {"pointer": "/nodes/1/extensions/KHR_node_visibility/visible"}}
    channel = {"sampler": 0, "target": {"path": "pointer", "extensions": pointer}}
    g.root["animations"] = [{"channels": [channel], "samplers": [flags]}]
    assert [len(scene("v.glb", g.glb(), moment=at(s)).instances) for s in (0, 0.75, 1, 2)] == [1, 1, 2, 2]
    g.root["scenes"][0]["nodes"] = [1]
    with pytest.raises(SceneError, match="has no surface at this frame"):
        scene("v.glb", g.glb(), moment=at(0.5))


def test_unsupported_channels_share_one_warning(scene):
    g = Gltf()
    g.material(name="a")
    g.mesh(material=0)
    g.node(matrix=np.eye(4).reshape(-1).tolist())
    nowhere = (
        "/materials/0/extras/mood", "/materials/7/alphaCutoff", "/materials/0/normalTexture/scale", "/nodes/0/weights/3",
        "/nodes/x/translation", "nonsense",
    )  # fmt: skip
    channels = [(p, "pointer", [0, 1], [0, 1], "LINEAR") for p in nowhere]
    clip(g, "odd", *channels, (1, "translation", [0, 1], [(0, 0, 0), (1, 1, 1)], "LINEAR"))
    description = scene("odd.glb", g.glb(), moment=at(1))
    told = [w for w in description.warnings if "Animated" in w]
    named = "/materials/0/extras/mood, /materials/7/alphaCutoff, /materials/0/normalTexture/scale, /nodes/x/translation, nonsense"
    assert told == [f"Animated properties that are missing or not supported stand still: {named}, /nodes/1/translation."]


def test_damaged_animations_cause_warnings(scene):
    def spoiled(change):
        g = arm()
        change(g, g.root["animations"][0]["samplers"][1])
        return g.glb()

    def fewer(g, sampler):
        sampler["output"] = g.array(np.zeros((5, 3), np.float32))

    def back(g, sampler):
        sampler["input"] = g.array(np.float32([1, 0]))

    def odd(g, sampler):
        sampler["interpolation"] = "WOBBLY"

    def beyond(g, sampler):
        sampler["output"] = 99

    for change, what, place in (
        (fewer, "has 5 values for 2 times", "samplers[1].output"),
        (back, "has times that do not ascend", "samplers[1].input"),
        (odd, "is 'WOBBLY'; known are STEP, LINEAR, CUBICSPLINE", "samplers[1].interpolation"),
        (beyond, "is 99; valid are 0 to 6", "samplers[1].output"),
    ):
        warnings = scene("arm.glb", spoiled(change)).warnings
        assert any("1 unusable part is left out" in w and what in w and place in w for w in warnings), warnings
