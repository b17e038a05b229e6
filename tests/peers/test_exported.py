"""Tests of thirty materials written by Blender's exporters: our pictures of the files against Cycles' of the original scenes.

If an exporter or format loses something, listed in LOST, Cycles' picture of what Blender reads back is the reference instead.
Needs a Python with bpy, which `python3 farm.py peers` installs.
"""

from __future__ import annotations

import subprocess
from itertools import product
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

pytestmark = [pytest.mark.long, pytest.mark.timeout(3600)]

SIZE, BLOCK, SPP, DEPTH = 64, 8, 192, 14
SKY = (0.5, 0.55, 0.6)  # as in exported_kit.py
MOST = 0.03
KINDS = ("blend", "glb", "usdc", "fbx")
NAMES = (
    *("matt", "plastic", "high_ior", "metal", "packed_metal", "coat", "coat_textured", "sheen", "glass", "rough_glass"),
    *("absorbing_glass", "transmission_textured", "emission", "specular_tint", "specular_textured", "anisotropy", "alpha_blend"),
    *("alpha_constant", "alpha_mask", "texture", "texture_transform", "texture_mirrored", "normal_map", "two_sets"),
    *("vertex_colors", "thin_film", "unlit", "nodes", "open_shell", "bent_colors"),
)

# (name, kind) -> what the file lacks; Blender reads back the same.
LOST = {
    **dict.fromkeys((("high_ior", "glb"), ("high_ior", "fbx")), "the index of refraction of what does not transmit"),
    ("sheen", "glb"): "the weight of a sheen",
    **{(name, "usdc"): "transmission" for name in ("glass", "rough_glass", "absorbing_glass", "transmission_textured")},
    **{(name, "fbx"): "transmission" for name in ("glass", "rough_glass", "absorbing_glass", "transmission_textured")},
    **dict.fromkeys((("sheen", "usdc"), ("sheen", "fbx")), "sheen"),
    ("coat", "fbx"): "coats",
    ("emission", "usdc"): "the strength of what shines by a picture",
    ("packed_metal", "fbx"): "channels of a picture",
    ("alpha_mask", "usdc"): "the threshold of a mask",
    ("texture", "usdc"): "the colour that a picture is multiplied by",
    ("texture", "fbx"): "pictures behind other nodes",
    ("two_sets", "fbx"): "by which set of UVs a picture lies",
    ("vertex_colors", "usdc"): "colours of vertices as a material's",
    **dict.fromkeys((("unlit", "usdc"), ("unlit", "fbx")), "what is no principled surface"),
    **dict.fromkeys((("nodes", "usdc"), ("nodes", "fbx")), "values of nodes"),
    **{("bent_colors", kind): "what nodes compute" for kind in ("glb", "usdc", "fbx")},
    **{("thin_film", kind): "thin films" for kind in ("glb", "usdc", "fbx")},
}
# Pairs that are not compared: the exporter loses something, and the importer reads back yet another value.
NO_REFERENCE = {
    ("alpha_mask", "fbx"): "the mask is lost, and the picture's alpha taken for opacity",
    ("texture_mirrored", "fbx"): "mirrored is written as clamped, and the scale read back as its inverse",
    ("vertex_colors", "fbx"): "the colours are beside a base colour that the scene does not use, and are not read back",
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns the folder with exported_kit.py's files and Cycles' pictures of them."""
    python = python_with_bpy()
    if python is None:
        pytest.skip("no Python with bpy is here; `python3 farm.py peers` makes one")
    folder = tmp_path_factory.mktemp("exported")
    script = Path(__file__).with_name("exported_kit.py")
    command = [str(each) for each in (python, script, folder, SIZE, SPP, DEPTH, *NAMES)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return folder


def _blocks(picture: np.ndarray) -> np.ndarray:
    n = SIZE // BLOCK
    return picture[..., :3].astype(float).reshape(n, BLOCK, n, BLOCK, 3).mean((1, 3))


@pytest.mark.parametrize(("name", "kind"), [each for each in product(NAMES, KINDS) if each not in NO_REFERENCE])
def test_the_picture_of_cycles(name: str, kind: str, made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Our picture of an exported file matches Cycles' picture.

    Two differences must be small: the mean difference of blocks of 8 x 8 pixels, and the difference of the pictures' means.
    """
    monkeypatch.setenv(NAMED, str(python_with_bpy()))
    judge = "blend" if (name, kind) not in LOST else kind
    description = read(made, f"{name}.{kind}")
    own_sky = {} if kind == "blend" else {"environment": SKY}
    settings = RenderSettings(SIZE, SIZE, description.cameras[0].view, max_depth=DEPTH, filter="box", **own_sky)
    ours = _blocks(mean(render_frame(compile_scene(description), settings, SPP), settings.film_exponent))
    theirs = _blocks(read_image((made / f"{name}.{judge}.exr").read_bytes(), "a.exr"))
    difference, whole = float(np.abs(ours - theirs).mean() / theirs.mean()), float(ours.mean() / theirs.mean() - 1)
    figures = f"{name}.{kind} ({LOST.get((name, kind), 'nothing lost')}): differs by {difference:.2%}, means by {whole:+.2%}"
    print(figures)
    assert difference < MOST, figures
    assert abs(whole) < MOST, figures
