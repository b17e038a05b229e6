"""Tests that the scene that our reader makes from a pbrt file is the one that Mitsuba renders from an equal file of its format.

pbrt is not available for comparison. What both formats can express is compared with Mitsuba's picture: the left-handed world and
its camera, transforms, shapes, textures, lights and their scales, metals, glass and paint under varnish.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from renderer.film import mean
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings, chosen
from tests.grids import grid
from tests.peers.test_mitsuba_files import write_files
from tests.renderer.scene.pbrt_files import SQUARE

BATCHES = 16
CUBE = (
    "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 12\nproperty list uchar int vertex_indices\nend_header\n"
    + "".join(f"{x} {y} {z}\n" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1))
    + "".join(
        f"3 {a} {b} {c}\n3 {a} {c} {d}\n"
        for a, b, c, d in ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    )
)
SPP = 16
XML = """<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="5"/></integrator>
<sensor type="SENSOR"><float name="fov" value="36.87"/><string name="fov_axis" value="y"/>LENS
<transform name="to_world"><scale x="-1"/><lookat origin="0.6, 1.2, 3.6" target="0, 0, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="48"/><integer name="height" value="32"/><rfilter type="box"/></film></sensor>
<bsdf type="diffuse" id="white"><rgb name="reflectance" value="0.7 0.6 0.5"/></bsdf>"""
# The camera mirrors, as pbrt's does, from the same position.
BOX = (
    XML.replace("SENSOR", "perspective").replace("LENS", "")
    + """<shape type="rectangle">
<transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/><translate y="-0.6"/></transform>
<bsdf type="diffuse"><texture type="checkerboard" name="reflectance"><rgb name="color0" value="0.1 0.2 0.6"/>
<rgb name="color1" value="0.8"/><transform name="to_uv"><scale x="2" y="1.5"/></transform></texture></bsdf></shape>
<shape type="rectangle">
<transform name="to_world"><scale value="0.6"/><rotate x="1" angle="90"/><translate y="2"/></transform>
<ref id="white"/><emitter type="area"><rgb name="radiance" value="9 8 7"/></emitter></shape>
<shape type="sphere"><point name="center" value="0.2 -0.2 0.4"/><float name="radius" value="0.4"/>
<bsdf type="roughdielectric"><string name="distribution" value="ggx"/><float name="alpha" value="0.2"/>
<float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf></shape>
<shape type="sphere"><transform name="to_world"><scale value="0.35"/><translate x="1.1"/></transform>
<bsdf type="roughconductor"><rgb name="eta" value="0.2 0.9 1.1"/><rgb name="k" value="3.9 2.4 2.2"/>
<string name="distribution" value="ggx"/><float name="alpha" value="0.1"/></bsdf></shape>
<shape type="cylinder">
<point name="p0" value="-1 -0.6 -0.8"/><point name="p1" value="-1 0.6 -0.8"/><float name="radius" value="0.3"/>
<bsdf type="twosided"><ref id="white"/></bsdf></shape></scene>"""
)
OPEN = (
    XML.replace("SENSOR", "thinlens").replace(
        "LENS", '<float name="aperture_radius" value="0.06"/><float name="focus_distance" value="3.5"/>'
    )
    + """<emitter type="constant"><rgb name="radiance" value="0.3 0.4 0.5"/></emitter>
<emitter type="point"><point name="position" value="-2 3 1"/><rgb name="intensity" value="5 4 3"/></emitter>
<emitter type="directional"><vector name="direction" value="1 -1 -1"/><rgb name="irradiance" value="0.3 0.4 0.5"/></emitter>
<shape type="rectangle">
<transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/><translate y="-0.6"/></transform>
<ref id="white"/></shape>
<shape type="ply"><string name="filename" value="m.ply"/><boolean name="face_normals" value="true"/>
<transform name="to_world"><translate x="0.7"/></transform><bsdf type="twosided"><ref id="white"/></bsdf></shape>
<shape type="ply"><string name="filename" value="m.ply"/><boolean name="face_normals" value="true"/>
<transform name="to_world"><scale value="0.5"/><rotate y="1" angle="40"/><translate x="-0.8" z="0.5"/></transform>
<bsdf type="twosided"><bsdf type="plastic"><rgb name="diffuse_reflectance" value="0.6 0.3 0.1"/>
<float name="int_ior" value="1.5"/>
<float name="ext_ior" value="1"/><boolean name="nonlinear" value="true"/></bsdf></bsdf></shape></scene>"""
)
HEAD = """Film "rgb" "integer xresolution" 48 "integer yresolution" 32 Integrator "path" "integer maxdepth" 4 PixelFilter "box"
LookAt 0.6 1.2 3.6  0 0 0  0 1 0 Camera "perspective" "float fov" 36.87 LENS WorldBegin
MakeNamedMaterial "white" "string type" "diffuse" "rgb reflectance" [.7 .6 .5]
"""
PBRT_BOX = (
    HEAD.replace("LENS", "")
    + f"""
