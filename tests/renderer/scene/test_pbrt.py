"""Tests of pbrt-v4 files: statements, transforms, objects, cameras and films; what warnings name, and what is refused."""

import gzip
import math
import random
import re

import numpy as np
import pytest

from renderer.arrays import rows
from renderer.arrays.kernel_variant import variant_of
from renderer.errors import SceneError
from renderer.scene.animation import Moment
from renderer.scene.compile import compile_scene
from renderer.scene.curve_meshes import has_curves, with_tubes
from renderer.scene.frame_reuse import ShotCache
from renderer.scene.load import Shot, read
from renderer.scene.studio import NO_LIGHTS_WARNING
from tests.renderer.scene.pbrt_files import BALL, HEAD, SQUARE, world


@pytest.fixture
def pbrt(scene):
    """Returns a function `pbrt(inside, others)` that reads a scene file with these statements in its world block."""
    return lambda inside, others=None, head=HEAD, **options: scene("scene.pbrt", world(inside, head), others, **options)


def places(description):
    return [i.transform[:3, 3].round(6).tolist() for i in description.instances]


def test_the_film_the_sampler_and_the_camera(pbrt):
    found = pbrt(BALL)
    assert found.warnings == [NO_LIGHTS_WARNING]
    assert found.defaults == {"width": 48, "height": 32, "spp": 16, "max_depth": 5, "transmission_depth": 0, "filter": "box"}
    view = found.cameras[0].view
    # pbrt's world is left-handed, so the scene is mirrored; its fov is along the shorter side.
    assert view.eye == pytest.approx((-0.6, 1.2, 3.6))
    assert view.fov == pytest.approx(36.87)
    upright = pbrt(BALL, head=HEAD.replace('yresolution" [ 32 ]', 'yresolution" 96'))
    assert math.tan(math.radians(upright.cameras[0].view.fov / 2)) == pytest.approx(2 * math.tan(math.radians(36.87 / 2)))
    mirrored = pbrt("Translate 1 0 0 " + BALL, head="Scale -1 1 1 " + HEAD)
    assert mirrored.cameras[0].view.eye == pytest.approx((0.6, 1.2, 3.6))
    assert mirrored.spheres[0].center == (1.0, 0.0, 0.0)
    assert pbrt("Translate 1 0 0 " + BALL).spheres[0].center == (-1.0, 0.0, 0.0)


def test_pbrt_defaults(pbrt):
    found = pbrt(BALL, head='Camera "perspective" WorldBegin ')
    # pbrt's default Gaussian filter is as wide as a tent filter of two pixels.
    assert found.defaults == {"width": 1280, "height": 720, "spp": 16, "max_depth": 6, "transmission_depth": 0, "filter": "tent"}
    assert found.cameras[0].view.fov == pytest.approx(90)
    assert found.materials[0].base_color == (0.5, 0.5, 0.5)
    shade = pbrt(
        BALL, head='Integrator "ambientocclusion" "float maxdistance" 3 "bool cossample" true ' + HEAD.replace("path", "ao")
    )
    assert (shade.defaults["integrator"], shade.defaults["ao_distance"]) == ("ao", 3)
    assert pbrt(BALL, head='ColorSpace "Rec2020" ' + HEAD).spheres


@pytest.mark.parametrize(
    ("head", "sentence"),
    [
        ('PixelFilter "mitchell"', "filtered by a tent"),
        ('PixelFilter "triangle"', "is rendered two pixels wide, not 4 by 4"),
        ('Film "spectral"', "is replaced by a film of linear RGB"),
        ('Film "rgb" "float whitebalance" 4500', "strongly coloured surfaces"),
        ('Option "bool forcediffuse" true', "forcediffuse is ignored"),
        ('Option "disable-pixel-jitter" true', "disablepixeljitter is ignored"),
        ('Option "string colour" "warm"', "The option 'string colour' is unknown and ignored"),
        ('Sampler "magic" "integer pixelsamples" 4', "sampler 'magic' is unknown: only its sample count is used"),
        ('Sampler "sobol" "float blur" 4', "'blur' of sampler 'sobol' is ignored"),
    ],
)
def test_unsupported_head_statements_are_named(pbrt, head, sentence):
    assert any(re.search(sentence, each) for each in pbrt(BALL, head=HEAD.replace("WorldBegin", f"{head} WorldBegin")).warnings)


