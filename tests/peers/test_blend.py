"""Tests that converting .blend files runs no code of the file, reads nothing outside its folder, and keeps Blender's positions.

Needs a Python with bpy, which `python3 farm.py peers` installs.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from renderer.blender.convert import convert
from renderer.blender.program import inspect_blender
from renderer.errors import SceneError
from renderer.scene.animation import Moment
from renderer.scene.description import SceneDescription
from renderer.scene.load import Shot, read
from renderer.sentences import codes_of
from tests.peers.blender import TO_Y_UP, python_with_bpy, written_by
from tests.renderer.scene.builders import world

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]

NEAR = 1e-4


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Yields the folder written by blend_kit.py; meanwhile, our reader opens .blend files with the Blender that wrote them."""
    with written_by("blend_kit.py", tmp_path_factory.mktemp("blend")) as folder:
        yield folder


def upload(made: Path, tmp_path: Path, *names: str) -> Path:
    """Copies only the named files of the folder `made` to a new folder, and returns it."""
    folder = tmp_path / "upload"
    folder.mkdir()
    for name in names:
        (folder / Path(name).name).write_bytes((made / name).read_bytes())
    return folder


def pictures(found: SceneDescription) -> int:
    """Returns the number of the scene's images, without that of the added studio light."""
    return sum("blender-scene" in image.name for image in found.images)


def test_nothing_in_a_hostile_file_runs_and_nothing_outside_is_read(made: Path, tmp_path: Path) -> None:
    """No code in a hostile file is executed, and no file outside the folder is read.

    blend_kit.py has verified that all of the file's code is executed if scripts are enabled.
    """
    found = read(upload(made, tmp_path, "hostile.blend"), "hostile.blend")
    assert list(made.glob("ran-*")) == []
    assert [instance.name for instance in found.instances] == ["Scene/thing"]  # not the file from outside
    assert pictures(found) == 0
    said = " ".join(found.warnings)
    assert "Missing images: secret.png." in said
    assert "Missing linked files: secret.blend." in said
    assert "drivers written in Python are not run" in said
    assert str(made) not in said
    assert all(codes_of({"warnings": found.warnings})["warnings"]), "warnings have codes, by which the page translates them"


def test_what_came_along_is_found_wherever_it_lay(made: Path, tmp_path: Path) -> None:
    names = ("hostile.blend", "outside/secret.blend", "outside/secret.png")
    found = read(upload(made, tmp_path, *names), "hostile.blend")
    assert sorted(instance.name for instance in found.instances) == ["Scene/secret", "Scene/thing"]
    assert pictures(found) == 1
    assert not [each for each in found.warnings if "issing" in each]


def test_a_process_that_is_confined_can_neither_read_write_nor_connect(made: Path, tmp_path: Path, monkeypatch: Any) -> None:
    """The process that opens a .blend file cannot read other files, write, or connect.

    This holds even if a file exploits a bug in Blender.
    """
    script = tmp_path / "inside" / "export.py"
    script.parent.mkdir()
    script.write_text(
        "import json, os, socket, sys\n"
        "job = json.load(open(sys.argv[-1]))\n"
        "did = []\n"
        f"for name in ({str(made / 'outside' / 'secret.png')!r}, '/etc/passwd', '/proc/1/environ'):\n"
        "    try: open(name, 'rb').read(); did.append(name)\n"
        "    except OSError: pass\n"
        f"try: open({str(made / 'ran-write')!r}, 'w'); did.append('write')\n"
        "except OSError: pass\n"
        "try: socket.create_connection(('127.0.0.1', PORT), 2); did.append('connect')\n"
        "except OSError: pass\n"
        "did += [name for name in os.environ if 'TOKEN' in name]\n"
        "json.dump({'error': 'did ' + repr(did)}, open(job['out'] + '/report.json', 'w'))\n"
    )
    import socket

    monkeypatch.setenv("RAYFARM_TOKEN", "secret")
    monkeypatch.setattr("renderer.blender.convert.SCRIPT", script)
    python = python_with_bpy()
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        script.write_text(script.read_text().replace("PORT", str(listening.getsockname()[1])))
        with pytest.raises(SceneError, match=r"did \[\]"):
            convert(inspect_blender(str(python)), upload(made, tmp_path, "moving.blend"), "moving.blend", tmp_path, 4 << 30, 100)


