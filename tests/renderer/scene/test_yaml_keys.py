"""Tests of scene files with motion: any value may have keys, and its value at each time matches a computation by hand."""

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.scene.animation import Clip, Moment
from renderer.scene.load import Shot
from renderer.scene.readers.yaml import reader
from tests.renderer.scene.builders import Gltf, rotation_y, world

SHOT = """
name: a shot
fps: 10
settings: {width: 64, spp: 4}
cameras:
  - name: crane
    eye: {keys: [[0, [0, 1, 5]], [2, [4, 1, 5]]], curve: linear}
    target: [0, 0, 0]
    fov: {keys: [[1, 40], [3, 20]]}
environment:
  rotation: {keys: [[0, -90], [2, 90]]}
  sky: {sun_elevation: {keys: [[0, 0], [2, 40]], curve: smooth}, sun: {keys: [[0, true], [1, false]], curve: step}}
lights:
  - type: spot
    position: {keys: [[0, [0, 4, 0]], [1, [0, 8, 0]]]}
    target: [0, 0, 0]
    intensity: {keys: [[0, 1], [1, [3, 5, 7]]]}
materials:
  paint: {color: {keys: [[0, "#000000"], [2, "#ffffff"]]}, roughness: {keys: [[0, 0.2], [2, 0.8]], curve: [0.42, 0, 0.58, 1]}}
shapes:
  - type: quad
    material: paint
    transform:
      - scale: {keys: [[0, 1], [2, [1, 3, 1]]]}
      - rotate: {axis: y, degrees: {keys: [[0, 0], [2, 720]]}}
      - translate: {keys: [[0, [0, 0, 0]], [1, [1, 0, 0]], [2, [1, 1, 0]]]}
"""


def at(seconds):
    return Moment(10 * seconds)  # the file has 10 frames per second


def test_keyed_values_are_interpolated(scene):
    shot = scene("s.yaml", SHOT, moment=at(0.5))
    assert shot.cameras[0].view.eye == (1, 1, 5)
    assert shot.cameras[0].view.fov == 40
    assert shot.environment.rotation == -45
    u = 0.25
    assert shot.environment.sky.sun_elevation == pytest.approx(40 * (3 * u**2 - 2 * u**3))
    assert shot.environment.sky.sun
    assert shot.lights[0].position == (0, 6, 0)
    assert shot.lights[0].intensity == (2, 3, 4), "a number stands for as many"
    assert shot.materials[0].base_color == (0.25, 0.25, 0.25), "colours are mixed as light is"
    assert shot.materials[0].roughness == pytest.approx(0.2 + 0.6 * 0.12916, abs=1e-5)  # CSS's ease-in-out at 1/4
    expected = np.eye(4)
    expected[:3, 3] = (0.5, 0, 0)
    expected = expected @ rotation_y(180) @ np.diag([1, 1.5, 1, 1])
    np.testing.assert_allclose(shot.instances[0].transform, expected, atol=1e-12)
    assert (shot.fps, shot.clips, shot.moves) == (10, [Clip("a shot", 0, 3)], True)
    assert not scene("s.yaml", SHOT, moment=at(1)).environment.sky.sun


def test_frame_rate_of_the_file_is_the_default(scene):
    by_file, told = scene("s.yaml", SHOT, moment=Moment(5)), scene("s.yaml", SHOT, moment=Moment(10, fps=20))
    assert by_file.cameras[0].view == told.cameras[0].view
    assert scene("s.yaml", SHOT).cameras[0].view.eye == (0, 1, 5)


def test_shot_is_evaluated_at_each_moment(scene, tmp_path):
    scene("s.yaml", SHOT)
    shot = Shot(tmp_path, "s.yaml")
    assert [shot.scene_at(at(s)).cameras[0].view.eye[0] for s in (2, 0, 1)] == [4, 0, 2]


def test_keys_of_structured_values(scene):
    text = """
    cameras: [{keys: [[0, {eye: [0, 0, 5], target: [0, 0, 0]}], [1, {eye: [2, 0, 5], target: [1, 0, 0]}]]}]
    shapes:
      - type: cube
        transform: {keys: [[0, [{rotate: {axis: y, degrees: 0}}, {translate: [0, 0, 0]}]],
                           [1, [{rotate: {axis: y, degrees: 90}}, {translate: [0, 2, 0]}]]]}
      - {type: sphere, center: [0, {keys: [[0, 1], [1, 3]]}, 0], radius: 1}
    """
    shot = scene("s.yaml", text, moment=Moment(12))
    assert (shot.cameras[0].view.eye, shot.cameras[0].view.target) == ((1, 0, 5), (0.5, 0, 0))
    expected = rotation_y(45)
    expected[:3, 3] = (0, 1, 0)
    np.testing.assert_allclose(shot.instances[0].transform, expected, atol=1e-12)
    assert shot.spheres[0].center == (0, 2, 0)


