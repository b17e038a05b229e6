"""Tests that a shot exported by Blender has Blender's positions at each frame.

Needs a Python with bpy, which `python3 farm.py peers` installs.
"""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from renderer.film import mean
from renderer.image.read import read as read_image
from renderer.render import render_frame
from renderer.scene.animation import Moment
from renderer.scene.compile import compile_scene
from renderer.scene.load import Shot
from renderer.settings import RenderSettings
from renderer.vectors import motion_vectors
from tests.peers.blender import python_with_bpy
from tests.renderer.scene.builders import world

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]

TO_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
NEAR = 1e-4

SIZE, SPP, DEPTH = 96, 256, 18
SKY = (0.5, 0.55, 0.6)
MOST = 0.03


def run(script: str, *arguments: Path) -> None:
    """Runs a script of this folder by a Python that has bpy."""
    python = python_with_bpy()
    if python is None:
        pytest.skip("no Python with bpy is here; `python3 farm.py peers` makes one")
    command = [python, Path(__file__).with_name(script), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns the folder with the shot's files."""
    folder = tmp_path_factory.mktemp("shot")
    run("blender_shot.py", folder / "shot.glb", folder / "shot.json")
    return folder


@pytest.fixture(scope="module")
def shot(folder: Path) -> tuple[Shot, dict[str, Any]]:
    """Returns the shot, opened by our reader, and Blender's values at each frame."""
    return Shot(folder, "shot.glb"), json.loads((folder / "shot.json").read_text())


@pytest.mark.parametrize("frame", [0, 7, 13, 24, 40])
def test_vertices_cameras_and_lights_are_where_blender_has_them(shot: tuple[Shot, dict[str, Any]], frame: int) -> None:
    ours, theirs = shot[0].scene_at(Moment(frame)), shot[1][str(frame)]
    numbers = {instance.name: i for i, instance in enumerate(ours.instances)}
    assert set(numbers) == set(theirs["vertices"]) == {"mast", "yard", "flag", "tube", "floor"}
    for name, vertices in theirs["vertices"].items():
        expected = np.array(vertices) @ TO_Y_UP.T
        found = world(ours, numbers[name]).reshape(-1, 3)
        apart = np.linalg.norm(found[:, None] - expected[None], axis=2)
        assert apart.min(axis=1).max() < NEAR, f"a vertex of {name} is where Blender has none"
        assert apart.min(axis=0).max() < NEAR, f"a vertex of {name} is missing"
    (camera,) = ours.cameras
    matrix = np.array(theirs["matrices"]["camera"])
    np.testing.assert_allclose(camera.view.eye, TO_Y_UP @ matrix[:3, 3], atol=NEAR)
    forward = np.subtract(camera.view.target, camera.view.eye)
    np.testing.assert_allclose(forward / np.linalg.norm(forward), TO_Y_UP @ -matrix[:3, 2], atol=NEAR)
    (lamp,) = ours.lights
    matrix = np.array(theirs["matrices"]["lamp"])
    np.testing.assert_allclose(lamp.position, TO_Y_UP @ matrix[:3, 3], atol=NEAR)
    np.testing.assert_allclose(lamp.direction, TO_Y_UP @ -matrix[:3, 2], atol=NEAR)


@pytest.mark.parametrize("frame", [0, 7, 13, 24, 40])
def test_what_blender_writes_as_pointers_is_what_it_shows(shot: tuple[Shot, dict[str, Any]], frame: int) -> None:
    ours, theirs = shot[0].scene_at(Moment(frame)), shot[1][str(frame)]["numbers"]
    assert not [warning for warning in ours.warnings if "animated" in warning]
    paint = next(material for material in ours.materials if material.name == "paint")
    np.testing.assert_allclose(paint.base_color, theirs["color"], rtol=1e-5)
    assert paint.roughness == pytest.approx(theirs["roughness"], rel=1e-5)
    np.testing.assert_allclose(paint.emission, theirs["emission"] * np.array([1, 0.5, 0.25]), rtol=1e-5)
    # Relative to the first frame, since Blender 4.5 writes an animated spot 4 pi times as strong as a static one.
    begin, energy = shot[0].scene_at(Moment(0)).lights[0].intensity, shot[1]["0"]["numbers"]["energy"]
    np.testing.assert_allclose(
        np.divide(ours.lights[0].intensity, begin), theirs["energy"] / energy * np.array(theirs["light"]), rtol=1e-5
    )
    assert ours.cameras[0].view.fov == pytest.approx(theirs["fov"], rel=1e-5)


@pytest.mark.parametrize("frame", [7, 24, 40])
def test_the_picture_of_cycles(shot: tuple[Shot, dict[str, Any]], folder: Path, frame: int) -> None:
    """Our picture of a frame matches Cycles' picture.

    Measured is the mean difference of blocks of 4 x 4 pixels, relative to the picture's mean.
    """
    job = {"glb": str(folder / "shot-plain.glb"), "exr": str(folder / f"{frame}.exr"), "frame": frame}
    job |= {"size": SIZE, "samples": SPP, "max_depth": DEPTH, "sky": SKY}
    (folder / "jobs.json").write_text(json.dumps([job]))
    run("cycles_render.py", folder / "jobs.json")
    description = Shot(folder, "shot-plain.glb").scene_at(Moment(frame))
    settings = RenderSettings(SIZE, SIZE, description.cameras[0].view, max_depth=DEPTH, environment=SKY, filter="box")
    ours = blocks(mean(render_frame(compile_scene(description), settings, SPP), settings.film_exponent))
    theirs = blocks(read_image((folder / f"{frame}.exr").read_bytes(), f"{frame}.exr"))
    difference = float(np.abs(ours - theirs).mean() / theirs.mean())
    figures = f"frame {frame}: differs by {difference:.2%}; means {ours.mean():.4f} and {theirs.mean():.4f}"
    print(figures)
    assert difference < MOST, figures


BLURRED = [("plain", 13, 0.5), ("plain", 8, 6.0), ("plain", 20, 8.0), ("bent", 13, 0.5), ("bent", 9, 8.0)]


@pytest.mark.parametrize(("kind", "frame", "shutter"), BLURRED)
def test_the_motion_blur_of_cycles(
    shot: tuple[Shot, dict[str, Any]], folder: Path, kind: str, frame: int, shutter: float
) -> None:
    """Motion blur matches that of Cycles, for the whole shot, and for a tube deformed by bones and shape keys alone.

    The whole shot has rotating, moving and deforming bodies and a moving camera. Lamps do not move in Cycles.
    """
    file, name = f"shot-{kind}.glb", f"blur-{kind}-{frame}.exr"
    job = {"glb": str(folder / file), "exr": str(folder / name), "frame": frame, "shutter": shutter}
    job |= {"size": SIZE, "samples": 2 * SPP, "max_depth": DEPTH, "sky": SKY}
    (folder / "jobs.json").write_text(json.dumps([job]))
    run("cycles_render.py", folder / "jobs.json")
    moving = Shot(folder, file).over_shutter(Moment(frame), {"shutter": shutter, "shutter_keys": 9})
    assert any(mesh.keys for mesh in moving.meshes)
    moving.lights = [replace(light, keys=()) for light in moving.lights]
    camera = moving.cameras[0]
    settings = RenderSettings(SIZE, SIZE, camera.view, max_depth=DEPTH, environment=SKY, filter="box", views=camera.keys)
    ours = blocks(mean(render_frame(compile_scene(moving), settings, 2 * SPP), settings.film_exponent))
    theirs = blocks(read_image((folder / name).read_bytes(), name))
    still = Shot(folder, file).scene_at(Moment(frame))
    sharp = blocks(mean(render_frame(compile_scene(still), replace(settings, views=()), SPP), settings.film_exponent))
    difference, blur = (float(np.abs(other - theirs).mean() / theirs.mean()) for other in (ours, sharp))
    figures = f"{kind}, frame {frame}, shutter {shutter:g}: differs by {difference:.2%}, the still by {blur:.2%}"
    print(figures)
    assert difference < MOST, figures
    assert shutter < 1 or blur > 1.5 * difference, "the blur is seen"


def blocks(picture: np.ndarray) -> np.ndarray:
    """Returns the means of blocks of 4 x 4 pixels."""
    return picture.astype(float).reshape(SIZE // 4, 4, SIZE // 4, 4, 3).mean((1, 3))


def test_it_moves(shot: tuple[Shot, dict[str, Any]]) -> None:
    """Every body of the shot moves; otherwise the tests of this module would only compare static pictures."""
    places = [shot[1][str(frame)]["vertices"] for frame in (0, 13, 40)]
    for name in ("mast", "yard", "flag", "tube"):
        for a, b in ((0, 1), (1, 2)):
            assert np.abs(np.array(places[a][name]) - np.array(places[b][name])).max() > 0.1


@pytest.mark.parametrize("frame", [7, 13, 24])
def test_the_motion_vectors_of_cycles(shot: tuple[Shot, dict[str, Any]], folder: Path, frame: int) -> None:
    """Motion vectors in pixels equal Cycles', except at edges, where Cycles averages a pixel's samples over two objects."""
    name = f"vectors-{frame}.exr"
    job = {"glb": str(folder / "shot-plain.glb"), "exr": str(folder / name), "frame": frame, "vectors": True}
    job |= {"size": SIZE, "samples": 64, "max_depth": 2, "sky": SKY}
    (folder / "jobs.json").write_text(json.dumps([job]))
    run("cycles_render.py", folder / "jobs.json")
    picture = oiio.ImageBuf(str(folder / name))
    planes = dict(zip(picture.spec().channelnames, np.moveaxis(picture.get_pixels(oiio.FLOAT), -1, 0), strict=True))
    theirs = np.stack([next(plane for key, plane in planes.items() if key.endswith(f"Vector.{axis}")) for axis in "XYZW"], -1)
    description = Shot(folder, "shot-plain.glb").between_frames(Moment(frame))
    (camera,) = description.cameras
    settings = RenderSettings(SIZE, SIZE, camera.view, views=camera.keys)
    ours = motion_vectors(compile_scene(description), settings)
    seen = (np.abs(theirs) > 0).any(-1)  # Cycles has no vectors for the sky
    apart = np.abs(ours - theirs)[seen].max(-1)
    figures = f"frame {frame}: up to {np.abs(theirs).max():.1f} pixels; apart {np.percentile(apart, [50, 90, 95])}"
    print(figures)
    assert seen.mean() > 0.3, figures
    assert np.median(apart) < 0.01, figures
    assert np.percentile(apart, 90) < 0.1, figures
