"""Tests of the commands and the client with a real farm."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import av
import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from rayfarm import options
from rayfarm.client import Client, ClientError
from rayfarm.frame import PictureOrder
from rayfarm.picture import Picture
from rayfarm.reading import open_stage
from renderer import film
from renderer.denoise import is_available
from renderer.render import render_frame
from renderer.scene.animation import Moment
from tests.helpers import ROOT, Farm, wait_until
from tests.rayfarm.program import rayfarm
from tests.rayfarm.test_sequence import animated_scene
from tests.renderer.scene.builders import Gltf, shoe

CORNELL = ROOT / "scenes" / "cornell-box.yaml"
SMALL = ["--size=48x32", "--spp=16", "--max-depth=4"]


def start(*arguments: str | Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "rayfarm", *map(str, arguments)]
    env = {**os.environ, "COLUMNS": "160", "RAYFARM_TOKEN": ""}
    return subprocess.Popen(command, cwd=ROOT, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def run(*arguments: str | Path) -> tuple[int, str, str]:
    process = start(*arguments)
    out, err = process.communicate(timeout=120)
    return process.returncode, out, err


def run_in_process(*arguments: str | Path) -> tuple[int, str, str]:
    """Runs a command in this process, which has already loaded numba and the kernels; returns (exit code, output, errors)."""
    done = rayfarm(*arguments, COLUMNS="160", RAYFARM_TOKEN="")
    return done.returncode, done.stdout, done.stderr


def pixels(path: Path) -> np.ndarray:
    file = oiio.ImageInput.open(str(path))
    try:
        return file.read_image()[..., :3]
    finally:
        file.close()


def test_submit_equals_render(farm: Farm, tmp_path: Path) -> None:
    code, out, err = run("submit", CORNELL, "--server", farm.url, "--wait", "-o", tmp_path / "farm.exr", *SMALL)
    assert code == 0, err
    job = out.strip()
    assert run_in_process("render", CORNELL, "-o", tmp_path / "alone.exr", *SMALL)[0] == 0
    assert np.array_equal(pixels(tmp_path / "farm.exr"), pixels(tmp_path / "alone.exr"))

    code, out, _ = run_in_process("jobs", "--server", farm.url)
    assert code == 0
    assert any(job in line and "finished" in line and "100 %" in line for line in out.splitlines()), out
    shown = json.loads(run_in_process("jobs", job[:8], "--json", "--server", farm.url)[1])
    assert (shown["id"], shown["state"], shown["width"], shown["height"]) == (job, "finished", 48, 32)


def test_added_ground_is_equal_with_farm(farm: Farm, tmp_path: Path) -> None:
    scene = tmp_path / "pyramid.obj"
    scene.write_text("v -1 -1 0\nv 1 -1 0\nv 0 1 0\nv 0 0 3\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    asked = [*SMALL, "--up-axis=z"]
    code, _, err = run("submit", scene, "--server", farm.url, "-o", tmp_path / "farm.exr", *asked)
    assert code == 0, err
    assert "--no-floor leaves it out" in err
    code, _, err = run_in_process("render", scene, "-o", tmp_path / "alone.exr", *asked)
    assert code == 0 and "--no-floor leaves it out" in err
    assert np.array_equal(pixels(tmp_path / "farm.exr"), pixels(tmp_path / "alone.exr"))
    code, _, err = run_in_process("render", scene, "-o", tmp_path / "bare.exr", *asked, "--no-floor")
    assert code == 0 and "floor" not in err
    assert not np.array_equal(pixels(tmp_path / "bare.exr"), pixels(tmp_path / "alone.exr"))


@pytest.mark.long
def test_environment_image_is_uploaded(farm: Farm, tmp_path: Path) -> None:
    sky = np.full((16, 32, 3), 0.25, np.float32)
    file = oiio.ImageOutput.create(str(tmp_path / "sky.exr"))
    file.open(str(tmp_path / "sky.exr"), oiio.ImageSpec(32, 16, 3, "float"))
    file.write_image(sky)
    file.close()
    (tmp_path / "ball.yaml").write_text(
        "shapes: [{type: sphere, center: [0, 0, 0], radius: 1, material: white}]\nmaterials: {white: {kind: diffuse, color: 1}}\n"
    )
    arguments = [f"--env={tmp_path / 'sky.exr'}", "--size=16x16", "--spp=64", "--eye=0,0,4", "--target=0,0,0"]
    code, _, err = run_in_process("submit", tmp_path / "ball.yaml", "--server", farm.url, "-o", tmp_path / "ball.exr", *arguments)
    assert code == 0, err
    # A white ball in uniform light is as bright as the light (furnace test).
    assert pixels(tmp_path / "ball.exr").mean() == pytest.approx(0.25, rel=0.02)


@pytest.mark.long
def test_sky_is_equal_with_farm_and_denoised_picture_is_written(farm: Farm, tmp_path: Path) -> None:
    (tmp_path / "ball.yaml").write_text(
        "shapes: [{type: sphere, center: [0, 0, 0], radius: 1, material: white}]\nmaterials: {white: {kind: diffuse, color: 1}}\n"
    )
    arguments = ["--env=sky:20,60", "--size=24x16", "--spp=8", "--eye=0,0,4", "--target=0,0,0", "--aov=depth"]
    more = ["--denoise"] if is_available() else []
    code, _, err = run_in_process(
        "submit", tmp_path / "ball.yaml", "--server", farm.url, "-o", tmp_path / "farm.exr", *arguments, *more
    )
    assert code == 0, err
    assert run_in_process("render", tmp_path / "ball.yaml", "-o", tmp_path / "alone.exr", *arguments)[0] == 0
    assert np.array_equal(pixels(tmp_path / "farm.exr"), pixels(tmp_path / "alone.exr"))
    assert pixels(tmp_path / "farm.exr")[2, :, 2].min() > 0, "there is a sky"
    if more:
        clean = pixels(tmp_path / "farm-denoised.exr")
        assert clean.shape == (16, 24, 3)
        assert not np.array_equal(clean, pixels(tmp_path / "farm.exr"))
    studio = [tmp_path / "ball.yaml", "--env=studio", *arguments[1:-1]]
    assert run_in_process("submit", *studio, "--server", farm.url, "-o", tmp_path / "farm.exr")[0] == 0
    assert run_in_process("render", *studio, "-o", tmp_path / "alone.exr")[0] == 0
    assert np.array_equal(pixels(tmp_path / "farm.exr"), pixels(tmp_path / "alone.exr"))


@pytest.mark.long
def test_variant_is_equal_with_farm(farm: Farm, tmp_path: Path) -> None:
    (tmp_path / "shoe.glb").write_bytes(shoe().glb())
    shown = ["--size=16x16", "--spp=4", "--eye=0.3,0.3,2", "--target=0.3,0.3,0", "--aov=albedo"]
    for variant in ([], ["--variant=night"], ["--variant=0"]):
        code, _, err = run_in_process(
            "submit", tmp_path / "shoe.glb", "--server", farm.url, "-o", tmp_path / "far.exr", *shown, *variant
        )
        assert code == 0, err
        assert run_in_process("render", tmp_path / "shoe.glb", "-o", tmp_path / "near.exr", *shown, *variant)[0] == 0
        assert np.array_equal(pixels(tmp_path / "far.exr"), pixels(tmp_path / "near.exr"))
    code, _, err = run_in_process("submit", tmp_path / "shoe.glb", "--server", farm.url, "--variant=winter")
    assert code == 1
    assert "no variant 'winter'; its variants are 0: beach, 1: night, 2: day" in err


def test_shot_frames_equal_render(farm: Farm, tmp_path: Path) -> None:
    (tmp_path / "shot.glb").write_bytes(animated_scene().glb())
    shown = ["--size=24x16", "--spp=4", "--env=1,1,1"]
    common = ["submit", tmp_path / "shot.glb", "--server", farm.url, "-o", tmp_path / "far.###.exr", *shown]
    code, out, err = run_in_process(*common, "--frames=0-3,6.5", "--order=centre-out")
    assert code == 0, err
    assert run_in_process("render", tmp_path / "shot.glb", "-o", tmp_path / "near.###.exr", "--frames=0-3,6.5", *shown)[0] == 0
    for number in ("000", "001", "002", "003", "006.5"):
        assert np.array_equal(pixels(tmp_path / f"far.{number}.exr"), pixels(tmp_path / f"near.{number}.exr"))
    lines = run_in_process("jobs", "--server", farm.url)[1].splitlines()
    assert any(out.strip() in line and "5 of 5" in line for line in lines), lines

    (tmp_path / "far.002.exr").unlink()
    code, out, err = run_in_process(*common, "--frames=0-3,6.5")
    assert (code, "4 of 5 frames are there and kept" in err) == (0, True)
    with farm.client() as client:
        assert [frame.number for frame in client.frames(out.strip())] == [2]
    code, out, err = run_in_process(*common, "--frames=0-3,6.5")
    assert (code, out, "All 5 frames are there" in err) == (0, "", True)


@pytest.mark.long
@pytest.mark.skipif(not is_available(), reason="Open Image Denoise is not installed")
def test_denoised_and_deep_frames_equal_those_of_render(farm: Farm, tmp_path: Path) -> None:
    """A worker averages a denoised frame with its neighbours, as `rayfarm render` does."""
    (tmp_path / "shot.glb").write_bytes(animated_scene().glb())
    shown = ["--size=48x32", "--spp=4", "--env=1,1,1", "--frames=0-3", "--denoise", "--deep=8", tmp_path / "shot.glb"]
    code, _, err = run_in_process("submit", "--server", farm.url, "-o", tmp_path / "far.#.exr", *shown)
    assert code == 0, err
    assert run_in_process("render", "-o", tmp_path / "near.#.exr", *shown)[0] == 0
    for number in range(4):
        far, near = (tmp_path / f"{place}.{number}.exr" for place in ("far", "near"))
        clean = pixels(options.denoised_name(far))
        np.testing.assert_allclose(clean, pixels(options.denoised_name(near)), rtol=1e-5, atol=1e-6)
        assert not np.array_equal(clean, pixels(far))
        assert options.deep_name(far).read_bytes() == options.deep_name(near).read_bytes()


@pytest.mark.long
@pytest.mark.skipif(not is_available(), reason="Open Image Denoise is not installed")
def test_denoised_mirror_equals_that_of_render(farm: Farm, tmp_path: Path) -> None:
    """Tested with a still, and with a frame of a shot whose compiled scene the farm has released."""
    (tmp_path / "room.yaml").write_text(
        "shapes:\n"
        "  - {type: sphere, center: [0, 0, 0], radius: 1, material: mirror}\n"
        "  - {type: sphere, center: {keys: [[0, [0, -51, 0]], [1, [0, -52, 0]]]}, radius: 50, material: red}\n"
        "materials: {mirror: {kind: mirror, color: 0.8}, red: {kind: diffuse, color: [0.8, 0.1, 0.1]}}\n"
    )
    shown = ["--env=1,1,1", "--size=48x32", "--spp=4", "--eye=0,0.5,4", "--target=0,0,0", "--denoise", tmp_path / "room.yaml"]
    for name, moment in (("still", []), ("frame", ["--frames=12"])):
        far, near = tmp_path / f"{name}-far.exr", tmp_path / f"{name}-near.exr"
        code, _, err = run_in_process("submit", "--server", farm.url, "-o", far, *moment, *shown)
        assert code == 0, err
        assert run_in_process("render", "-o", near, *moment, *shown)[0] == 0
        np.testing.assert_array_equal(pixels(far), pixels(near))
        clean = pixels(options.denoised_name(far))
        np.testing.assert_array_equal(clean, pixels(options.denoised_name(near)), farm.logs())
        assert not np.array_equal(clean, pixels(far))


def moving_scene() -> Gltf:
    """Builds a file with a triangle that moves to the right within a second, and a camera that rises."""
    g = animated_scene()
    samplers, channels = g.root["animations"][0]["samplers"], g.root["animations"][0]["channels"]
    samplers.append({"input": samplers[0]["input"], "output": g.array(np.float32([(0, 0, 5), (0, 2, 5)]))})
    channels.append({"sampler": 1, "target": {"node": 2, "path": "translation"}})
    return g


def digest_here(scene: Path, frame: float, picture: Picture, turntable: float | None) -> str:
    """Returns the digest of the film that `rayfarm render --frame` computes for this frame on this machine."""
    moment = Moment(frame)
    with open_stage(scene, picture.environment(), shutter=picture.shutter()) as stage:
        compiled, summary = stage.scene_at(moment)
    settings = PictureOrder(picture, [], False, 0.0, "neutral", None, 0, turntable, None).settings(summary, moment)
    return film.digest(render_frame(compiled, settings, 4))


@pytest.mark.long
def test_blurred_frame_equals_render(farm: Farm, tmp_path: Path) -> None:
    (tmp_path / "shot.glb").write_bytes(moving_scene().glb())
    cube = "{type: cube, transform: [{rotate: {axis: y, degrees: {keys: [[0, 0], [1, 900]]}}}]}"
    (tmp_path / "own.yaml").write_text(f"settings: {{shutter: 2}}\nshapes: [{cube}]")
    digests = set()
    for name, frame, shutter, turntable in (
        ("shot.glb", 3, 2.0, None),
        ("shot.glb", 3, None, None),
        ("shot.glb", 3, 2.0, 1.0),
        ("shot.glb", 0, 4.0, None),
        ("own.yaml", 0, None, None),  # a still with motion blur by the file's own shutter
        ("own.yaml", 0, 0.0, None),
    ):
        asked = {} if shutter is None else {"shutter": shutter}
        picture = Picture({"size": "24x16", "spp": 4, "env": "1,1,1", **asked})
        words = ["--size=24x16", "--spp=4", "--env=1,1,1", *(f"--{option}={value}" for option, value in asked.items())]
        words += [f"--frame={frame}"] if frame else []
        words += [f"--turntable={turntable}"] if turntable else []
        code, out, err = run_in_process("submit", tmp_path / name, "--server", farm.url, "-o", tmp_path / "far.exr", *words)
        assert code == 0, err
        with farm.client() as client:
            digest = client.digest(out.strip(), frame)
        assert digest == digest_here(tmp_path / name, frame, picture, turntable)
        assert run_in_process("render", tmp_path / name, "-o", tmp_path / "near.exr", *words)[0] == 0
        assert np.array_equal(pixels(tmp_path / "far.exr"), pixels(tmp_path / "near.exr"))
        digests.add(digest)
    assert len(digests) == 6


@pytest.mark.long
def test_farm_encodes_movie_of_shot(farm: Farm, tmp_path: Path) -> None:
    (tmp_path / "shot.glb").write_bytes(animated_scene().glb())
    arguments = ["--size=64x48", "--spp=2", "--frames=0-5", "--fps=12"]
    code, _, err = run_in_process("submit", tmp_path / "shot.glb", "--server", farm.url, "-o", tmp_path / "shot.mp4", *arguments)
    assert code == 0, err
    with av.open(str(tmp_path / "shot.mp4")) as container:
        assert container.streams.video[0].average_rate == 12
        assert len(list(container.decode(video=0))) == 6


@pytest.mark.long
def test_failed_frame_gives_exit_code_1_and_others_are_written(farm: Farm, tmp_path: Path) -> None:
    for number in (0, 1, 3):
        (tmp_path / f"smoke.{number}.obj").write_text(f"v -9 -9 0\nv 9 -9 0\nv 0 {9 + number} 0\nf 1 2 3\n")
    (tmp_path / "scene.yaml").write_text("shapes: [{type: mesh, file: smoke.#.obj}]\n")
    arguments = ["--size=16x16", "--spp=1", "--env=1,1,1", "--frames=0-3"]
    code, _, err = run_in_process("submit", tmp_path, "--server", farm.url, "-o", tmp_path / "out.#.png", *arguments)
    assert code == 1
    assert "frame 2 failed" in err
    assert "1 of 4 frames failed: 2" in err
    assert sorted(path.name for path in tmp_path.glob("*.png")) == ["out.0.png", "out.1.png", "out.3.png"]


@pytest.mark.long
def test_numbered_files_are_a_shot(farm: Farm, tmp_path: Path) -> None:
    for number in (1, 2):
        (tmp_path / f"drop.{number:04d}.obj").write_text(f"v -9 -9 0\nv 9 -9 0\nv 0 {3 * number} 0\nf 1 2 3\n")
    arguments = ["--frames=1-2", "--size=16x16", "--spp=2", "--env=1,1,1"]
    code, _, err = run_in_process(
        "submit", tmp_path / "drop.####.obj", "--server", farm.url, "-o", tmp_path / "far.#.exr", *arguments
    )
    assert code == 0, err
    assert run_in_process("render", tmp_path / "drop.####.obj", "-o", tmp_path / "near.#.exr", *arguments)[0] == 0
    for number in (1, 2):
        assert np.array_equal(pixels(tmp_path / f"far.{number}.exr"), pixels(tmp_path / f"near.{number}.exr"))


@pytest.mark.long
def test_invalid_scene_gives_error(farm: Farm, tmp_path: Path) -> None:
    (tmp_path / "noise.glb").write_bytes(b"glTF" + os.urandom(200))
    code, _, err = run_in_process("submit", tmp_path / "noise.glb", "--server", farm.url)
    assert code == 1
    assert "noise.glb" in err
    assert "Traceback" not in err


@pytest.mark.long
def test_ctrl_c_leaves_job_running(farm: Farm) -> None:
    process = start("submit", CORNELL, "--server", farm.url, "--wait", "--size=256x256", "--spp=100000")
    assert process.stdout is not None
    job = process.stdout.readline().strip()
    with farm.client() as client:
        try:
            wait_until(lambda: client.job(job).samples > 0, 60, "the job has begun")
            process.send_signal(signal.SIGINT)
            _, err = process.communicate(timeout=10)
            assert process.returncode == 130
            assert f"rayfarm jobs {job}" in err
            assert client.job(job).state == "running"
        finally:
            client.change(job, state="cancelled")


@pytest.mark.long
def test_wrong_token_gives_error(farm: Farm) -> None:
    code, _, err = run("worker", "--join", farm.url, "--token", "wrong", "--slots", "1")
    assert code == 1
    assert "does not know this token" in err


@pytest.mark.long
def test_client_raises_service_message(farm: Farm) -> None:
    with farm.client() as client:
        with pytest.raises(ClientError) as missing:
            client.job("no-such-job")
        assert missing.value.status == 404
        with pytest.raises(ClientError) as wrong:
            client.submit("no-such-scene", width=16, height=16, spp=1)
        assert wrong.value.status is not None
        assert 400 <= wrong.value.status < 500


def test_missing_farm_gives_error() -> None:
    with Client("http://127.0.0.1:9") as client, pytest.raises(ClientError, match="No farm answers"):
        client.jobs()
    with Client("http://exa mple") as client, pytest.raises(ClientError):
        client.jobs()


@pytest.mark.long
def test_second_farm_on_folder_or_port_gives_error(farm: Farm, tmp_path: Path) -> None:
    port = farm.url.rpartition(":")[2]
    for arguments, sentence in (
        ([f"--data={farm.data}", "--port=0"], f"already runs on {farm.data} at {farm.url}"),
        ([f"--data={tmp_path}", f"--port={port}"], f"Port {port} of 127.0.0.1 is in use"),
    ):
        code, _, err = run("up", "--no-browser", "--workers=0", *arguments)
        assert code == 1
        assert sentence in err
        assert "Traceback" not in err


@pytest.mark.long
def test_newer_data_folder_is_rejected(tmp_path: Path) -> None:
    data = tmp_path / "data"
    data.mkdir()
    with closing(sqlite3.connect(data / "rayfarm.sqlite")) as database, database:
        database.execute("CREATE TABLE alembic_version (version_num VARCHAR(32) NOT NULL)")
        database.execute("INSERT INTO alembic_version VALUES ('9999')")
    code, _, err = run("up", "--port=0", "--workers=0", f"--data={data}", "--no-browser")
    assert code == 1
    assert "is of a newer release of Rayfarm (revision 9999" in err
    assert "Traceback" not in err