def test_mesh_file_clips(scene):
    g = Gltf()
    g.mesh()
    times = g.array(np.float32([0, 1]))
    for name, end in (("walk", (1, 0, 0)), ("jump", (0, 4, 0))):
        samplers = [{"input": times, "output": g.array(np.float32([(0, 0, 0), end]))}]
        channels = [{"sampler": 0, "target": {"node": 0, "path": "translation"}}]
        g.root.setdefault("animations", []).append({"name": name, "samplers": samplers, "channels": channels})
    text = """
    fps: 4
    shapes:
      - {type: mesh, file: actor.glb, transform: [{translate: [0, 0, 9]}]}
      - {type: mesh, file: actor.glb, clip: jump}
      - {type: mesh, file: actor.glb, clip: 1}
    """
    shot = scene("s.yaml", text, {"actor.glb": g.glb()}, moment=Moment(2))
    places = [tuple(world(shot, i)[0, 0]) for i in range(3)]
    assert places == [(0.5, 0, 9), (0, 2, 0), (0, 2, 0)]
    assert shot.moves
    with pytest.raises(SceneError, match=r"actor\.glb has no clip 'swim'"):
        scene("s.yaml", text.replace("jump", "swim"), {"actor.glb": g.glb()})


def test_scene_without_keys_is_static(scene):
    shot = scene("s.yaml", "materials: {keys: {color: 0.5}}\nshapes: [{type: quad, material: keys}]", moment=Moment(9))
    assert (shot.moves, shot.clips, shot.fps) == (False, [], 24)
    with pytest.raises(SceneError, match="has no clips, as glTF files do"):
        scene("s.yaml", "shapes: [{type: quad}]", moment=Moment(0, clip="walk"))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("settings: {spp: {keys: [[0, 1]]}}", r"settings\.spp: has keys, but settings cannot be animated"),
        ("fps: -3", r"line 1: fps: fps is -3"),
        ("fps: fast", r"line 1: fps: is .fast.; possible: a number"),
        ("lights: [{type: point, position: {keys: []}}]", r"lights\[0\]\.position\.keys: has 0 keys"),
        ("lights: [{type: point, position: {keys: [[0, [0, 0, 0]], 7]}}]", r"lights\[0\]\.position\.keys\[1\]: is not a key"),
        ("lights: [{type: point, position: {keys: [[1, [0, 0, 0]], [1, [1, 0, 0]]]}}]", r"keys\[1\]: is not later than"),
        ("lights: [{type: point, position: {keys: [[0, [0, 0, 0]], [1, [1, 0]]]}}]", r"position: has keys of different forms"),
        (
            "lights: [{type: {keys: [[0, point], [1, spot]]}, position: [0, 0, 0]}]",
            r"lights\[0\]\.type: has keys of different forms, which cannot be interpolated",
        ),
        (
            "cameras: [{target: [1, 0, 0], eye: [0, 0, {keys: [[0, 1]], curve: bouncy}]}]",
            r"curve: is none of linear, step",
        ),
        (
            "cameras: [{target: [1, 0, 0], eye: [0, 0, {keys: [[0, 1]], curve: [2, 0, 0, 1]}]}]",
            r"cubic Bezier with x from 0 to 1",
        ),
        (
            "materials: {m: {roughness: {keys: [[0, 0], [1, 48]]}}}",
            r"line 1: materials\.m\.roughness: is 2\.0; it must be at most 1",
        ),
        (
            "cameras: [{eye: {keys: [[0, [0, 0, 1]]], curvy: 1}, target: [0, 0, 0]}]",
            r"cameras\[0\]\.eye: is .*; possible: a list",
        ),
    ],
)
def test_invalid_keys_are_reported_with_line(scene, text, sentence):
    with pytest.raises(SceneError, match=sentence):
        scene("s.yaml", f"{text}\nshapes: [{{type: quad}}]", moment=Moment(1))