def test_attribute_directive_errors(pbrt):
    with pytest.raises(SceneError, match="Attribute applies to shape, light, material, medium, texture"):
        pbrt(f'Attribute "shapes" "float radius" 2 {BALL}')


def test_lens_and_screen_window(pbrt):
    head = HEAD.replace('"float fov" [36.87]', '"float fov" 50 "float lensradius" 0.1 "float focaldistance" 3')
    view = pbrt(BALL, head=head).cameras[0].view
    assert (view.aperture, view.focus) == (pytest.approx(0.1), pytest.approx(3))
    flat = HEAD.replace('"perspective" "float fov" [36.87]', '"orthographic" "float screenwindow" [-3 3 -2 2]')
    assert pbrt(BALL, head=flat).cameras[0].view.height == pytest.approx(4)
    shifted = pbrt(BALL, head=flat.replace("-3 3 -2 2", "-2 4 -1 3")).cameras[0].view
    assert (shifted.shift_x, shifted.shift_y, shifted.height) == (0.25, 0.25, pytest.approx(4))


def test_transformations_and_blocks(pbrt):
    found = pbrt(
        f"""AttributeBegin
          Translate 1 2 3 Rotate 90 0 0 1 Scale 2 2 2
          CoordinateSystem "here"
          {SQUARE}
        AttributeEnd
        {SQUARE}
        Transform [1 0 0 0 0 1 0 0 0 0 1 0 7 8 9 1] {SQUARE}
        ConcatTransform [1 0 0 0 0 1 0 0 0 0 1 0 1 0 0 1] {SQUARE}
        CoordSysTransform "here" {SQUARE}
        TransformBegin Identity TransformEnd {SQUARE}""",
        head="Scale -1 1 1 " + HEAD,
    )
    assert places(found) == [[1, 2, 3], [0, 0, 0], [7, 8, 9], [8, 8, 9], [1, 2, 3], [1, 2, 3]]
    np.testing.assert_allclose(found.instances[0].transform[:3, :3], [[0, -2, 0], [2, 0, 0], [0, 0, 2]], atol=1e-12)


def test_object_instances(pbrt):
    found = pbrt(
        f"""ObjectBegin "pair" Translate 1 0 0 {SQUARE} {BALL} "float radius" 0.5 ObjectEnd
        ObjectInstance "pair"
        Scale 2 2 2 Translate 0 1 0 ObjectInstance "pair" Scale 1 2 1 ObjectInstance "pair" """,
        head="Scale -1 1 1 " + HEAD,
    )
    assert places(found) == [[1, 0, 0], [2, 2, 0], [2, 2, 0], [2, 2, 0]]
    assert [(s.center, s.radius) for s in found.spheres] == [((1.0, 0.0, 0.0), 0.5), ((2.0, 2.0, 0.0), 1.0)]
    assert found.instances[0].mesh == found.instances[1].mesh
    squeezed = found.instances[3]  # the ball under a non-uniform scale
    assert np.ptp(found.meshes[squeezed.mesh].positions @ squeezed.transform[:3, :3].T, axis=0) == pytest.approx(
        [2, 4, 2], rel=1e-3
    )


