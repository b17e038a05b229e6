"""Tests of FBX files: one from Blender, against values that Blender computed, and text files as other programs write them."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.scene.animation import Moment
from renderer.scene.load import Shot
from tests.renderer.scene.fbx_text import fbx, light, material, node, stack, texture

KIT = Path(__file__).parents[2] / "data" / "fbx"
Y_UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # from Blender's axes


@pytest.fixture(scope="module")
def kit():
    """Returns by frame (values of the objects as computed by Blender, the scene that we read from Blender's FBX file)."""
    shot = Shot(KIT, "kit.fbx")
    said = json.loads((KIT / "kit.json").read_text())
    return {int(frame): (objects, shot.scene_at(Moment(float(frame)))) for frame, objects in said.items()}


def in_world(description, name):
    """Returns the world-space vertices (V, 3) and the number of triangles of all instances with this name."""
    points, triangles = [], 0
    for instance in description.instances:
        if instance.name == name:
            mesh = description.meshes[instance.mesh]
            points.append(mesh.positions @ instance.transform[:3, :3].T + instance.transform[:3, 3])
            triangles += len(mesh.triangles)
    return np.concatenate(points), triangles


def test_fbx_vertices_match_blender(kit):
    compared = 0
    for objects, description in kit.values():
        for name, said in objects.items():
            if said["type"] == "MESH":
                points, triangles = in_world(description, name)
                wanted = np.array(said["vertices"]) @ Y_UP.T
                far = np.linalg.norm(wanted[:, None] - points[None], axis=2)
                assert far.min(axis=1).max() < 2e-6 * 10, name
                assert far.min(axis=0).max() < 2e-6 * 10, name
                assert triangles == said["triangles"]
                compared += 1
    assert compared == 3 * 7


def test_fbx_normals_are_on_the_front_side(kit):
    for _, description in kit.values():
        for mesh in description.meshes:
            a, b, c = (mesh.positions[mesh.triangles[:, k]].astype(float) for k in range(3))
            faces = np.cross(b - a, c - a)
            along = np.einsum("ij,ij->i", faces, mesh.normals[mesh.triangles].mean(axis=1))
            size = np.linalg.norm(faces, axis=1)
            assert (along > 0.2 * size)[size > 1e-6 * size.max()].all(), mesh.name  # ignores slivers from collinear corners


def test_fbx_cameras_and_lights_match_blender(kit):
    for objects, description in kit.values():
        for seen in description.cameras:
            matrix = np.array(objects[seen.name]["matrix"])
            sight = np.array(seen.view.target) - seen.view.eye
            np.testing.assert_allclose(seen.view.eye, Y_UP @ matrix[:3, 3], atol=1e-5)
            np.testing.assert_allclose(sight / np.linalg.norm(sight), -Y_UP @ matrix[:3, 2], atol=1e-5)
            np.testing.assert_allclose(seen.view.up, Y_UP @ matrix[:3, 1], atol=1e-5)
        for found in description.lights:
            matrix = np.array(objects[found.name]["matrix"])
            if found.kind != "directional":
                np.testing.assert_allclose(found.position, Y_UP @ matrix[:3, 3], atol=1e-5)
            np.testing.assert_allclose(found.direction, -Y_UP @ matrix[:3, 2], atol=1e-5)
    main, plan = (next(c.view for c in kit[0][1].cameras if c.name == n) for n in ("main", "plan"))
    assert main.fov == pytest.approx(math.degrees(2 * math.atan(18 * 360 / 640 / 35)), abs=1e-4)
    assert (plan.projection, plan.height) == ("orthographic", pytest.approx(9 * 360 / 640))
    power = {found.name: found for found in kit[0][1].lights}
    assert power["point"].intensity == pytest.approx([500 * c / (4 * math.pi) for c in (1, 0.9, 0.8)])
    assert power["sun"].intensity == pytest.approx([2.5, 2.5, 2.25])
    edge = math.cos(math.radians(25))
    assert math.cos(math.radians(power["spot"].inner_cone)) == pytest.approx(edge + (1 - edge) * 0.3)  # Blender's blend is 0.3
    assert (power["spot"].outer_cone, power["spot"].falloff) == (pytest.approx(25), "smooth")


def test_fbx_area_light_power_matches_blender(kit):
    _, description = kit[0]
    instance = next(i for i in description.instances if i.name == "area")
    x, y = instance.transform[:3, 0], instance.transform[:3, 1]
    area = 4 * np.linalg.norm(np.cross(x, y))
    material = description.materials[description.meshes[instance.mesh].material]
    assert material.lamp
    assert material.unseen  # as Blender's default
    emission = material.emission
    assert area == pytest.approx(1)
    assert np.pi * area * emission[0] == pytest.approx(300)


def test_fbx_materials_match_blender(kit):
    found = {m.name: m for m in kit[0][1].materials}
    assert found["red"].base_color == pytest.approx((0.8, 0.1, 0.05))
    assert (found["red"].roughness, found["red"].metallic) == pytest.approx((0.35, 0))
    assert (found["gold"].roughness, found["gold"].metallic) == pytest.approx((0.2, 1))
    assert found["glow"].emission == pytest.approx((0.6, 1.5, 3))
    assert (found["pane"].opacity, found["pane"].alpha_mode) == (pytest.approx(0.4), "blend")
    description = kit[0][1]
    image = description.images[description.textures[found["checked"].base_color_texture].image]
    assert image.pixels.shape == (4, 4, 4)
    assert image.pixels[-1, 0, 0] < 10 < 245 < image.pixels[-1, 1, 0]  # the image is inside the file, and upright


def test_fbx_moving_objects_are_detected(kit):
    _, description = kit[0]
    assert [(clip.start, clip.end) for clip in description.clips] == [(0, 0.5)]
    assert description.moves
    assert description.fps == 24
    assert {i.name for i in description.instances if i.moves} == {"cube", "ball", "grid", "tube"}
    assert {m.name for m in description.meshes if m.deforms} == {"Grid", "Cylinder"}


def test_fbx_skin_moves_while_the_shutter_is_open():
    over = Shot(KIT, "kit.fbx").over_shutter(Moment(5), {"shutter": 0.5})
    assert over.keys >= 2
    assert len(next(m for m in over.meshes if m.name == "Cylinder").keys) == over.keys


@pytest.mark.parametrize(("unit", "z_up", "corner"), [(1.0, False, (0, 1, 0)), (2.54, True, (0, 0, -2.54))])
def test_units_and_axes(scene, unit, z_up, corner):
    description = scene("a.fbx", fbx("", [], unit=unit, z_up=z_up))
    points, _ = in_world(description, "tri")
    assert np.abs(points - corner).sum(axis=1).min() < 1e-6


def test_light_power_of_other_exporters(scene):
    lamps = node(50, "fading", "Light", Lcl_Translation=(0, 300, 0)) + node(51, "even", "Light", Lcl_Translation=(0, 300, 0))
    lamps += light(60, Intensity=200.0, Color=(1.0, 0.5, 0.25), DecayType=2) + light(61, Intensity=100.0, DecayType=0)
    description = scene("a.fbx", fbx(lamps, [(60, 50), (50, 0), (61, 51), (51, 0)]))
    fading, even = description.lights
    assert fading.intensity == pytest.approx([2 * math.pi * 0.01**2 * c for c in (1, 0.5, 0.25)])
    middle = np.array([0.5, 0.5, 0])
    assert even.intensity[0] == pytest.approx(math.pi * np.sum((np.array([0, 3, 0]) - middle) ** 2))
    assert any("1 lights without falloff" in w for w in description.warnings)


def test_blender_texture_transform_matches_its_mapping_node(scene, png):
    """Textures are rotated as by Blender's mapping nodes, although its exporter writes radians where FBX has degrees.

    Expected values are those of Blender's glTF exporter for the same node.
    """
    turned = {"Translation": (0.1, 0.25, 0.0), "Rotation": (0.0, 0.0, -math.radians(30)), "Scaling": (1 / 2, 1 / 3, 1.0)}
    text = fbx(material(30, "p") + texture(40, "a.png", **turned), [(30, 20), (40, 30, "DiffuseColor")])
    creator = "Blender (stable FBX IO) - 4.5.15 LTS - 5.13.1"
    texts = text, text.replace("FBX SDK/FBX Plugins version 2020.3", creator)
    others, blenders = (scene("a.fbx", each, {"a.png": png(255, 0, 0)}).textures[0].transform for each in texts)
    assert blenders == pytest.approx((1.7321, 1.5, -1.4, -1.0, 2.5981, -1.8481), abs=1e-4)
    turn = math.radians(math.radians(30))
    assert others[:2] == pytest.approx((2 * math.cos(turn), 2 * math.sin(turn)))


def test_hidden_nodes_are_omitted_and_counted(scene):
    objects = node(21, "off", Visibility=0.0) + node(22, "below")
    description = scene("a.fbx", fbx(objects, [(10, 21), (21, 0), (10, 22), (22, 21)]))
    assert {i.name for i in description.instances} == {"tri"}
    assert any("1 hidden nodes" in w for w in description.warnings)


@pytest.mark.parametrize("data", [b"", b"Kaydara FBX Binary  \x00\x1a\x00", b"hello", b"; FBX 7.5.0 project file\nObjects: {"])
def test_non_fbx_data_is_an_error_message(scene, data):
    with pytest.raises(SceneError, match=r"a\.fbx[: ]"):
        scene("a.fbx", data)


def test_damaged_fbx_is_read_or_rejected(tmp_path):
    data = np.frombuffer((KIT / "kit.fbx").read_bytes(), np.uint8)
    rng = np.random.default_rng(5)
    told = 0
    for i in range(60):
        damaged = data.copy()
        at = rng.integers(len(damaged), size=rng.integers(1, 40))
        damaged[at] = rng.integers(256, size=len(at))
        if i % 3 == 0:
            damaged = damaged[: rng.integers(len(damaged))]
        (tmp_path / "a.fbx").write_bytes(damaged.tobytes())
        try:
            description = Shot(tmp_path, "a.fbx").scene_at(Moment(3))
        except SceneError as error:
            told += 1
            assert str(error).startswith(("a.fbx: ", "a.fbx "))
            assert "could not be read as" not in str(error)
        else:
            assert all(np.isfinite(i.transform).all() for i in description.instances)
            assert all(m.triangles.max(initial=-1) < len(m.positions) for m in description.meshes)
    assert 0 < told < 60


def test_first_moving_animation_stack_is_used(scene):
    """Of several animation stacks the first with motion is used, as in Blender, and a warning names the others.

    Files of Mixamo and 3ds Max begin with a take in which nothing moves.
    """
    parts = stack(100, "Take 001"), stack(110, "walk", 240), stack(120, "run", 480)
    text = fbx("".join(objects for objects, _ in parts), [link for _, links in parts for link in links])

    def far(clip=None):
        description = scene("a.fbx", text, moment=Moment(12, 24, clip))
        return description.instances[0].transform[0, 3], description

    shown, description = far()
    assert shown == pytest.approx(1.2)
    assert [clip.name for clip in description.clips] == ["walk", "run", "Take 001"]
    assert [w for w in description.warnings if "clip" in w] == ["a.fbx shows the animation 'walk'. Other clips: run, Take 001."]
    still, description = far("run")
    assert still == pytest.approx(2.4)
    assert not any("clip" in w for w in description.warnings)
    assert far("Take 001")[0] == 0


def test_animation_stacks_are_combined(scene):
    """Stacks that move different nodes are combined, for exporters that write one take per object."""
    (first, links), (second, more) = stack(100, "walk", 240), stack(110, "turn", 120)
    more = [(a, 21 if b == 20 else b, *rest) for a, b, *rest in more]
    text = fbx(node(21, "other") + first + second, [(10, 21), (21, 0), *links, *more])
    for clip, expected in ((None, [1.2, 0]), ("turn", [0, 0.6]), ("all", [1.2, 0.6])):
        for _ in range(2):
            description = scene("a.fbx", text, moment=Moment(12, 24, clip))
            places = {each.name: each.transform[0, 3] for each in description.instances}
            assert [places["tri"], places["other"]] == pytest.approx(expected)


def _turn(axis, degrees):
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    found = np.eye(4)
    found[i, i], found[i, j], found[j, i], found[j, j] = c, -s, s, c
    return found


def _euler(angles, order="xyz"):
    """Returns the rotation matrix of Euler angles; the order's first axis rotates first."""
    found = np.eye(4)
    for axis in order:
        found = _turn("xyz".index(axis), angles["xyz".index(axis)]) @ found
    return found


def _moved(vector):
    found = np.eye(4)
    found[:3, 3] = vector
    return found


def test_fbx_pivots_and_transforms_match_autodesk(scene):
    """Pivots, offsets, rotation orders and geometric transforms follow Autodesk's definition, also with negative scales.

    From the FBX SDK's help, "Computing transformation matrices": T Roff Rp Rpre R Rpost^-1 Rp^-1 Soff Sp S Sp^-1, applied after
    the geometric transform.
    """
    rng = np.random.default_rng(8)
    orders = ["xyz", "xzy", "yzx", "yxz", "zxy", "zyx"]
    for number, order in enumerate(orders):

        def three(low, high):
            return tuple(float(v) for v in rng.uniform(low, high, 3).round(4))

        said = {
            "RotationOrder": number,
            "RotationActive": True,
            "Lcl Translation": three(-50, 50),
            "Lcl Rotation": three(-180, 180),
            "Lcl Scaling": tuple(v if i else -v for i, v in enumerate(three(0.5, 2))),
            "RotationOffset": three(-9, 9),
            "RotationPivot": three(-9, 9),
            "PreRotation": three(-90, 90),
            "PostRotation": three(-90, 90),
            "ScalingOffset": three(-9, 9),
            "ScalingPivot": three(-9, 9),
            "GeometricTranslation": three(-9, 9),
            "GeometricRotation": three(-90, 90),
            "GeometricScaling": three(0.5, 2),
        }
        text = fbx("", []).replace(node(20, "tri"), node(20, "tri", **said))
        found = scene("a.fbx", text)
        (shown,) = found.instances
        place = (
            _moved(said["Lcl Translation"]) @ _moved(said["RotationOffset"]) @ _moved(said["RotationPivot"])
            @ _euler(said["PreRotation"]) @ _euler(said["Lcl Rotation"], order) @ np.linalg.inv(_euler(said["PostRotation"]))
            @ np.linalg.inv(_moved(said["RotationPivot"])) @ _moved(said["ScalingOffset"]) @ _moved(said["ScalingPivot"])
            @ np.diag([*said["Lcl Scaling"], 1]) @ np.linalg.inv(_moved(said["ScalingPivot"]))
            @ _moved(said["GeometricTranslation"]) @ _euler(said["GeometricRotation"]) @ np.diag([*said["GeometricScaling"], 1])
        )  # fmt: skip
        corners = np.array([[0, 0, 0, 1], [100, 0, 0, 1], [0, 100, 0, 1]]) @ place.T
        points = found.meshes[shown.mesh].positions @ shown.transform[:3, :3].T + shown.transform[:3, 3]
        np.testing.assert_allclose(points, corners[:, :3] / 100, atol=1e-5, err_msg=order)
