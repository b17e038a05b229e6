"""Tests that our pictures of .blend files, each with one feature, differ from Cycles' by at most 3 % in each block of pixels.

Reading them must not yield warnings. Needs a Python with bpy, which `python3 farm.py peers` installs.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from renderer.film import mean
from renderer.image.read import read as read_image
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings
from tests.peers.blender import written_by

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]

NAMES = (
    *("ior", "tinted_glass", "shining_mask", "spaces", "mask", "mapped", "multiplied", "brushed_glossy"),
    *("plain", "of_each", "lamps", "profiles", "slides", "sky"),
    *("smoke", "ink", "juice", "fog", "wax", "skin", "marble", "dents", "moved", "cloud"),
    *("fur", "strands", "facet_fur", "elliptic_fur", "facet_strands", "elliptic_strands"),
)
BLOCK, MOST, BRIGHTEST, SAMPLES = 8, 0.03, 4.0, 128
MOST_OF = {"strands": 0.05, "elliptic_strands": 0.05}  # noise: strands against the light


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Yields the folder written by blend_features.py.

    Meanwhile, our reader opens .blend files with the Blender that wrote them.
    """
    with written_by("blend_features.py", tmp_path_factory.mktemp("features")) as folder:
        yield folder


def blocks(picture: np.ndarray) -> np.ndarray:
    h, w = picture.shape[0] // BLOCK, picture.shape[1] // BLOCK
    return np.minimum(picture[..., :3], BRIGHTEST).astype(float).reshape(h, BLOCK, w, BLOCK, 3).mean((1, 3))


@pytest.mark.parametrize("name", NAMES)
def test_the_picture_of_cycles(name: str, made: Path, tmp_path: Path) -> None:
    shutil.copy(made / f"{name}.blend", tmp_path / "a.blend")
    found = read(tmp_path, "a.blend")
    theirs = read_image((made / f"{name}.exr").read_bytes(), "a.exr")
    settings = RenderSettings(theirs.shape[1], theirs.shape[0], found.cameras[0].view, max_depth=14, filter="box")
    ours = mean(render_frame(compile_scene(found), settings, SAMPLES), settings.film_exponent)
    both = blocks(ours), blocks(theirs)
    difference = float(np.abs(both[0] - both[1]).mean() / both[1].mean())
    print(f"{name}: differs by {difference:.2%}; means {both[0].mean():.4f} and {both[1].mean():.4f}")
    assert both[1].std() > 0.1 * both[1].mean() > 0
    assert abs(both[0].mean() / both[1].mean() - 1) < MOST
    assert difference < MOST_OF.get(name, MOST)
    assert found.warnings == []