def test_includes(pbrt):
    others = {
        "parts/m.pbrt": 'MakeNamedMaterial "red" "string type" "diffuse" "rgb reflectance" [.8 .1 .1]',
        "parts/g.pbrt.gz": gzip.compress(f'Material "diffuse" Translate 5 0 0 {BALL}'.encode()),
    }
    found = pbrt(f'Include "parts/m.pbrt" Import "parts/g.pbrt.gz" NamedMaterial "red" {BALL}', others)
    assert [s.center for s in found.spheres] == [(-5.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
    assert found.materials[found.spheres[1].material].base_color == (0.8, 0.1, 0.1)


def test_attribute_defaults(pbrt):
    found = pbrt(
        f'Attribute "shape" "float radius" 3 Attribute "material" "rgb reflectance" [.2 .3 .4] Material "diffuse" {BALL}'
    )
    assert found.spheres[0].radius == 3
    assert found.materials[0].base_color == (0.2, 0.3, 0.4)


def test_ply_and_gzipped_ply(pbrt):
    rows = "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"
    header = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {n}\n" for n in "xyzuv")
    ply = (header + "element face 1\nproperty list uchar int vertex_indices\nend_header\n" + rows).encode()
    shapes = 'Shape "plymesh" "string filename" "m.ply" Shape "plymesh" "string filename" "m.ply.gz"'
    found = pbrt(shapes, {"m.ply": ply, "m.ply.gz": gzip.compress(ply)})
    for mesh in found.meshes:
        assert mesh.positions.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
        assert mesh.uvs.tolist() == [[0, 1], [1, 1], [0, 0]]
        assert mesh.normals is None


def test_motion_while_the_shutter_is_open(tmp_path):
    inside = f"""ActiveTransform EndTime Translate 2 0 0 Rotate 90 0 0 1 ActiveTransform All {SQUARE}
        AttributeBegin Identity {SQUARE} AttributeEnd LightSource "infinite" """
    (tmp_path / "scene.pbrt").write_text(world(inside, "Scale -1 1 1 " + HEAD))
    shot = Shot(tmp_path, "scene.pbrt")
    found = shot.scene_at(Moment(0))
    assert found.moves
    assert found.defaults["shutter"] == 1
    assert found.instances[0].transform[0, 3] == 1
    np.testing.assert_allclose(found.instances[0].transform[:2, 0], [math.sqrt(0.5)] * 2, atol=1e-12)
    over = shot.over_shutter()
    assert [key[0, 3] for key in (over.instances[0].keys[0], over.instances[0].keys[-1])] == [0, 2]
    assert not over.instances[1].keys


@pytest.mark.parametrize(
    ("inside", "sentence"),
    [
        ('Material "measured" "string filename" "a.bsdf"' + BALL, "line 9: material 'measured' is not supported: .*grey diffuse"),
        (BALL + '\nLightSource "beam" "string filename" "a.png"', "line 10: light 'beam' is not supported as a light"),
        (BALL + '\nLightSource "projection"', "line 10: A projection light without an image is left out"),
        (
            'Material "interface"\n' * 2 + BALL + '\nMaterial "diffuse"' + BALL,
            "line 11: A surface without a material, and with no",
        ),
        (BALL + ' "float bogus" 3', "'bogus' of shape 'sphere' is ignored"),
        ('PixelFilter "box" "float xradius" 3 ' + BALL, "'xradius' of filter 'box' is ignored"),
        (
            'Texture "n" "spectrum" "marble" Material "diffuse" "texture reflectance" "n"' + BALL,
            "'marble' is not supported: a constant value is used",
        ),
        (
            'Texture "t" "spectrum" "imagemap" "string filename" "gone.png" Material "diffuse" "texture reflectance" "t"' + BALL,
            "gone.png",
        ),
        (BALL + ' "float radius" [1 2]', "'radius' of shape 'sphere' has 2 numbers: the first 1 are used"),
        (BALL + ' "float radius" 1 "float radius" 2', "'radius' of shape 'sphere' is given more than once: the last"),
        ('Attribute "shape" "float radios" 2 ' + BALL, "'radios' of Attribute 'shape' is ignored"),
        ('MakeNamedMaterial "m" "string type" "diffuse"\n' * 2 + BALL, "line 10: The material 'm' is redefined"),
        ('Texture "t" "float" "constant"\n' * 2 + BALL, "line 10: The texture 't' is redefined"),
        ('MakeNamedMedium "m" "string type" "homogeneous"\n' * 2 + BALL, "line 10: The medium 'm' is redefined"),
        ('Shape "curve" "point3 P" [0 0 0 1 0 0 1 1 0 2 1 0] "string type" "square"', "curves of type square"),
    ],
)
def test_unsupported_content_is_named_with_its_line(pbrt, inside, sentence):
    inside = inside.replace('"measured"', '"measured"')
    assert any(re.search(sentence, warning) for warning in pbrt(inside).warnings)


def test_unused_materials_cause_no_warning(pbrt):
    """Materials and textures that no shape uses, and that scene files often keep, cause no warning."""
    unused = 'Texture "t" "spectrum" "imagemap" "string filename" "gone.png" MakeNamedMaterial "m" "string type" "diffuse" '
    found = pbrt(unused + '"texture reflectance" "t"' + BALL)
    assert not any("line" in warning for warning in found.warnings)


@pytest.mark.parametrize(
    ("inside", "sentence"),
    [
        ('Include "../../secret.pbrt"', "line 9: includes 'secret.pbrt', which is not among"),
        ('Include "scene.pbrt"', "has a second WorldBegin"),
        ('Shape "plymesh" "string filename" "/etc/passwd"', "line 9: 'passwd' is not among the files"),
        ('NamedMaterial "steel"', "line 9: there is no material 'steel'"),
        (
            '\nMaterial "diffuse" "texture reflectance" "t"' + BALL,
            "line 10: .* no spectrum texture of this name is defined before it",
        ),
        (BALL + ' "float radius" [1 2', "a list in brackets is not closed; close it with ]"),
        (BALL + ' "float radius" 2 wide', "'wide' is not a directive of pbrt-v4; convert older scenes with `pbrt --upgrade`"),
        (BALL + ' "float radius" [ wide ]', "line 9: 'wide' is not a number; correct it"),
        (BALL + ' "float radius" [ 1e999 ]', "infinite"),
        (BALL + ' "float radius" [' + " 1" * 2000 + " wide 2 ]", "line 9: 'wide' is not a number; correct it"),
        (BALL + ' "float radius" [' + " 1" * 2000 + " nan ]", "a number is infinite or NaN; correct it"),
        (BALL + ' "float radius" "2"', "'radius' of Shape needs numbers"),
        (BALL + ' "point3 radius" [1 2 3]', "'radius' of shape 'sphere' has the type point3"),
        (BALL + ' "radius" 2', 'is not a parameter; write a type and a name, such as "float radius"'),
        (BALL + ' "float radius"', "a parameter without a value"),
        ("Shape", 'line 9: Shape needs 1 name in quotes, such as "diffuse"'),
        (SQUARE.replace("0 2 3]", "0 2 4]"), "has the index 4, but only 4 points"),
        (SQUARE.replace("0 2 3]", "0 2]"), "a multiple of 3"),
        ("Translate 1 2", "Translate needs 3 numbers"),
        ("Scale 1 0 1 " + BALL, "a scale is 0"),
        ("AttributeBegin" + " " + BALL, "AttributeBegin is not closed"),
        ("AttributeEnd", "has no matching AttributeBegin"),
        ('ObjectInstance "a"', "there is no object 'a'"),
        ('ObjectBegin "a" ObjectBegin "b"', "an object cannot be defined within another; end the first one before"),
        ("WorldBegin", "has a second WorldBegin; remove it"),
        ("Sphere 1 -1 1 360", "'Sphere' is not a directive of pbrt-v4; convert older scenes with `pbrt --upgrade`"),
        ('ColorSpace "prophoto"', "is not a colour space of pbrt; known are"),
        ('LightSource "point" "blackbody I" -3', "the temperature of a blackbody must be above 0 kelvin"),
        (
            'Material "conductor" "spectrum eta" "metal-Unobtainium-eta" ' + BALL,
            "is neither a known spectrum nor a file of the scene; add the file",
        ),
        ("\x00", "line 9: "),
        ("", "has no surface"),
    ],
)
def test_non_scene_file_is_rejected(pbrt, inside, sentence):
    with pytest.raises(SceneError, match=sentence):
        pbrt(inside)


def test_file_without_world_is_rejected(scene):
    with pytest.raises(SceneError, match="no WorldBegin"):
        scene("scene.pbrt", 'Film "rgb"')
    with pytest.raises(SceneError, match="line 1: Shape comes before WorldBegin; move it behind"):
        scene("scene.pbrt", BALL)
    with pytest.raises(SceneError, match="in place of a directive"):
        scene("scene.pbrt", "12 13")
    with pytest.raises(SceneError, match="could not be unpacked"):
        scene("scene.pbrt", world('Include "a.pbrt.gz"'), {"a.pbrt.gz": b"nothing packed"})


def test_damaged_files_are_read_or_rejected(tmp_path):
    """Files with changed, dropped or doubled characters yield a scene or a SceneError."""
    inside = f"""AttributeBegin AreaLightSource "diffuse" "rgb L" [9 8 7] Translate 0 2 0 {SQUARE} AttributeEnd
        Texture "c" "spectrum" "checkerboard" "float uscale" 4 "rgb tex1" [.1 .2 .3] Material "diffuse" "texture reflectance" "c"
        {SQUARE} Material "conductor" "float roughness" .1 {BALL} "float zmax" 0.5
        Shape "loopsubdiv" "integer indices" [0 1 2 0 2 3] "point3 P" [0 0 0 1 0 0 1 1 1 0 1 0] "integer levels" 2
        Shape "curve" "point3 P" [0 0 0 1 0 0 1 1 0 2 1 0] LightSource "infinite" "blackbody L" 3000 """
    text = world(inside)
    dice, outcomes = random.Random(7), set()
    for _ in range(150):
        letters = list(text)
        for _ in range(dice.randint(1, 4)):
            at = dice.randrange(len(letters))
            letters[at] = dice.choice(["", letters[at] * 2, dice.choice('0.-"[]# \n$eE9'), "nan", "1e400", "-1"])
        (tmp_path / "scene.pbrt").write_text("".join(letters))
        try:
            read(tmp_path, "scene.pbrt")
            outcomes.add("read")
        except SceneError as error:
            assert "could not be read as" not in str(error), error
            outcomes.add("refused")
    assert outcomes == {"read", "refused"}


def test_ribbon_curves(pbrt):
    """Ribbons are flat, as wide as said, and turn evenly from normal to normal; those of hair are round fibres."""
    points = " ".join(f"{x} 0 0" for x in range(7))
    curve = f'Shape "curve" "point3 P" [{points}] "string type" "ribbon" "float width0" 0.2 "float width1" 0.8'
    normals = '"normal N" [0 1 0 0 0 1 0 -1 0]'
    found = pbrt(f"{curve} {normals}")
    mesh = found.meshes[0]
    x, sides = mesh.positions[::2, 0], mesh.positions[1::2] - mesh.positions[::2]
    np.testing.assert_allclose(np.linalg.norm(sides, axis=1), 0.2 + 0.1 * x, rtol=1e-5)
    angle = np.pi / 2 * x / 3
    np.testing.assert_allclose(mesh.normals[::2], np.column_stack([0 * x, np.cos(angle), np.sin(angle)]), atol=1e-6)
    assert len(mesh.triangles) == 2 * (len(x) - 1)
    with pytest.raises(SceneError, match="a normal N for each end of its 2 segments"):
        pbrt(f'{curve} "normal N" [0 1 0 0 0 1]')
    found = pbrt(f'Material "hair" {curve} {normals}')
    assert found.meshes[0].diameters is not None


def test_flat_curves(pbrt):
    """Flat curves, the default, are segments that face each ray, or round ones if they are hair; cylinders are tubes."""
    points = "0 0 0 1 0 0 1 1 0 2 1 0"
    of = {kind: f'Shape "curve" "point3 P" [{points}] "float width" .1 "string type" "{kind}"' for kind in ("flat", "cylinder")}
    found = pbrt(f'{of["flat"]} {of["cylinder"]} Shape "curve" "point3 P" [{points}]')
    assert [(mesh.flat, has_curves(mesh)) for mesh in found.meshes] == [(True, True), (False, False)]
    assert found.warnings == [NO_LIGHTS_WARNING]
    compiled = compile_scene(found)
    assert variant_of(compiled) == "hair" and (compiled.material_flags & rows.FLAT_CURVES).any()
    flat, tubes = (with_tubes(found, ShotCache()).meshes[k] for k in (0, 1))
    assert has_curves(flat) and not has_curves(tubes)
    hair = pbrt(f'Material "hair" {of["flat"]}')
    assert has_curves(hair.meshes[0]) and not any("curves" in warning for warning in hair.warnings)
    lit = pbrt(f'AreaLightSource "diffuse" {of["flat"]}')
    assert not has_curves(with_tubes(lit, ShotCache()).meshes[-1])


def test_recursive_and_huge_input_terminates(pbrt):
    """Textures that refer to themselves, brackets in quotes, curves with very many points and repeated shapes all terminate."""
    squares = 'Texture "a" "spectrum" "checkerboard" '
    doubled = "".join('Texture "a" "spectrum" "mix" "texture tex1" "a" "texture tex2" "a" ' for _ in range(6))
    found = pbrt(f'{squares}{doubled}Material "diffuse" "texture reflectance" "a" {BALL}')
    assert len(found.images) == 2
    with pytest.raises(SceneError, match="nested too deep"):
        pbrt(f'{squares}{doubled * 6}Material "diffuse" "texture reflectance" "a" {BALL}')
    with pytest.raises(SceneError, match="is not closed"):
        pbrt(f'{BALL} "string a" [ "{"]" * 200_000}')
    points = " ".join(f"{i} 0 0" for i in range(3 * 5000 + 1))
    assert len(pbrt(f'Shape "curve" "point3 P" [{points}]').meshes[0].positions) > 5000
    many = pbrt(f'{BALL} "float zmax" 0.5 ' * 50)
    assert (len(many.meshes), len(many.instances)) == (1, 50)
