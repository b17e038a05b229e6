"""Tests against Blender's Cycles: both renderers read the same GLB files and render the same view.

Needs a Python with bpy, which requires a different NumPy than ours: `python3 farm.py peers` installs one in .venv-cycles.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from renderer.film import mean
from renderer.image.read import read as read_image
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings
from tests.peers.blender import python_with_bpy
from tests.peers.material_sheet import SHEET, write_sheet

pytestmark = [pytest.mark.long, pytest.mark.timeout(3600)]

SIZE, BLOCK = 96, 4
SPP = 512
DEPTH = 18
SKY = (0.5, 0.55, 0.6)
MOST = 0.03


@pytest.fixture(scope="module")
def sheet(tmp_path_factory) -> Path:
    """Returns a folder with every GLB of the sheet and Cycles' picture of each."""
    python = python_with_bpy()
    if python is None:
        pytest.skip("no Python with bpy is here; `python3 farm.py peers` makes one")
    folder = tmp_path_factory.mktemp("sheet")
    common = {"size": SIZE, "samples": SPP, "max_depth": DEPTH, "sky": SKY}
    jobs = [{"glb": str(path), "exr": str(path.with_suffix(".exr")), **common} for path in write_sheet(folder).values()]
    (folder / "jobs.json").write_text(json.dumps(jobs))
    script = Path(__file__).with_name("cycles_render.py")
    done = subprocess.run([python, script, folder / "jobs.json"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return folder


def _blocks(picture: np.ndarray) -> np.ndarray:
    n = SIZE // BLOCK
    return picture.astype(float).reshape(n, BLOCK, n, BLOCK, 3).mean((1, 3))


@pytest.mark.parametrize("name", SHEET)
def test_the_picture_of_cycles(name, sheet):
    """Our picture of a GLB of the material sheet matches Cycles' picture.

    Measured is the mean difference of blocks of 4 x 4 pixels, relative to the picture's mean.
    """
    description = read(sheet, f"{name}.glb")
    settings = RenderSettings(SIZE, SIZE, description.cameras[0].view, max_depth=DEPTH, environment=SKY, filter="box")
    ours = _blocks(mean(render_frame(compile_scene(description), settings, SPP), settings.film_exponent))
    theirs = _blocks(read_image((sheet / f"{name}.exr").read_bytes(), f"{name}.exr"))
    difference = float(np.abs(ours - theirs).mean() / theirs.mean())
    figures = f"{name}: differs by {difference:.2%}; means {ours.mean():.4f} and {theirs.mean():.4f}"
    print(figures)
    assert difference < MOST, figures
