"""Tests that spectral pictures have the mean colours of Mitsuba's spectral mode."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from renderer.film import mean
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings, chosen

SCENE = """<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="{depth}"/>
<integer name="rr_depth" value="1000"/></integrator>
<sensor type="perspective"><float name="fov" value="39"/><transform name="to_world"><lookat origin="0, 0, 3.8" target="0, 0, 0"
up="0, 1, 0"/></transform><film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/>
<rfilter type="box"/></film></sensor>{inside}</scene>"""
WALL = """<shape type="rectangle"><transform name="to_world">{place}</transform>
<bsdf type="twosided"><bsdf type="diffuse">{color}</bsdf></bsdf></shape>"""
COLOR = '<rgb name="reflectance" value="{}"/>'
PLACES = {
    "floor": '<rotate x="1" angle="-90"/><translate y="-1"/>',
    "ceiling": '<rotate x="1" angle="90"/><translate y="1"/>',
    "back": '<translate z="-1"/>',
    "left": '<rotate y="1" angle="90"/><translate x="-1"/>',
    "right": '<rotate y="1" angle="-90"/><translate x="1"/>',
}
LAMP = """<shape type="rectangle"><transform name="to_world"><scale value="0.5"/><rotate x="1" angle="90"/>
<translate y="0.98"/></transform><emitter type="area">{}</emitter></shape>"""
RADIANCE = '<rgb name="radiance" value="{}"/>'
BLACK_BODY = '<spectrum type="blackbody" name="radiance"><float name="temperature" value="2500"/></spectrum>'
SKY = '<emitter type="constant"><rgb name="radiance" value="{}"/></emitter>'
BALL = '<shape type="sphere"><float name="radius" value="1.6"/>{}</shape>'
BAND = '<spectrum name="reflectance" value="400:0.05, 500:0.1, 530:0.9, 570:0.9, 600:0.1, 700:0.4"/>'
INDEX = '<bsdf type="conductor"><spectrum name="eta" value="400:1.6, 500:1.1, 600:0.2, 700:0.2"/>{}</bsdf>'
METAL = '<bsdf type="conductor"><string name="material" value="{}"/></bsdf>'


def box(colors: dict[str, str], radiance: str) -> str:
    walls = {wall: color if color.startswith("<") else COLOR.format(color) for wall, color in colors.items()}
    lamp = LAMP.format(radiance if radiance.startswith("<") else RADIANCE.format(radiance))
    return "".join(WALL.format(place=PLACES[wall], color=color) for wall, color in walls.items()) + lamp


WHITE = "0.73 0.73 0.73"
CORNELL = dict.fromkeys(PLACES, WHITE) | {"left": "0.63 0.06 0.05", "right": "0.14 0.45 0.09"}
SCENES = {
    "Cornell box": (box(CORNELL, "8 8 8"), 6),
    "saturated box": (box(dict.fromkeys(PLACES, "0.2 0.35 0.8"), "8 8 8"), 8),
    "coloured lamp": (box(CORNELL, "9 4 1"), 6),
    "black body": (box(CORNELL, BLACK_BODY), 6),
    "bands": (box(CORNELL | {"left": BAND, "floor": BAND}, "8 8 8"), 6),
    "metal of spectra": (
        BALL.format(INDEX.format('<spectrum name="k" value="400:1.9, 500:1.9, 600:3.0, 700:3.8"/>')) + SKY.format("1 1 1"),
        3,
    ),
    "gold": (BALL.format(METAL.format("Au")) + SKY.format("1 1 1"), 3),
    "copper": (BALL.format(METAL.format("Cu")) + SKY.format("1 1 1"), 3),
}


def pictures(name: str, folder: Path, spectral: str = "on", spp: int = 2048) -> tuple[np.ndarray, np.ndarray]:
    """Returns the mean colours (3,) of our picture and of Mitsuba's spectral one."""
    mi = pytest.importorskip("mitsuba")
    inside, depth = SCENES[name]
    (folder / "scene.xml").write_text(SCENE.format(inside=inside, depth=depth))
    described = read(folder, "scene.xml")
    asked = chosen({}, described.defaults) | {"spectral": spectral}
    settings = RenderSettings(16, 16, described.cameras[0].view, **asked)
    sums = render_frame(compile_scene(described), settings, spp)
    mi.set_variant("scalar_spectral")
    theirs = np.array(mi.render(mi.load_file(str(folder / "scene.xml")), spp=spp), float)[..., :3]
    return mean(sums, settings.film_exponent)[..., :3].mean(axis=(0, 1)), theirs.mean(axis=(0, 1))


@pytest.mark.long
@pytest.mark.parametrize("name", SCENES)
def test_spectral_pictures_have_the_colors_of_mitsubas(name: str, tmp_path: Path) -> None:
    ours, theirs = pictures(name, tmp_path)
    np.testing.assert_allclose(ours, theirs, rtol=0.01, atol=0.002)
