"""Tests that images projected by Mitsuba's lights appear the same on walls in our pictures as in Mitsuba's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from renderer.film import mean
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings, chosen
from tests.grids import grid
from tests.peers.compare import assert_same_picture

BATCHES = 16
SPP = 16
ROOM = """<scene version="3.0.0">
  <integrator type="path"><integer name="max_depth" value="4"/></integrator>
  <sensor type="perspective"><float name="fov" value="60"/>
    <transform name="to_world"><lookat origin="0.4, 1.3, 4" target="0, 0.4, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="48"/><integer name="height" value="32"/><rfilter type="box"/></film>
  </sensor>
  <bsdf type="twosided" id="white"><bsdf type="diffuse"><rgb name="reflectance" value="0.7 0.6 0.5"/></bsdf></bsdf>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/></transform>
    <ref id="white"/></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="3"/><translate z="-1"/></transform>
    <ref id="white"/></shape>
  <shape type="sphere"><float name="radius" value="0.4"/><point name="center" x="0.5" y="0.4" z="0.3"/><ref id="white"/></shape>
  LIGHT</scene>"""
PLACE = '<transform name="to_world"><lookat origin="-1.2, 1.7, 2.5" target="0, 0.5, -0.5" up="0.2, 1, 0"/></transform>'
# By default Mitsuba interpolates half a texel at each edge with the opposite edge.
PICTURE = (
    '<texture type="bitmap" name="{}"><string name="filename" value="t.png"/><string name="wrap_mode" value="clamp"/></texture>'
)
LIGHTS = {
    "projector": f'<emitter type="projector"><float name="fov" value="55"/><float name="scale" value="3"/>{PLACE}'
    + PICTURE.format("irradiance")
    + "</emitter>",
    "a projector's lens": f'<emitter type="projector"><string name="focal_length" value="35mm"/>{PLACE}'
    + PICTURE.format("irradiance")
    + "</emitter>",
    "spot": f'<emitter type="spot"><rgb name="intensity" value="30 25 20"/><float name="cutoff_angle" value="35"/>{PLACE}'
    + PICTURE.format("texture")
    + "</emitter>",
}


@grid("name", LIGHTS, ordinary=("spot",))
def test_the_same_light_is_thrown(name: str, tmp_path: Path) -> None:
    """Both renderers project the image of a light equally onto a wall; the image has no symmetry, and is wider than high."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    y, x = np.mgrid[0:24, 0:40]
    bright = np.stack([x * 6, y * 10, np.where((x < 16) & (y < 10), 255, 40)], -1).astype(np.uint8)
    Image.fromarray(bright).save(tmp_path / "t.png")
    (tmp_path / "scene.xml").write_text(ROOM.replace("LIGHT", LIGHTS[name]))
    described = read(tmp_path, "scene.xml")
    assert described.warnings == []
    settings = RenderSettings(48, 32, described.cameras[0].view, **chosen({}, described.defaults))
    compiled = compile_scene(described)
    theirs_scene = mi.load_file(str(tmp_path / "scene.xml"))
    theirs = np.stack([np.array(mi.render(theirs_scene, spp=SPP, seed=1 + i))[..., :3] for i in range(BATCHES)]).astype(float)
    ours = np.stack(
        [mean(render_frame(compiled, replace(settings, seed=1 + i), SPP), settings.film_exponent) for i in range(BATCHES)]
    ).astype(float)
    print(assert_same_picture(ours, theirs, most_error=0.01))