def test_matrix_keys_with_large_rotation_are_rejected(scene):
    one, other = np.eye(4).tolist(), rotation_y(90).tolist()
    text = f"shapes: [{{type: quad, transform: [{{matrix: {{keys: [[0, {one}], [1, {other}]]}}}}]}}]"
    with pytest.raises(
        SceneError, match=r"shapes\[0\]\.transform\[0\]\.matrix: rotates too far between keys to interpolate matrices"
    ):
        scene("s.yaml", text)
    jumps = text.replace("]]}", "]], curve: step}")
    np.testing.assert_allclose(scene("s.yaml", jumps, moment=Moment(24)).instances[0].transform, rotation_y(90))
    with pytest.raises(SceneError, match="is beyond 1e"):
        scene("s.yaml", "shapes: [{type: quad, transform: [{rotate: {axis: y, degrees: 1e9}}]}]")


WAYS = """
cameras:
  - {name: tour, through: [front, side, top], seconds: 4}
  - {name: front, eye: [0, 0, 5], target: [0, 0, 0], fov: 30}
  - {name: side, eye: [5, 0, 0], target: [1, 0, 0], fov: 50}
  - {name: top, eye: [5, 4, 0], target: [1, 1, 0], fov: 40}
  - {name: statue, eye: [0, 1, 5], target: [0, 0, 0], turntable: 8}
shapes: [{type: cube}]
"""


def test_camera_path_and_turntable(scene):
    views = [[c.view for c in scene("s.yaml", WAYS, moment=Moment(24 * s)).cameras] for s in (0, 1, 2, 4, 9)]
    tour = [each[0] for each in views]
    assert tour[0] == views[0][1]
    assert tour[2] == views[0][2]
    assert tour[3] == tour[4] == views[0][3]
    assert tour[1].eye[2] == pytest.approx(2.5), "half of the way: z rests at both of its ends"
    assert tour[1].fov == pytest.approx(40), "and so does the angle, which is the widest at the side"
    np.testing.assert_allclose(views[2][4].eye, (5, 1, 0), atol=1e-12)
    described = scene("s.yaml", WAYS)
    assert (described.clips, described.moves) == ([Clip("s", 0, 8)], True)


@pytest.mark.parametrize(
    ("camera", "sentence"),
    [
        ("{through: [front], seconds: 1}", r"cameras\[1\]\.through: has 1 of at least 2 items"),
        (
            "{through: [front, back], seconds: 1}",
            r"through\[1\]: there is no camera back; the cameras are front",
        ),
        ("{name: me, through: [front, me], seconds: 1}", r"there is no camera me"),
        ("{through: [front, front]}", r"lacks seconds"),
        ("{through: [front, front], seconds: 1, eye: [0, 0, 0]}", r"cameras\[1\]\.eye: is not allowed here"),
        ("{eye: [0, 0, 9]}", r"lacks target"),
        ("{eye: [0, 0, 9], target: [0, 0, 0], seconds: 2}", r"cameras\[1\]\.seconds: is not allowed here"),
        ("{eye: [0, 0, 9], target: [0, 0, 0], turntable: 0}", r"turntable: is 0; it must be at least"),
    ],
)
def test_invalid_camera_move_is_an_error(scene, camera, sentence):
    with pytest.raises(SceneError, match=sentence):
        scene("s.yaml", f"cameras: [{{name: front, eye: [0, 0, 5], target: [0, 0, 0]}}, {camera}]\nshapes: [{{type: cube}}]")


def test_camera_path_needs_one_projection(scene):
    text = WAYS.replace("target: [1, 1, 0], fov: 40", "target: [1, 1, 0], projection: orthographic")
    with pytest.raises(
        SceneError, match=r"cameras\[0\]\.through: names cameras with different projections, which cannot be interpolated"
    ):
        scene("s.yaml", text)


def test_keyed_value_out_of_range_is_reported_with_line(tmp_path, monkeypatch):
    text = "\n".join(
        [
            "shapes:",
            *(f"  - {{type: sphere, center: [{i}, 0, 0], radius: 1}}" for i in range(5)),
            "  - {type: sphere, radius: {keys: [[0, 1], [1, -1]]}}",
            "  - {type: sphere, center: [9, 0, 0], radius: 1}",
        ]
    )
    (tmp_path / "s.yaml").write_text(text)
    looked_at = []
    validate = reader._validate
    monkeypatch.setattr(reader, "_validate", lambda *all: (looked_at.append(len(all[1]["shapes"])), validate(*all)))
    shot = Shot(tmp_path, "s.yaml")
    for seconds in (0, 0.25):
        assert shot.scene_at(Moment(24 * seconds)).spheres[5].radius == 1 - 2 * seconds
    with pytest.raises(SceneError, match=r"s\.yaml.* 7.*radius"):
        shot.scene_at(Moment(24))
    assert looked_at == [7, 1, 1], "what stands still is held to the schema once"
