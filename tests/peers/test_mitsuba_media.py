"""Tests of Mitsuba's media and bump maps: our picture of a file against that of Mitsuba's `volpath`, or `volpathmis` for grids.

Both pictures are noisy: each block mean has a standard error, estimated from batches, and differences must be explained by it.
"""

from __future__ import annotations

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

BATCHES, SPP = 8, 32
WIDTH, HEIGHT, BLOCK = 48, 32, 8
BIAS = 0.01  # allowed difference of blocks besides noise
# How much brighter pictures are here: Mitsuba loses light that shading normals scatter into their facets (docs/correctness.md).
BRIGHTER = {"bumps": 0.011}
HEAD = """<scene version="3.0.0"><integrator type="volpath"><integer name="max_depth" value="32"/></integrator>
<medium type="homogeneous" id="fog"><rgb name="albedo" value="0.95 0.9 0.8"/><float name="sigma_t" value="0.6"/></medium>
<medium type="homogeneous" id="smoke"><rgb name="albedo" value="0.9 0.7 0.4"/><rgb name="sigma_t" value="0.5 0.75 1"/>
<float name="scale" value="4"/><phase type="hg"><float name="g" value="0.8"/></phase></medium>
<medium type="homogeneous" id="milk"><rgb name="albedo" value="0.98 0.9 0.7"/><float name="sigma_t" value="3"/>
<float name="scale" value="2"/><phase type="hg"><float name="g" value="0.4"/></phase></medium>
<sensor type="perspective"><float name="fov" value="50"/>SENSOR
<transform name="to_world"><lookat origin="0.6, 1.2, 3.6" target="0, 0, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="48"/><integer name="height" value="32"/><rfilter type="box"/></film></sensor>
<bsdf type="diffuse" id="white"><rgb name="reflectance" value="0.7 0.6 0.5"/></bsdf>
<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/><translate y="-0.6"/></transform>
<ref id="white"/></shape>
"""
LAMP = """<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="0.6"/><translate y="2"/>
</transform><ref id="white"/><emitter type="area"><rgb name="radiance" value="9 8 7"/></emitter></shape>"""
SUN = """<emitter type="constant"><rgb name="radiance" value="0.4 0.45 0.5"/></emitter><emitter type="directional">
<vector name="direction" value="1 -1 -1"/><rgb name="irradiance" value="1.5 1.4 1.3"/></emitter>"""
SPOT = """<emitter type="spot"><transform name="to_world"><lookat origin="-2, 2, 1" target="0.2, 0, 0" up="0, 1, 0"/></transform>
<rgb name="intensity" value="20 18 15"/><float name="cutoff_angle" value="25"/></emitter>"""
NULL, GLASS = (
    '<bsdf type="null"/>',
    '<bsdf type="dielectric"><float name="int_ior" value="1.4"/><float name="ext_ior" value="1"/></bsdf>',
)


def medium(name: str, side: str = "interior") -> str:
    return f'<ref id="{name}" name="{side}"/>'


def ball(inside: str, radius: float = 0.5, x: float = 0.0) -> str:
    return (
        f'<shape type="sphere"><point name="center" x="{x}" y="0" z="0"/><float name="radius" value="{radius}"/>{inside}</shape>'
    )


def cube(inside: str, size: str = "1.6 0.9 1.2") -> str:
    place = f'<transform name="to_world"><scale value="{size}"/><translate y="0.31"/></transform>'
    return f'<shape type="cube">{place}{inside}</shape>'