Texture "squares" "spectrum" "checkerboard" "float uscale" 4 "float vscale" 3 "rgb tex1" [.1 .2 .6] "rgb tex2" [.8 .8 .8]
AttributeBegin Translate 0 -.6 0 Rotate -90 1 0 0 Scale 3 3 3
Material "diffuse" "texture reflectance" "squares" {SQUARE} AttributeEnd
NamedMaterial "white"
AttributeBegin AreaLightSource "diffuse" "rgb L" [4.5 4 3.5] "float scale" 2 Translate 0 2 0 Rotate 90 1 0 0
Scale .6 .6 .6 {SQUARE} AttributeEnd
AttributeBegin Translate .2 -.2 .4 Material "dielectric" "float roughness" .04 Shape "sphere" "float radius" .4 AttributeEnd
AttributeBegin Translate 1.1 0 0 Scale .35 .35 .35
Material "conductor" "rgb eta" [.2 .9 1.1] "rgb k" [3.9 2.4 2.2] "float roughness" .1 "bool remaproughness" false Shape "sphere"
AttributeEnd
AttributeBegin Translate -1 0 -.8 Rotate -90 1 0 0 Shape "cylinder" "float radius" .3
"float zmin" -.6 "float zmax" .6 AttributeEnd
"""
)
PBRT_OPEN = (
    HEAD.replace("LENS", '"float lensradius" .06 "float focaldistance" 3.5')
    + f"""LightSource "infinite" "rgb L" [.3 .4 .5]
LightSource "point" "point3 from" [-2 3 1] "rgb I" [5 4 3]
LightSource "distant" "point3 to" [1 -1 -1] "rgb L" [.3 .4 .5]
NamedMaterial "white" AttributeBegin Translate 0 -.6 0 Rotate -90 1 0 0 Scale 3 3 3 {SQUARE} AttributeEnd
ObjectBegin "sheet" Shape "plymesh" "string filename" "m.ply" ObjectEnd
AttributeBegin Translate .7 0 0 ObjectInstance "sheet" AttributeEnd
Material "coateddiffuse" "rgb reflectance" [.6 .3 .1] "float thickness" 0 "integer maxdepth" 100
Translate -.8 0 .5 Rotate 40 0 1 0 Scale .5 .5 .5 Shape "plymesh" "string filename" "m.ply"
"""
)
_FILLED = """<medium type="homogeneous" name="{}"><rgb name="albedo" value="{}"/><float name="sigma_t" value="{}"/>
<phase type="hg"><float name="g" value="{}"/></phase></medium>"""
MEDIA = (
    XML.replace("SENSOR", "perspective").replace("LENS", "").replace('"path"', '"volpath"').replace('value="5"', 'value="32"')
    + f"""<emitter type="constant"><rgb name="radiance" value="0.3 0.4 0.5"/></emitter>
<shape type="rectangle">
<transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/><translate y="-0.6"/></transform>
<ref id="white"/></shape>
<shape type="sphere"><point name="center" value="-0.5 0 0"/><float name="radius" value="0.5"/>
<bsdf type="dielectric"><float name="int_ior" value="1.4"/><float name="ext_ior" value="1"/></bsdf>
{_FILLED.format("interior", "0.95 0.9 0.6", 5, 0.3)}</shape>
<shape type="ply"><string name="filename" value="cube.ply"/>
<transform name="to_world"><scale value="0.4"/><rotate y="1" angle="30"/><translate x="0.8"/></transform>
<bsdf type="null"/>{_FILLED.format("interior", "0.9 0.5 0.25", 4, -0.4)}</shape></scene>"""
)
PBRT_MEDIA = (
    HEAD.replace("LENS", "").replace('"path" "integer maxdepth" 4', '"volpath" "integer maxdepth" 31')
    + f"""LightSource "infinite" "rgb L" [.3 .4 .5]
NamedMaterial "white" AttributeBegin Translate 0 -.6 0 Rotate -90 1 0 0 Scale 3 3 3 {SQUARE} AttributeEnd
MakeNamedMedium "milk" "string type" "homogeneous" "rgb sigma_a" [.25 .5 2] "rgb sigma_s" [4.75 4.5 3] "float g" .3
MakeNamedMedium "smoke" "string type" "homogeneous" "rgb sigma_a" [.2 1 1.5] "rgb sigma_s" [1.8 1 .5] "float scale" 2
"float g" -.4
AttributeBegin Translate -.5 0 0 MediumInterface "milk" "" Material "dielectric" "float eta" 1.4
Shape "sphere" "float radius" .5 AttributeEnd
AttributeBegin Translate .8 0 0 Rotate 30 0 1 0 Scale .4 .4 .4 MediumInterface "smoke" "" Material "interface"
Shape "plymesh" "string filename" "cube.ply" AttributeEnd
"""
)
SCENES = {
    "media": (MEDIA, PBRT_MEDIA),
    "a box, textured, glass and metal": (BOX, PBRT_BOX),
    "files of meshes, a lens, lights without a body": (OPEN, PBRT_OPEN),
}


@pytest.mark.long
@grid("name", SCENES, ordinary=("a box, textured, glass and metal",))
def test_the_same_picture_of_a_scene_in_both_formats(name: str, tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    write_files(tmp_path)
    (tmp_path / "cube.ply").write_text(CUBE)
    xml, pbrt = SCENES[name]
    (tmp_path / "scene.xml").write_text(xml)
    (tmp_path / "scene.pbrt").write_text(pbrt)
    described = read(tmp_path, "scene.pbrt")
    assert described.warnings == []
    settings = RenderSettings(48, 32, described.cameras[0].view, **chosen({}, described.defaults))

    def rendered(scene: Any) -> np.ndarray:
        return np.stack([np.array(mi.render(scene, spp=SPP, seed=1 + i))[..., :3] for i in range(BATCHES)]).astype(float)

    theirs = rendered(mi.load_file(str(tmp_path / "scene.xml")))
    sums = render_frame(compile_scene(described), settings, SPP * BATCHES)
    ours = mean(sums, settings.film_exponent)
    assert ours.mean() == pytest.approx(theirs.mean(), rel=0.03)
    blocks = [each.reshape(4, 8, 6, 8, 3).mean(axis=(1, 3)) for each in (ours, theirs.mean(axis=0))]
    np.testing.assert_allclose(blocks[0], blocks[1], rtol=0.12, atol=0.03 * theirs.mean())