@pytest.mark.parametrize("frame", [1, 6, 12])
def test_vertices_cameras_and_lights_are_where_blender_has_them(made: Path, shot: Shot, frame: int) -> None:
    told = json.loads((made / "told.json").read_text())[str(frame)]
    found = shot.scene_at(Moment(frame))
    names = [instance.name for instance in found.instances]
    assert all(m.lamp and m.unseen for m in found.materials if m.name.startswith("light "))
    instances = [*(f"Scene/crowd {i} instance" for i in range(3)), "Scene/strewn instance"]
    assert sorted(names) == sorted(["Scene/tube", "Scene/round", *instances, "area"])
    vertices = world(found, names.index("Scene/tube")).reshape(-1, 3)
    apart = np.linalg.norm(vertices[:, None] - (np.array(told["tube"]) @ TO_Y_UP.T)[None], axis=2)
    assert apart.min(axis=0).max() < NEAR
    assert apart.min(axis=1).max() < NEAR
    assert len(world(found, names.index("Scene/round")).reshape(-1, 3, 3)) == 6 * 4**2 * 2  # rendered subdivision level
    (camera,) = found.cameras
    matrix = np.array(told["eye"])
    np.testing.assert_allclose(camera.view.eye, TO_Y_UP @ matrix[:3, 3], atol=NEAR)
    forward = np.subtract(camera.view.target, camera.view.eye)
    np.testing.assert_allclose(forward / np.linalg.norm(forward), TO_Y_UP @ -matrix[:3, 2], atol=NEAR)
    assert camera.view.focus == pytest.approx(told["focus"], rel=1e-5)
    assert camera.view.aperture == pytest.approx(0.040 / 1.6)
    point = next(sphere for sphere in found.spheres if sphere.name == "point")
    radiance = told["energy"] / (4 * np.pi**2 * point.radius**2)
    assert found.materials[point.material].emission[0] == pytest.approx(radiance, rel=1e-4)
    assert found.clips[0].end == pytest.approx(12 / 24)


@pytest.fixture(scope="module")
def shot(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Shot:
    return Shot(upload(made, tmp_path_factory.mktemp("moving"), "moving.blend"), "moving.blend")


def test_what_is_not_taken_over_is_named(shot: Shot) -> None:
    found = shot.scene_at(Moment(1))
    said = " ".join(found.warnings)
    assert "Material odd: its displacement is left out" in said
    assert "Noise" not in said
    assert "Point clouds" not in said


def test_what_nodes_make_is_baked(shot: Shot) -> None:
    """Procedural textures made by shader nodes are baked to an image by Cycles; the mesh gets UVs for this image."""
    found = shot.scene_at(Moment(1))
    odd = next(material for material in found.materials if material.name == "odd")
    assert odd.base_color_texture is not None
    pixels = found.images[found.textures[odd.base_color_texture].image].pixels[..., :3] / 255
    colors = pixels[pixels.any(axis=2)]
    assert len(colors) > 0.3 * pixels.shape[0] * pixels.shape[1]
    np.testing.assert_allclose(colors.mean(), 0.72, atol=0.08)  # a half, encoded as sRGB
    assert colors.std() > 0.03
    tube = next(mesh for mesh in found.meshes if found.materials[mesh.material].name == "odd")
    assert tube.uvs is not None


def test_the_world_is_a_picture_of_what_cycles_sees(shot: Shot) -> None:
    """The world's shader is converted to an environment image, and each direction has the colour that Cycles renders.

    In the world of blend_kit.py, the colour of a direction is its coordinates.
    """
    environment = shot.scene_at(Moment(1)).environment
    assert environment is not None
    assert environment.image is not None
    pixels = shot.scene_at(Moment(1)).images[environment.image].pixels
    height, width = pixels.shape[:2]
    for row, column, expected in (
        (height // 2, width // 2, (0, 1, 0)),  # ahead: our -Z
        (height // 2, 3 * width // 4, (1, 0, 0)),  # to the right
        (0, 0, (0, 0, 1)),  # up
        (height // 4, 5 * width // 8, (0.5, 0.5, 0.7071)),
    ):
        np.testing.assert_allclose(pixels[row, column, :3], expected, atol=0.01)


def test_the_same_file_gives_the_same_bytes(made: Path, tmp_path: Path) -> None:
    folder = upload(made, tmp_path, "moving.blend")
    blender = inspect_blender(str(python_with_bpy()))
    both = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        convert(blender, folder, "moving.blend", tmp_path / name, 4 << 30, 300)
        both.append({path.name: path.read_bytes() for path in (tmp_path / name).iterdir()})
    assert both[0].keys() == both[1].keys() == {"blender-scene.yaml", "blender-scene.glb", "blender-world.exr"}
    assert [name for name in both[0] if both[0][name] != both[1][name]] in ([], ["blender-world.exr"])


@pytest.mark.parametrize("cut", [0.3, 0.9])
def test_a_damaged_file_is_named(made: Path, tmp_path: Path, cut: float) -> None:
    folder = upload(made, tmp_path, "moving.blend")
    data = (folder / "moving.blend").read_bytes()
    (folder / "moving.blend").write_bytes(data[: int(len(data) * cut)])
    with pytest.raises(SceneError, match=r"^moving\.blend: "):
        read(folder, "moving.blend")