BUMPS = """<shape type="rectangle"><bsdf type="bumpmap"><texture type="bitmap"><string name="filename" value="waves.png"/>
<boolean name="raw" value="true"/></texture><float name="scale" value="0.15"/><ref id="white"/></bsdf></shape>"""
PLUME = """<medium type="heterogeneous" id="plume"><volume type="gridvolume" name="sigma_t">
<string name="filename" value="plume.vol"/><transform name="to_world"><translate x="-0.5" y="-0.5" z="-0.5"/>
<scale value="2.4 1.6 2"/><translate y="0.3"/></transform></volume>
<rgb name="albedo" value="0.95 0.8 0.6"/><float name="scale" value="12"/>
<phase type="hg"><float name="g" value="0.4"/></phase></medium>"""
MATT = '<ref id="white"/>'
SCENES = {
    "fog in a box with a lamp and a ball": cube(NULL + medium("fog")) + ball(MATT, 0.4) + LAMP,
    "milk in glass": ball(GLASS + medium("milk"), 0.6) + SUN,
    "coloured smoke that scatters onwards": ball(NULL + medium("smoke"), 0.6) + SUN,
    "fog around the sensor": ball(MATT, 0.4) + SPOT,
    "a glass ball in fog": cube(NULL + medium("fog")) + ball(GLASS + medium("fog", "exterior"), 0.4) + LAMP,
    "smoke in fog": cube(NULL + medium("fog")) + ball(NULL + medium("smoke") + medium("fog", "exterior"), 0.4) + SUN,
    "bumps": BUMPS + SUN,
    "a plume": PLUME + cube(NULL + medium("plume"), "1.5 0.86 1.4") + LAMP,
    "a plume about a ball, in the sun": PLUME + cube(NULL + medium("plume"), "1.5 0.86 1.4") + ball(MATT, 0.35) + SUN,
}


def blocks(batches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns, for each block of pixels, the mean of the batches and its standard error. batches: (count, h, w, 3)."""
    count, h, w, _ = batches.shape
    each = batches.reshape(count, h // BLOCK, BLOCK, w // BLOCK, BLOCK, 3).mean((2, 4))
    return each.mean(axis=0), each.std(axis=0, ddof=1) / np.sqrt(count)


@pytest.mark.long
@grid("name", SCENES, ordinary=())
def test_the_picture_of_volpath(name: str, tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    wave = 0.5 + 0.5 * np.sin(np.arange(64) / 64 * 4 * np.pi)
    Image.fromarray(np.rint(255 * np.outer(wave, np.roll(wave, 16)))).convert("L").save(tmp_path / "waves.png")
    sensor = '<ref id="fog"/>' if name == "fog around the sensor" else ""
    grid_values = np.maximum(np.random.default_rng(2).random((9, 7, 11), np.float32) - 0.5, 0)
    mi.VolumeGrid(grid_values[..., None]).write(str(tmp_path / "plume.vol"))
    integrator = '"volpathmis"' if "plume" in name else '"volpath"'
    head = HEAD.replace("SENSOR", sensor).replace('"volpath"', integrator)
    (tmp_path / "scene.xml").write_text(head + SCENES[name] + "</scene>")
    described = read(tmp_path, "scene.xml")
    assert described.warnings == []
    scene = mi.load_file(str(tmp_path / "scene.xml"))
    theirs = np.stack([np.array(mi.render(scene, spp=SPP, seed=1 + i))[..., :3] for i in range(BATCHES)]).astype(float)
    compiled = compile_scene(described)
    ours = []
    for seed in range(BATCHES):
        settings = RenderSettings(WIDTH, HEIGHT, described.cameras[0].view, **chosen({"seed": seed}, described.defaults))
        ours.append(mean(render_frame(compiled, settings, SPP), settings.film_exponent))
    pictures = np.stack(ours)[..., :3].astype(float), theirs
    (a, first), (b, second) = (blocks(each) for each in pictures)
    z = (a - b) / np.sqrt(first**2 + second**2 + (BIAS * (b + b.mean())) ** 2)
    whole = [each.mean(axis=(1, 2, 3)) for each in pictures]
    apart = (whole[0].mean() - whole[1].mean()) / whole[1].mean()
    error = np.sqrt(sum(each.var(ddof=1) / BATCHES for each in whole)) / whole[1].mean()
    differs = np.abs(a - b).mean() / b.mean()
    print(f"{name}: blocks differ by {differs:.2%}, the mean by {apart:+.2%} ({error:.2%}), z {np.abs(z).max():.1f}")
    assert abs(apart - BRIGHTER.get(name, 0.0)) < 0.5 * BIAS + 3 * error
    assert np.sqrt((z**2).mean()) < 1.5
    assert np.abs(z).max() < 5
