"""Tests that our reader makes from a Mitsuba file the scene that Mitsuba itself renders.

Mitsuba renders both the file and our reader's scene. Our own picture may differ by 3 % where the renderers' models differ:
multiple scattering of rough metals, and smooth normals at the edge of shadow.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from renderer.film import mean
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.scene.readers.mitsuba.metals import CONDUCTORS
from renderer.settings import RenderSettings, chosen
from tests.grids import grid
from tests.peers.compare import assert_same_picture
from tests.peers.mitsuba_scene import mitsuba_dict

BATCHES = 16
SPP = 16
HEAD = """<scene version="3.0.0">
  <default name="width" value="48"/>
  <integrator type="path"><integer name="max_depth" value="5"/></integrator>
  <sensor type="SENSOR"><float name="fov" value="50"/>LENS
    <transform name="to_world"><lookat origin="0.6, 1.2, 3.6" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="$width"/><integer name="height" value="32"/><rfilter type="box"/></film>
  </sensor>
  <bsdf type="diffuse" id="white"><rgb name="reflectance" value="0.7 0.6 0.5"/></bsdf>
  <shape type="rectangle" id="floor"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/><translate y="-0.6"/>
    </transform>FLOOR</shape>
"""
SHAPES = {
    "a box under a lamp, glass and gold": (
        HEAD.replace("SENSOR", "perspective").replace("LENS", "").replace("FLOOR", '<ref id="white"/>')
        + """<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="0.6"/><translate y="2"/>
    </transform><ref id="white"/><emitter type="area"><rgb name="radiance" value="9 8 7"/></emitter></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.4"/>
    <rotate y="1" angle="30"/><translate value="-0.8 -0.2 0"/></transform>
    <bsdf type="twosided"><ref id="white"/></bsdf></shape>
  <shape type="sphere"><point name="center" value="0.2 -0.2 0.4"/><float name="radius" value="0.4"/>
    <bsdf type="roughdielectric"><string name="distribution" value="ggx"/><float name="alpha" value="0.2"/></bsdf></shape>
  <shape type="sphere"><transform name="to_world"><scale value="0.35"/><translate x="1.1"/></transform>
    <bsdf type="roughconductor"><rgb name="eta" value="0.2 0.9 1.1"/><rgb name="k" value="3.9 2.4 2.2"/>
    <string name="distribution" value="ggx"/><float name="alpha" value="0.3"/></bsdf></shape></scene>"""
    ),
    "files of meshes, textures, instances, lights without a body": (
        HEAD.replace("SENSOR", "thinlens")
        .replace("LENS", '<float name="aperture_radius" value="0.06"/><float name="focus_distance" value="3.5"/>')
        .replace(
            "FLOOR",
            '<bsdf type="diffuse"><texture type="checkerboard" name="reflectance"><rgb name="color0" value="0.1 0.2 0.6"/>'
            '<rgb name="color1" value="0.8"/><transform name="to_uv"><scale x="4" y="3"/></transform></texture></bsdf>',
        )
        + """<emitter type="constant"><rgb name="radiance" value="0.3 0.4 0.5"/></emitter>
  <emitter type="point"><point name="position" value="-2 3 1"/><rgb name="intensity" value="5 4 3"/></emitter>
  <emitter type="directional"><vector name="direction" value="1 -1 -1"/><rgb name="irradiance" value="0.3 0.4 0.5"/></emitter>
  <shape type="obj"><string name="filename" value="m.obj"/><transform name="to_world"><translate x="-0.9"/></transform>
    <include filename="painted.xml"/></shape>
  <shape type="shapegroup" id="two"><shape type="ply"><string name="filename" value="m.ply"/><include filename="painted.xml"/>
    </shape></shape>
  <shape type="instance"><ref id="two"/><transform name="to_world"><translate x="0.7"/></transform></shape>
  <shape type="instance"><ref id="two"/><transform name="to_world"><scale value="0.5"/>
    <translate x="0.2" z="1"/></transform></shape>
  <shape type="cylinder"><point name="p0" value="0 -0.5 -1.5"/><point name="p1" value="0.3 1.2 -1.5"/>
    <float name="radius" value="0.3"/>
    <bsdf type="twosided"><ref id="white"/></bsdf></shape></scene>"""
    ),
}
PAINTED = """<scene version="3.0.0"><bsdf type="twosided"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">
<string name="filename" value="t.png"/><string name="filter_type" value="nearest"/></texture></bsdf></bsdf></scene>"""


def write_files(folder: Path) -> None:
    """Writes a bent sheet as .obj and .ply, without normals, and its texture."""
    places = [(-0.6, -0.4, 0), (0.6, -0.4, 0.1), (0.6, 0.8, 0.2), (-0.6, 0.8, -0.2), (0, 0.2, 0.6)]
    uvs = [(0, 0), (1, 0), (1, 1), (0, 1), (0.5, 0.5)]
    faces = [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]
    lines = [f"v {x} {y} {z}" for x, y, z in places] + [f"vt {u} {v}" for u, v in uvs]
    lines += ["f " + " ".join(f"{i + 1}/{i + 1}" for i in face) for face in faces]
    (folder / "m.obj").write_text("\n".join(lines) + "\n")
    header = "ply\nformat ascii 1.0\nelement vertex 5\n" + "".join(f"property float {name}\n" for name in "xyzuv")
    rows = [f"{x} {y} {z} {u} {v}" for (x, y, z), (u, v) in zip(places, uvs, strict=True)]
    rows += ["3 " + " ".join(map(str, face)) for face in faces]
    (folder / "m.ply").write_text(
        header + "element face 4\nproperty list uchar int vertex_indices\nend_header\n" + "\n".join(rows) + "\n"
    )
    y, x = np.mgrid[0:32, 0:32]
    pixels = np.stack([x * 8, y * 8, np.where((x < 16) & (y < 16), 255, 40)], -1).astype(np.uint8)
    Image.fromarray(pixels).save(folder / "t.png")
    (folder / "painted.xml").write_text(PAINTED)


@pytest.mark.long
@grid("name", SHAPES, ordinary=("files of meshes, textures, instances, lights without a body",))
def test_the_same_picture_of_a_file(name: str, tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    write_files(tmp_path)
    (tmp_path / "scene.xml").write_text(SHAPES[name])
    described = read(tmp_path, "scene.xml")
    assert described.warnings == []
    settings = RenderSettings(48, 32, described.cameras[0].view, **chosen({}, described.defaults))

    def rendered(scene: Any) -> np.ndarray:
        return np.stack([np.array(mi.render(scene, spp=SPP, seed=1 + i))[..., :3] for i in range(BATCHES)]).astype(float)

    theirs = rendered(mi.load_file(str(tmp_path / "scene.xml")))
    print(assert_same_picture(rendered(mi.load_dict(mitsuba_dict(mi, described, settings, tmp_path))), theirs, most_error=0.01))
    sums = render_frame(compile_scene(described), settings, SPP * BATCHES)
    assert mean(sums, settings.film_exponent).mean() == pytest.approx(theirs.mean(), rel=0.03)


def _ball(bsdf: str) -> str:
    return f'<shape type="sphere"><float name="radius" value="0.5"/>{bsdf}</shape>'


def _bsdf(kind: str, **numbers: float | str) -> str:
    inside = "".join(
        f'<{"string" if isinstance(value, str) else "float"} name="{name}" value="{value}"/>' for name, value in numbers.items()
    )
    return f'<bsdf type="{kind}">{inside}</bsdf>'


# Scenes, and the allowed difference of blocks: rough metals differ by multiple scattering (docs/correctness.md).
PLUGINS = {
    "a bubble in water": (_ball(_bsdf("dielectric", int_ior="air", ext_ior="water")), 0.02),
    "a pane": (_ball(_bsdf("thindielectric")), 0.02),
    "silver": (_ball(_bsdf("conductor", material="Ag")), 0.01),
    "chromium": (_ball(_bsdf("conductor", material="Cr")), 0.01),
    "a metal of no name": (_ball(_bsdf("roughconductor", distribution="ggx", alpha=0.05)), 0.02),
    "brushed metal": (_ball(_bsdf("roughconductor", distribution="ggx", alpha_u=0.02, alpha_v=0.1, material="Al")), 0.03),
    "rough plastic": (_ball(_bsdf("roughplastic", distribution="ggx", alpha=0.2)), 0.02),
    "very rough plastic": (_ball(_bsdf("roughplastic", distribution="ggx", alpha=1.0)), 0.02),
    "plastic of Beckmann's facets": (_ball(_bsdf("roughplastic", alpha=0.2)), 0.02),
    "metal of Beckmann's facets": (_ball(_bsdf("roughconductor", alpha=0.15, material="Au")), 0.02),
    "glass of Beckmann's facets": (_ball(_bsdf("roughdielectric", alpha=0.2)), 0.02),
    "principled": (_ball(_bsdf("principled", roughness=0.3)), 0.025),
    "a principled coat": (_ball(_bsdf("principled", clearcoat=1, clearcoat_gloss=0.5)), 0.025),
    "a principled sheen": (_ball(_bsdf("principled", sheen=1)), 0.03),
    "a principled metal": (_ball(_bsdf("principled", metallic=1, roughness=0.25)), 0.02),
    "principled glass": (_ball(_bsdf("principled", spec_trans=1, roughness=0.2)), 0.02),
    "a principled leaf": (_ball(_bsdf("principledthin", diff_trans=1)), 0.02),
}


@pytest.mark.long
@pytest.mark.parametrize("name", PLUGINS)
def test_a_plugin_shows_the_same(name: str, tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    shape, most = PLUGINS[name]
    light = """<emitter type="constant"><rgb name="radiance" value="0.4 0.45 0.5"/></emitter>
  <emitter type="directional"><vector name="direction" value="1 -1 -1"/><rgb name="irradiance" value="1.5 1.4 1.3"/></emitter>"""
    head = HEAD.replace("SENSOR", "perspective").replace("LENS", "").replace("FLOOR", '<ref id="white"/>')
    (tmp_path / "scene.xml").write_text(head.replace('value="5"', 'value="8"') + light + shape + "</scene>")
    described = read(tmp_path, "scene.xml")
    settings = RenderSettings(48, 32, described.cameras[0].view, **chosen({}, described.defaults))
    theirs = np.array(mi.render(mi.load_file(str(tmp_path / "scene.xml")), spp=256), float)[..., :3]
    sums = render_frame(compile_scene(described), settings, 256)
    blocks = [
        picture.reshape(8, 4, 12, 4, 3).mean((1, 3))
        for picture in (np.asarray(mean(sums, settings.film_exponent), float), theirs)
    ]
    assert np.abs(blocks[0] - blocks[1]).mean() / blocks[1].mean() < most


def test_conductors_are_those_of_mitsuba() -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    for name in ("Ag", "Cr", "TiN", "W"):
        found = mi.traverse(mi.load_dict({"type": "conductor", "material": name}))
        for key, expected in zip(("eta.value", "k.value"), CONDUCTORS[name], strict=True):
            assert np.array(found[key]).ravel() == pytest.approx(expected, abs=1e-3)
