"""Tests of rough surfaces with Beckmann facets in Mitsuba's format, alone and wrapped in other BSDFs, against Mitsuba's pictures.

Mitsuba loses light that hits a second facet, while our BSDF reflects it, so tolerances for rough metals and glass are a few per
cent.
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

SPP = 512
HEAD = """<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="8"/></integrator>
<sensor type="perspective"><float name="fov" value="40"/>
<transform name="to_world"><lookat origin="1, 1.2, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="48"/><integer name="height" value="32"/><rfilter type="box"/></film></sensor>"""
SPOT = """<emitter type="spot"><transform name="to_world"><lookat origin="{}" target="0, 0, 0" up="0, 1, 0"/></transform>
<rgb name="intensity" value="20"/><float name="cutoff_angle" value="40"/><float name="beam_width" value="30"/></emitter>"""
ABOVE, BEHIND = SPOT.format("-1, 2, 3"), SPOT.format("-0.5, 0.4, -3")
SKY = """<emitter type="constant"><rgb name="radiance" value="0.4 0.45 0.5"/></emitter>
<emitter type="directional"><vector name="direction" value="1 -1 -1"/><rgb name="irradiance" value="1.5 1.4 1.3"/></emitter>"""
WALL, BALL = '<shape type="rectangle">{}</shape>', '<shape type="sphere">{}</shape>'
GOLD, BLUE = '<string name="material" value="Au"/>', '<bsdf type="diffuse"><rgb name="reflectance" value="0.1 0.2 0.7"/></bsdf>'
MAPPED = '<texture type="bitmap" name="{}"><boolean name="raw" value="true"/><string name="filename" value="{}.png"/></texture>'


def _rough(kind: str, alpha: float | str, inside: str = "") -> str:
    rough = alpha if isinstance(alpha, str) else f'<float name="alpha" value="{alpha}"/>'
    return f'<bsdf type="{kind}"><string name="distribution" value="beckmann"/>{rough}{inside}</bsdf>'


def _bent(inner: str) -> str:
    unshadowed = '<boolean name="use_shadowing_function" value="false"/>'
    return f'<bsdf type="normalmap">{MAPPED.format("normalmap", "waves")}{unshadowed}{inner}</bsdf>'


BRUSHED = '<float name="alpha_u" value="0.08"/><float name="alpha_v" value="0.3"/>'
BLEND = '<bsdf type="blendbsdf"><float name="weight" value="0.4"/>{}{}</bsdf>'
SAMPLE_ALL = '<boolean name="sample_visible" value="false"/>'
BOTH_SIDES = f'<bsdf type="twosided">{_rough("roughplastic", 0.3)}</bsdf>'  # one-sided materials are black inside in Mitsuba
# Scene, and the allowed difference of the mean and of blocks of the picture.
CASES = {
    "glass under a spot": (ABOVE + BEHIND + WALL.format(_rough("roughdielectric", 0.3)), 0.03, 0.04),
    "a ball of glass under a spot": (ABOVE + BEHIND + BALL.format(_rough("roughdielectric", 0.3)), 0.04, 0.06),
    "metal with a normal map": (SKY + WALL.format(_bent(_rough("roughconductor", 0.2, GOLD))), 0.02, 0.03),
    "a metal ball with a normal map": (SKY + BALL.format(_bent(_rough("roughconductor", 0.2, GOLD))), 0.035, 0.04),
    "plastic": (SKY + ABOVE + BALL.format(_rough("roughplastic", 0.3)), 0.02, 0.03),
    "nonlinear plastic": (
        SKY + BALL.format(_rough("roughplastic", 0.3, '<boolean name="nonlinear" value="true"/>')),
        0.02,
        0.03,
    ),
    "brushed metal": (SKY + ABOVE + WALL.format(_rough("roughconductor", BRUSHED, GOLD)), 0.03, 0.04),
    "all facets sampled": (SKY + BALL.format(_rough("roughconductor", 0.2, GOLD + SAMPLE_ALL)), 0.02, 0.03),
    "glass of all facets sampled": (ABOVE + BEHIND + WALL.format(_rough("roughdielectric", 0.3, SAMPLE_ALL)), 0.03, 0.04),
    "a picture of roughness": (
        SKY + ABOVE + WALL.format(_rough("roughconductor", MAPPED.format("alpha", "ramp"), GOLD)),
        0.03,
        0.04,
    ),
    "both sides of metal": (
        SKY + ABOVE + BALL.format(f'<bsdf type="twosided">{_rough("roughconductor", 0.2, GOLD)}</bsdf>'),
        0.02,
        0.03,
    ),
    "a blend of paint and metal": (SKY + BALL.format(BLEND.format(BLUE, _rough("roughconductor", 0.2, GOLD))), 0.02, 0.03),
    "a mask over plastic": (
        SKY + BALL.format(f'<bsdf type="mask"><float name="opacity" value="0.6"/>{BOTH_SIDES}</bsdf>'),
        0.02,
        0.03,
    ),
    "both sides of a bent blend": (
        SKY + WALL.format(f'<bsdf type="twosided">{_bent(BLEND.format(BLUE, _rough("roughconductor", 0.2, GOLD)))}</bsdf>'),
        0.02,
        0.03,
    ),
}


def _write_pictures(folder: Path) -> None:
    """Writes the scene's textures: a normal map of waves, and a ramp of roughness."""
    y, x = np.mgrid[0:64, 0:64] / 64
    slope = np.stack([0.3 * np.sin(4 * np.pi * x), 0.3 * np.sin(4 * np.pi * y), np.ones_like(x)], -1)
    normals = slope / np.linalg.norm(slope, axis=-1, keepdims=True)
    Image.fromarray(np.round((normals + 1) * 127.5).astype(np.uint8)).save(folder / "waves.png")
    Image.fromarray(np.round(255 * (0.1 + 0.3 * x)).astype(np.uint8)).save(folder / "ramp.png")


def pictures(name: str, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Returns our picture and Mitsuba's."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    _write_pictures(folder)
    head = HEAD.replace('"path"', '"volpath"') if "mask" in name else HEAD  # volpath's shadow rays pass masks
    (folder / "scene.xml").write_text(head + CASES[name][0] + "</scene>")
    described = read(folder, "scene.xml")
    assert described.warnings == []
    settings = RenderSettings(48, 32, described.cameras[0].view, **chosen({}, described.defaults))
    theirs = np.array(mi.render(mi.load_file(str(folder / "scene.xml")), spp=SPP), float)[..., :3]
    sums = render_frame(compile_scene(described), settings, SPP)
    return np.asarray(mean(sums, settings.film_exponent), float), theirs


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_beckmanns_facets_look_as_in_mitsuba(name: str, tmp_path: Path) -> None:
    ours, theirs = pictures(name, tmp_path)
    blocks = [picture.reshape(8, 4, 12, 4, 3).mean((1, 3)) for picture in (ours, theirs)]
    ratio, apart = ours.mean() / theirs.mean(), np.abs(blocks[0] - blocks[1]).mean() / blocks[1].mean()
    print(f"{name}: {ratio - 1:+.2%} of the mean, blocks {apart:.2%} apart")
    assert abs(ratio - 1) < CASES[name][1]
    assert apart < CASES[name][2]
