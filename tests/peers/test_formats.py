"""Tests of one scene in every format that Blender writes: our picture of the file against Cycles' of what Blender reads back.

Needs a Python with bpy, which `python3 farm.py peers` installs. Both pictures lack what a format, its exporter or its importer
loses; formats_kit.py has the list. The difficult parts are the floor's texture, the metals and the lights' edges.
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
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings
from tests.peers.blender import python_with_bpy

pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]

SIZE, BLOCK, SPP, DEPTH = 96, 8, 512, 8
SKY = (0.35, 0.4, 0.5)  # as in formats_kit.py
OWN_SKY = ("blend", "usdc")
MOST = 0.03
BATCHES = 4


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns the folder with the files and Cycles' pictures of them."""
    python = python_with_bpy()
    if python is None:
        pytest.skip("no Python with bpy is here; `python3 farm.py peers` makes one")
    folder = tmp_path_factory.mktemp("formats")
    script = Path(__file__).with_name("formats_kit.py")
    command = [str(each) for each in (python, script, folder, SIZE, SPP, DEPTH)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return folder


def _blocks(pictures: np.ndarray) -> np.ndarray:
    n = SIZE // BLOCK
    return pictures.astype(float).reshape(-1, n, BLOCK, n, BLOCK, 3).mean((2, 4))


@pytest.mark.parametrize("name", ["blend", "glb", "fbx", "usdc", "dae"])
def test_the_picture_of_cycles(name: str, made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Our picture of a file matches Cycles' picture of what Blender reads from it.

    The mean difference of blocks of 8 x 8 pixels, relative to the picture's mean, must be below MOST.
    """
    monkeypatch.setenv(NAMED, str(python_with_bpy()))
    if not (made / f"scene.{name}").exists():
        pytest.skip(f"this Blender does not write .{name} any more")
    description = read(made, f"scene.{name}")
    sky = {} if name in OWN_SKY else {"environment": SKY}
    view = description.cameras[0].view
    compiled = compile_scene(description)
    batches = []
    for seed in range(BATCHES):
        settings = RenderSettings(SIZE, SIZE, view, max_depth=DEPTH, filter="box", seed=seed, **sky)
        batches.append(mean(render_frame(compiled, settings, SPP // BATCHES), settings.film_exponent)[..., :3])
    ours = _blocks(np.array(batches))
    theirs = _blocks(read_image((made / f"{name}.exr").read_bytes(), f"{name}.exr")[..., :3])[0]
    error = float((ours.std(0, ddof=1) / BATCHES**0.5).mean() / theirs.mean())
    difference = float(np.abs(ours.mean(0) - theirs).mean() / theirs.mean())
    figures = f"{name}: differs by {difference:.2%} +- {error:.2%}; means {ours.mean():.4f} and {theirs.mean():.4f}"
    print(figures)
    assert error < MOST / 5, f"too noisy to judge: {figures}"
    assert difference < MOST, figures
