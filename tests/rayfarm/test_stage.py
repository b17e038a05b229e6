"""Tests of a scene opened over time: every frame equals a compilation from scratch, bit by bit, in any order of frames."""

import numpy as np
import pytest

from rayfarm.stage import OpenScene
from renderer.arrays.scene import flat
from renderer.errors import SceneError
from renderer.scene import compile as compiling
from renderer.scene.animation import Moment
from renderer.scene.compile import compile_scene
from renderer.scene.load import Shot, read
from tests.grids import grid
from tests.renderer.builders import icosphere
from tests.renderer.scene.builders import Gltf, clip

ENDS = [0, 1]
TURN = [(0, 0, 0, 1), (0, 0.6, 0, 0.8)]


def ball(g, levels=2, offset=(0, 0, 0), **more):
    mesh = icosphere(levels)
    return g.mesh(mesh.positions + np.float32(offset), mesh.triangles.reshape(-1).astype(np.uint32), **more)


def animated_test_scene(shines=False, shows=False):
    """Builds an animated glTF scene with every kind of motion.

    It has a static ball, a rotating arm with a ball and a light, a morphing ball, a skinned ball, and a moving camera.
    shines: whether the ball on the arm emits light. shows: whether a further ball is visible at some times only.
    """
    g = Gltf()
    g.material()
    g.material(emissiveFactor=[1, 0.5, 0.25])
    ball(g, 3, (0, -3, 0), NORMAL=icosphere(3).positions)
    g.node(children=[2, 3], translation=[2, 0, 0])
    ball(g, 2, (1, 0, 0), material=int(shines))
    g.node(top=False, extensions={"KHR_lights_punctual": {"light": 0}})
    g.root["scenes"][0]["nodes"].remove(2)
    g.root["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 100}]}}
    ball(g, 2, (-3, 0, 0))
    g.root["meshes"][-1]["primitives"][0]["targets"] = [{"POSITION": g.array(icosphere(2).positions)}]
    count = len(icosphere(2).positions)
    more = {
        "JOINTS_0": g.array(np.zeros((count, 4), np.uint8)),
        "WEIGHTS_0": g.array(np.tile(np.float32([1, 0, 0, 0]), (count, 1))),
    }
    ball(g, 2, (0, 3, 0))
    g.root["meshes"][-1]["primitives"][0]["attributes"] |= more
    g.root["nodes"][-1]["skin"] = 0
    g.node(translation=[0.5, 0, 0])
    g.root["skins"] = [{"joints": [6]}]
    g.root["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}]
    g.node(camera=0, translation=[0, 0, 9])
    ball(g, 1, (0, 0, 3))
    channels = [
        (1, "rotation", ENDS, TURN, "LINEAR"),
        (4, "weights", ENDS, [0, 1], "LINEAR"),
        (6, "rotation", ENDS, TURN, "LINEAR"),
        (7, "translation", ENDS, [(0, 0, 9), (3, 0, 9)], "LINEAR"),
    ]
    if shows:
        visible = "/nodes/8/extensions/KHR_node_visibility/visible"
        channels.append((visible, "pointer", [0, 0.25, 0.5], np.uint8([1, 0, 1]), "STEP"))
    return clip(g, "all", *channels).glb()


YAML = b"""
lights: [{type: point, position: [0, 5, 0], intensity: {keys: [[0, 5], [1, 9]]}}]
environment: {color: [0.1, 0.2, 0.3]}
shapes:
  - {type: quad, transform: [{scale: 9}]}
  - {type: mesh, file: all.glb, transform: [{translate: [0, 4, 0]}]}
  - {type: group, transform: [{rotate: {axis: y, degrees: {keys: [[0, 0], [1, 90]]}}}],
     shapes: [{type: cube}, {type: sphere, center: [3, 1, 0]}]}
  - {type: sphere, center: [0, 2, -4]}
"""

# A scene with one file per frame, of different sizes, a static lamp and sphere, and a blinking lamp.
NUMBERED = b"""
materials: {lamp: {emission: 3}, blinker: {emission: {keys: [[0, 0], [0.4, 2]], curve: step}}}
shapes:
  - {type: quad, material: lamp, transform: [{translate: [0, 9, 0]}]}
  - {type: cube, material: blinker, transform: [{translate: [4, 0, 0]}]}
  - {type: mesh, file: "blob.##.obj"}
  - {type: sphere, center: [0, 2, -4]}
"""


def obj_file(triangles):
    """Returns an OBJ file with `triangles` triangles."""
    corners = np.random.default_rng(triangles).random((3 * triangles, 3))
    lines = [f"v {x:g} {y:g} {z:g}" for x, y, z in corners]
    return "\n".join(lines + [f"f {3 * i + 1} {3 * i + 2} {3 * i + 3}" for i in range(triangles)]).encode()


SHOTS = {
    "all.glb": animated_test_scene(),
    "lamp.glb": animated_test_scene(shines=True),
    "blink.glb": animated_test_scene(shows=True),
    "all.yaml": YAML,
    "numbered.yaml": NUMBERED,
}
NAMES = [name if name in ("all.glb", "numbered.yaml") else pytest.param(name, marks=pytest.mark.long) for name in SHOTS]


@pytest.fixture
def folder(tmp_path):
    for name, data in SHOTS.items():
        (tmp_path / name).write_bytes(data)
    for frame in range(25):
        (tmp_path / f"blob.{frame:02}.obj").write_bytes(obj_file(1 + 400 * (5 * frame % 13)))
    return tmp_path


@grid("name", NAMES, ordinary=("all.glb",))
def test_every_moment_equals_fresh_compilation(folder, name):
    stage = OpenScene(Shot(folder, name), threads=1)
    seen = set()
    for frame in (5, 0, 9, 17, 9, 24, 0.5):
        compiled, summary = stage.scene_at(Moment(frame))
        alone = compile_scene(read(folder, name, moment=Moment(frame)), threads=1)
        for (part, ours), theirs in zip(flat(compiled).items(), flat(alone).values(), strict=True):
            np.testing.assert_array_equal(ours, theirs, err_msg=f"{part} of frame {frame}")
        np.testing.assert_allclose(summary["bounds"], alone.bounds)
        seen.add(flat(compiled)["bvh.node"].tobytes())
    assert len(seen) == (5 if name == "numbered.yaml" else 6)  # between frames, the previous file is used


@grid("name", NAMES, ordinary=("numbered.yaml",))
def test_open_shutter_equals_fresh_compilation(folder, name):
    asked = {"shutter": 0.5}
    stage = OpenScene(Shot(folder, name), threads=1, shutter=asked)
    for frame in (5, 0, 9, 9, 0.5):
        compiled, summary = stage.scene_at(Moment(frame))
        description = Shot(folder, name).over_shutter(Moment(frame), asked)
        alone = compile_scene(description, threads=1)
        for (part, ours), theirs in zip(flat(compiled).items(), flat(alone).values(), strict=True):
            np.testing.assert_array_equal(ours, theirs, err_msg=f"{part} of frame {frame}")
        if name != "numbered.yaml":  # its files have different meshes
            assert len(compiled.bvh.motion) > 0 or name == "lamp.glb"
            assert len(compiled.key_position) > 0
        assert [("views" in camera) for camera in summary["cameras"]] == [bool(c.keys) for c in description.cameras] + [False]


@pytest.mark.long
@grid("name", NAMES, ordinary=("all.glb",))
def test_between_neighbours_does_not_change_later_frames(folder, name):
    stage = OpenScene(Shot(folder, name), threads=1)
    for frame in (5, 6):
        between, summary = stage.between_neighbours(Moment(frame))
        alone = compile_scene(Shot(folder, name).between_frames(Moment(frame)), threads=1)
        for (part, ours), theirs in zip(flat(between).items(), flat(alone).values(), strict=True):
            np.testing.assert_array_equal(ours, theirs, err_msg=f"{part} between {frame}")
        if name.endswith(".glb"):
            eyes = [stage.scene_at(Moment(frame + k))[1]["cameras"][0]["view"]["eye"] for k in (-1, 0, 1)]
            assert [view["eye"] for view in summary["cameras"][0]["views"]] == eyes
        compiled, _ = stage.scene_at(Moment(frame))
        alone = compile_scene(read(folder, name, moment=Moment(frame)), threads=1)
        for (part, ours), theirs in zip(flat(compiled).items(), flat(alone).values(), strict=True):
            np.testing.assert_array_equal(ours, theirs, err_msg=f"{part} of frame {frame}")


def test_neighbour_without_surfaces_gives_no_motion(tmp_path):
    g = Gltf()
    ball(g)
    visible = "/nodes/0/extensions/KHR_node_visibility/visible"
    (tmp_path / "gone.glb").write_bytes(clip(g, "go", (visible, "pointer", [0, 1], np.uint8([1, 0]), "STEP")).glb())
    shot = Shot(tmp_path, "gone.glb")
    with pytest.raises(SceneError, match="has no surface"):
        shot.scene_at(Moment(24))
    assert shot.between_frames(Moment(23)).keys == 0


@pytest.mark.long
def test_static_parts_are_compiled_once(folder, monkeypatch):
    made = []
    for name in ("build_static", "build_bodies", "pack"):
        known = getattr(__import__("renderer.scene.placed_bodies", fromlist=[name]), name)
        monkeypatch.setattr(
            f"renderer.scene.placed_bodies.{name}", lambda *args, name=name, known=known: made.append(name) or known(*args)
        )
    for name in ("all.glb", "all.yaml"):
        made.clear()
        stage = OpenScene(Shot(folder, name), threads=1)
        for frame in range(5):
            stage.scene_at(Moment(frame))
        assert sorted(made) == ["build_bodies", "build_static", "pack"], name


def test_camera_motion_needs_no_compilation(tmp_path, monkeypatch):
    g = Gltf()
    ball(g)
    g.root["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}]
    g.node(camera=0, translation=[0, 0, 9])
    (tmp_path / "fly.glb").write_bytes(clip(g, "fly", (1, "translation", ENDS, [(0, 0, 9), (3, 0, 9)], "LINEAR")).glb())
    calls = []
    known = compiling.compile_scene
    monkeypatch.setattr(compiling, "compile_scene", lambda *args, **more: calls.append(1) or known(*args, **more))
    stage = OpenScene(Shot(tmp_path, "fly.glb"), threads=1)
    eyes = [stage.scene_at(Moment(frame))[1]["cameras"][0]["view"]["eye"][0] for frame in (0, 8, 16)]
    np.testing.assert_allclose(eyes, [0, 1, 2], atol=1e-6)
    assert len(calls) == 1


@pytest.mark.long
def test_automatic_camera_frames_scene_at_start(folder):
    late, soon = OpenScene(Shot(folder, "all.yaml"), threads=1), OpenScene(Shot(folder, "all.yaml"), threads=1)
    first = soon.scene_at(Moment(0))[1]["cameras"][-1]
    assert late.scene_at(Moment(20))[1]["cameras"][-1] == first
    assert soon.scene_at(Moment(20))[1]["cameras"][-1] == first
