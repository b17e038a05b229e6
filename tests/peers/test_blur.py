"""Tests of motion blur of one shot in every format with motion, against Cycles.

The shot of blur_kit.py has rotating, moving, constrained and deforming bodies, and a moving camera. Needs a Python with bpy,
which `python3 farm.py peers` installs.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

from renderer.blender.program import NAMED
from renderer.film import mean
from renderer.image.read import read as read_image
from renderer.render import render_frame
from renderer.scene.animation import Moment
from renderer.scene.compile import compile_scene
from renderer.scene.load import Shot
from renderer.settings import RenderSettings
from tests.peers.blender import python_with_bpy

pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]

SIZE, BLOCK, SPP, DEPTH = 96, 4, 128, 8
SKY, FRAME = (0.5, 0.55, 0.6), 6  # as in blur_kit.py
MOST = 0.01
OPENED = {"CENTER": "centred", "START": "leading", "END": "trailing"}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns the folder with the shot in every format, and Cycles' pictures of each file."""
    python = python_with_bpy()
    if python is None:
        pytest.skip("no Python with bpy is here; `python3 farm.py peers` makes one")
    folder = tmp_path_factory.mktemp("blur")
    command = [str(each) for each in (python, Path(__file__).with_name("blur_kit.py"), folder, SIZE, SPP, DEPTH)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return folder


def _blocks(picture: np.ndarray) -> np.ndarray:
    n = SIZE // BLOCK
    return picture[..., :3].astype(float).reshape(n, BLOCK, n, BLOCK, 3).mean((1, 3))


def _of_cycles(folder: Path, shutter: float, position: str) -> np.ndarray:
    names = (f"{shutter:g}-{position}-{seed}.exr" for seed in (1, 2))
    return np.mean([_blocks(read_image((folder / name).read_bytes(), name)) for name in names], axis=0)


@pytest.mark.parametrize(("shutter", "position"), [(0.5, "CENTER"), (1.0, "CENTER"), (0.5, "START"), (0.5, "END")])
@pytest.mark.parametrize("kind", ["glb", "usdc", "fbx", "blend"])
def test_it_is_blurred_as_in_cycles(
    kind: str, shutter: float, position: str, made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(NAMED, str(python_with_bpy()))
    asked = {"shutter": shutter, "shutter_at": OPENED[position], "shutter_keys": 9}
    moving = Shot(made, f"shot.{kind}").over_shutter(Moment(FRAME), asked)
    camera = moving.cameras[0]
    sky = {} if kind == "blend" else {"environment": SKY}
    settings = RenderSettings(SIZE, SIZE, camera.view, max_depth=DEPTH, filter="box", views=camera.keys, **sky)
    ours = _blocks(mean(render_frame(compile_scene(moving), settings, SPP), settings.film_exponent))
    theirs, still = _of_cycles(made, shutter, position), _of_cycles(made, 0.0, "CENTER")
    difference, sharp = (float(np.abs(each - theirs).mean() / theirs.mean()) for each in (ours, still))
    figures = f"{kind}, {shutter:g} {position}: differs by {difference:.2%}, the still by {sharp:.2%}"
    print(figures)
    assert difference < MOST, figures
    assert position == "CENTER" or sharp > 2 * difference, "the blur is seen"
