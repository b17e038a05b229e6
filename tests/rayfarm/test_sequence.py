"""Tests of `rayfarm render --frames`: frames equal single pictures, existing files are kept, failed frames stop no others."""

from __future__ import annotations

import json
from pathlib import Path

import av
import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from PIL import Image

from rayfarm.options import Env
from rayfarm.reading import _load_compiled_scene, open_stage
from renderer.arrays.scene import flat
from renderer.denoise import is_available
from renderer.scene.animation import Moment
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from tests.grids import grid
from tests.rayfarm.program import rayfarm
from tests.renderer.scene.builders import TRIANGLE, Gltf

SMALL = ["--size=24x16", "--spp=2", "--env=1,1,1"]


def animated_scene(camera_alone: bool = False) -> Gltf:
    """Builds a file in which a large triangle, or only the camera, moves to the right within a second, above a static floor."""
    g = Gltf()
    g.mesh(np.float32([(-5, -1, -5), (5, -1, -5), (0, -1, 5)]))
    g.mesh(TRIANGLE)
    g.root["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}]
    g.node(camera=0, translation=[0, 0, 5])
    from_z = 5 if camera_alone else 0
    samplers = [{"input": g.array(np.float32([0, 1])), "output": g.array(np.float32([(0, 0, from_z), (2, 0, from_z)]))}]
    target = {"node": 2 if camera_alone else 1, "path": "translation"}
    g.root["animations"] = [{"name": "go", "samplers": samplers, "channels": [{"sampler": 0, "target": target}]}]
    return g


@pytest.fixture
def shot(tmp_path: Path) -> Path:
    path = tmp_path / "shot.glb"
    path.write_bytes(animated_scene().glb())
    return path


def layers_of(path: Path) -> dict[str, np.ndarray]:
    """Returns an EXR's channels, (h, w) each."""
    picture = oiio.ImageBuf(str(path))
    found = picture.get_pixels(oiio.FLOAT)
    return {name: found[..., i] for i, name in enumerate(picture.spec().channelnames)}


def pixels(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image).copy()


def test_each_frame_equals_single_picture(shot: Path, tmp_path: Path) -> None:
    done = rayfarm("render", shot, "-o", tmp_path / "out.###.png", "--frames", "0-24x12,6.5", *SMALL)
    assert done.returncode == 0, done.stderr
    names = {0: "out.000.png", 12: "out.012.png", 24: "out.024.png", 6.5: "out.006.5.png"}
    pictures = {}
    for frame, name in names.items():
        assert rayfarm("render", shot, "-o", tmp_path / "still.png", f"--frame={frame}", *SMALL).returncode == 0
        pictures[frame] = pixels(tmp_path / name)
        assert np.array_equal(pictures[frame], pixels(tmp_path / "still.png"))
    assert len({picture.tobytes() for picture in pictures.values()}) == 4
    assert rayfarm("render", shot, "-o", tmp_path / "plain.png", *SMALL).returncode == 0
    assert np.array_equal(pixels(tmp_path / "plain.png"), pictures[0])
    slow = rayfarm("render", shot, "-o", tmp_path / "slow.#.png", "--frames", "24", "--fps", "48", *SMALL)
    assert slow.returncode == 0
    assert np.array_equal(pixels(tmp_path / "slow.24.png"), pictures[12])


def test_sequence_continues_where_it_stopped(shot: Path, tmp_path: Path) -> None:
    common = ["render", shot, "-o", tmp_path / "out.#.png", "--frames", "0-3", *SMALL]
    assert rayfarm(*common).returncode == 0
    whole = pixels(tmp_path / "out.2.png")
    (tmp_path / "out.2.png").unlink()
    (tmp_path / "out.3.png").write_bytes(b"")  # as left by a full disk
    (tmp_path / ".out.1.png.x7").write_bytes(b"half")  # as left by a killed process
    (tmp_path / "out.0.png").write_bytes(b"kept")
    done = rayfarm(*common, "--stats", tmp_path / "stats.json")
    assert done.returncode == 0
    assert "2 of 4 frames are there and kept" in done.stderr
    assert (tmp_path / "out.0.png").read_bytes() == b"kept"
    assert np.array_equal(pixels(tmp_path / "out.2.png"), whole)
    assert pixels(tmp_path / "out.3.png").shape == whole.shape
    stats = json.loads((tmp_path / "stats.json").read_text())
    assert [each["frame"] for each in stats["frames"]] == [2, 3]
    assert (stats["kept"], stats["failed"]) == (2, {})
    assert rayfarm(*common, "--overwrite").returncode == 0
    assert pixels(tmp_path / "out.0.png").shape == whole.shape


def test_failed_frame_is_named_and_others_are_rendered(shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from rayfarm.reading import ConfinedScene
    from renderer.errors import SceneError

    whole = ConfinedScene.scene_at

    def at(self: ConfinedScene, moment: Moment) -> object:
        if moment.frame in (1, 2):
            raise SceneError("smoke.0001.obj is not among the scene's files; add it")
        return whole(self, moment)

    monkeypatch.setattr(ConfinedScene, "scene_at", at)
    common = ["render", shot, "-o", tmp_path / "out.#.png", *SMALL]
    done = rayfarm(*common, "--frames", "0-3", "--stats", tmp_path / "stats.json")
    assert done.returncode == 1
    assert done.stderr.count("smoke.0001.obj is not among the scene's files; add it") == 1
    assert "2 of 4 frames failed: 1-2" in done.stderr
    assert sorted(path.name for path in tmp_path.glob("out.*")) == ["out.0.png", "out.3.png"]
    assert list(json.loads((tmp_path / "stats.json").read_text())["failed"]) == ["1", "2"]
    monkeypatch.undo()
    healed = rayfarm(*common, "--frames", "0-3")
    assert healed.returncode == 0
    assert "2 of 4 frames are there" in healed.stderr


def test_ctrl_c_prints_how_to_continue(shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("rayfarm.sequence.render_to", interrupted)
    done = rayfarm("render", shot, "-o", tmp_path / "out.#.png", "--frames", "0-3", *SMALL)
    assert done.returncode == 130
    assert "Stopped after 0 of 4 frames. The same command goes on from here." in done.stderr


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--frames", "3-"], "frames is '3-'; give numbers and ranges such as 0-99 or 1-250x5,300"),
        (["--frames", "9-3"], "the range 9-3 ends before it begins"),
        (["--frames", "0-3", "-o", "out.png"], "there are 4 frames. Write #### for their numbers: -o out.####.png"),
        (["--frames", "0-3", "--frame", "1"], "--frame and --frames were both given"),
        (["--frames", "0-3", "--pixel", "1,1"], "select it by --frame"),
        (["--frame", "0.25"], "it must be from 0 to"),
        (["--frame", "1", "--fps", "0"], "fps is 0"),
        (["--frame", "1", "--overwrite"], "--overwrite needs --frames"),
        (["--frames", "0-1", "--camera", "7"], "camera is number 7"),
        (["--frames", "0-1", "--clip", "swim"], "has no clip 'swim'; its clips are 0: go"),
        (["--frames", "0-1", "-o", "missing/out.#.png"], "There is no folder"),
    ],
)
def test_invalid_combinations_give_error(shot: Path, tmp_path: Path, options: list[str], sentence: str) -> None:
    written = [] if "-o" in options else ["-o", str(tmp_path / "out.#.png")]
    done = rayfarm("render", shot, *written, *options, *SMALL)
    assert done.returncode == 1
    assert sentence in done.stderr
    assert "Traceback" not in done.stderr


def test_only_moved_parts_are_compiled_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    built = []
    monkeypatch.setattr("rayfarm.reading._load_compiled_scene", lambda *a: (built.append(1), _load_compiled_scene(*a))[1])
    for name, g, times in (("camera.glb", animated_scene(camera_alone=True), 1), ("body.glb", animated_scene(), 3)):
        (tmp_path / name).write_bytes(g.glb())
        built.clear()
        with open_stage(tmp_path / name, Env()) as stage:
            for frame in (0, 12, 24):
                compiled, summary = stage.scene_at(Moment(frame))
                alone = compile_scene(read(tmp_path, name, moment=Moment(frame)))
                for key, array in flat(alone).items():
                    assert flat(compiled)[key].tobytes() == array.tobytes(), key
                x = summary["cameras"][0]["view"]["eye"][0]
                assert x == pytest.approx(2 * frame / 24 if name == "camera.glb" else 0)
        assert len(built) == times


def test_automatic_camera_does_not_follow_motion(tmp_path: Path) -> None:
    g = animated_scene()
    del g.root["nodes"][2]["camera"]
    (tmp_path / "bare.glb").write_bytes(g.glb())
    with open_stage(tmp_path / "bare.glb", Env()) as stage:
        start, later = (stage.scene_at(Moment(frame))[1]["cameras"][-1] for frame in (0, 18))
    with open_stage(tmp_path / "bare.glb", Env()) as stage:
        alone = stage.scene_at(Moment(18))[1]["cameras"][-1]
    assert start == later == alone


@pytest.mark.long
@pytest.mark.parametrize("camera_alone", [False, True])
def test_motion_vectors_do_not_change_picture(tmp_path: Path, camera_alone: bool) -> None:
    """Motion vectors are stored as layers of the EXR file, and its colours equal those of a picture without motion vectors.

    Either the triangle or the camera moves by 2 units per second, at a distance of 5 units.
    """
    path = tmp_path / "shot.glb"
    path.write_bytes(animated_scene(camera_alone).glb())
    asked = ["--frames", "0-1", "--aov=depth,motion", *SMALL]
    done = rayfarm("render", path, "-o", tmp_path / "out.#.exr", *asked)
    assert done.returncode == 0, done.stderr
    step = (2 / 24) / 5 / (2 * np.tan(0.4)) * 16  # pixels per frame
    for frame in (0, 1):
        still = tmp_path / "still.exr"
        assert rayfarm("render", path, "-o", still, f"--frame={frame}", "--aov=motion", *SMALL).returncode == 0
        assert rayfarm("render", path, "-o", tmp_path / "plain.exr", f"--frame={frame}", *SMALL).returncode == 0
        layers, alone, plain = (layers_of(name) for name in (tmp_path / f"out.{frame}.exr", still, tmp_path / "plain.exr"))
        assert [name for name in layers if name.startswith("Vector")] == ["Vector.X", "Vector.Y", "Vector.Z", "Vector.W"]
        for name in ("R", "G", "B"):
            np.testing.assert_array_equal(layers[name], plain[name])
        middle = 7, 12  # a pixel that sees the triangle
        seen = [float(layers[f"Vector.{axis}"][middle]) for axis in "XYZW"]
        assert seen == [float(alone[f"Vector.{axis}"][middle]) for axis in "XYZW"]
        way = step if camera_alone else -step
        np.testing.assert_allclose(seen, [0 if frame == 0 else way, 0, way, 0], atol=1e-4)
        if not camera_alone:
            assert not layers["Vector.Z"][-1].any(), "the floor keeps still"


@pytest.mark.long
@pytest.mark.skipif(not is_available(), reason="Open Image Denoise is not installed")
def test_temporal_denoising_is_independent_of_existing_files(shot: Path, tmp_path: Path) -> None:
    asked = ["--frames", "0-3", "--denoise", *SMALL]
    assert rayfarm("render", shot, "-o", tmp_path / "a.#.exr", *asked).returncode == 0
    whole = {frame: layers_of(tmp_path / f"a.{frame}-denoised.exr")["R"] for frame in range(4)}
    (tmp_path / "a.1-denoised.exr").unlink()
    raw = (tmp_path / "a.0.exr").read_bytes()
    done = rayfarm("render", shot, "-o", tmp_path / "a.#.exr", *asked)
    assert "3 of 4 frames are there" in done.stderr
    np.testing.assert_array_equal(layers_of(tmp_path / "a.1-denoised.exr")["R"], whole[1])
    assert (tmp_path / "a.0.exr").read_bytes() == raw
    assert rayfarm("render", shot, "-o", tmp_path / "b.#.exr", "--frames", "1", "--denoise", *SMALL).returncode == 0
    alone = layers_of(tmp_path / "b.1-denoised.exr")["R"]
    assert np.abs(alone - whole[1]).max() > 0, "its neighbours count"
    assert np.abs(alone - whole[1]).mean() < 0.05 * alone.mean()


def test_turntable_rotates_once_without_recompilation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    built = []
    monkeypatch.setattr("rayfarm.reading._load_compiled_scene", lambda *a: (built.append(1), _load_compiled_scene(*a))[1])
    (tmp_path / "s.yaml").write_text("fps: 10\nshapes: [{type: cube, transform: [{rotate: {axis: y, degrees: 20}}]}]")
    done = rayfarm("render", tmp_path / "s.yaml", "-o", tmp_path / "out.##.png", "--frames", "0-20x5", "--turntable", "2", *SMALL)
    assert done.returncode == 0, done.stderr
    assert len(built) == 1
    pictures = [pixels(tmp_path / f"out.{frame:02d}.png") for frame in range(0, 21, 5)]
    assert np.array_equal(pictures[0], pictures[4])
    assert len({picture.tobytes() for picture in pictures[:4]}) == 4


def test_missing_numbered_file_is_named(tmp_path: Path) -> None:
    for number in (1, 2, 4):
        (tmp_path / f"drop.{number:02d}.obj").write_text(f"v 0 {number} 0\nv 1 {number} 0\nv 0 {number + 1} 0\nf 1 2 3\n")
    done = rayfarm("render", tmp_path / "drop.##.obj", "-o", tmp_path / "out.#.png", "--frames", "1-4", *SMALL)
    assert done.returncode == 1
    assert "frame 3 failed: drop.03.obj is not among the scene's files; add it" in done.stderr
    assert sorted(path.name for path in tmp_path.glob("out.*")) == ["out.1.png", "out.2.png", "out.4.png"]
    assert len({pixels(path).tobytes() for path in tmp_path.glob("out.*")}) == 3
    told = rayfarm("info", tmp_path / "drop.##.obj")
    assert told.returncode == 0
    assert "drop.##.obj" in told.stdout
    for name in ("smoke.##.obj", "drop.##.txt"):
        missing = rayfarm("render", tmp_path / name, "-o", tmp_path / "x.#.png", "--frames", "1-4")
        assert missing.returncode == 1
        assert "There is no file" in missing.stderr
    assert "say which, by --frames" in rayfarm("submit", tmp_path / "drop.##.obj").stderr
    # With an environment image from another folder, the files of all frames are uploaded too.
    from rayfarm.scene_files import files_to_upload

    assert len(files_to_upload(tmp_path / "drop.##.obj")) == 3
    (tmp_path / "s.yaml").write_text("shapes: [{type: mesh, file: drop.##.obj}]")
    assert len(files_to_upload(tmp_path / "s.yaml")) == 4


@pytest.mark.long
@grid("camera_alone", [False, True], ordinary=(False,))
def test_blurred_frame_equals_single_picture(tmp_path: Path, camera_alone: bool) -> None:
    shot = tmp_path / "shot.glb"
    shot.write_bytes(animated_scene(camera_alone).glb())
    done = rayfarm("render", shot, "-o", tmp_path / "out.##.png", "--frames", "12,6", "--shutter=4", *SMALL)
    assert done.returncode == 0, done.stderr
    for frame, name in ((12, "out.12.png"), (6, "out.06.png")):
        still, sharp = tmp_path / "still.png", tmp_path / "sharp.png"
        assert rayfarm("render", shot, "-o", still, f"--frame={frame}", "--shutter=4", *SMALL).returncode == 0
        assert np.array_equal(pixels(tmp_path / name), pixels(still))
        assert rayfarm("render", shot, "-o", sharp, f"--frame={frame}", "--shutter=0", *SMALL).returncode == 0
        assert not np.array_equal(pixels(still), pixels(sharp))
        assert rayfarm("render", shot, "-o", still, f"--frame={frame}", *SMALL).returncode == 0
        assert np.array_equal(pixels(still), pixels(sharp)), "no shutter is none"


@pytest.mark.long
def test_shutter_of_scene_file_is_used_and_options_override_it(tmp_path: Path) -> None:
    shape = "{type: cube, transform: [{rotate: {axis: y, degrees: {keys: [[0, 0], [1, 900]]}}}]}"
    (tmp_path / "s.yaml").write_text(
        f"settings: {{shutter: 1}}\ncameras: [{{eye: [0, 1, 5], target: [0, 0, 0]}}]\nshapes: [{shape}]"
    )
    (tmp_path / "t.yaml").write_text("cameras: [{eye: [0, 1, 5], target: [0, 0, 0]}]\nshapes: [{type: cube}]")
    pictures = {}
    for name, scene, more in (
        ("asked", "s.yaml", ["--shutter=1"]),
        ("its own", "s.yaml", []),
        ("trailing", "s.yaml", ["--shutter-at=trailing"]),
        ("none", "s.yaml", ["--shutter=0"]),
        ("turned", "t.yaml", ["--turntable=1", "--shutter=2"]),
        ("not turned", "t.yaml", ["--turntable=1"]),
    ):
        done = rayfarm("render", tmp_path / scene, "-o", tmp_path / "a.png", "--frame=3", *more, *SMALL)
        assert done.returncode == 0, done.stderr
        pictures[name] = pixels(tmp_path / "a.png")
    assert np.array_equal(pictures["asked"], pictures["its own"])
    different = [pictures[name].tobytes() for name in ("asked", "trailing", "none", "turned", "not turned")]
    assert len(set(different)) == len(different)


def test_movie_command_continues_where_it_stopped(shot: Path, tmp_path: Path) -> None:
    common = ["render", shot, "-o", tmp_path / "out.mp4", *SMALL, "--fps=10"]
    done = rayfarm(*common, "--frames", "0-4")
    assert done.returncode == 0, done.stderr
    with av.open(str(tmp_path / "out.mp4")) as container:
        assert container.streams.video[0].average_rate == 10
        assert len(list(container.decode(video=0))) == 5
    assert [path.name for path in tmp_path.iterdir() if path.is_dir()] == [], "the frames are gone when the film is whole"


def test_movie_with_failed_frame_keeps_frames(tmp_path: Path) -> None:
    for number in (1, 3):
        (tmp_path / f"smoke.{number}.obj").write_text("v -9 -9 0\nv 9 -9 0\nv 0 9 0\nf 1 2 3\n")
    common = ["render", tmp_path / "smoke.#.obj", "-o", tmp_path / "out.mp4", "--frames", "1-3", *SMALL]
    assert rayfarm(*common).returncode == 1
    (tmp_path / "smoke.2.obj").write_text("v -9 -9 0\nv 9 -9 0\nv 0 9 0\nf 1 2 3\n")
    healed = rayfarm(*common)
    assert healed.returncode == 0, healed.stderr
    assert "2 of 3 frames are there and kept" in healed.stderr
    with av.open(str(tmp_path / "out.mp4")) as container:
        assert len(list(container.decode(video=0))) == 3
