"""Tests of pbrt's shapes, materials, textures and sky images, against closed forms."""

import math

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.image.encode import encode
from renderer.scene.normals import face_normals
from renderer.scene.readers.linear_images import linear
from renderer.scene.readers.pbrt.equal_area import equirectangular, to_square
from renderer.scene.readers.pbrt.loop import subdivided
from tests.renderer.scene.pbrt_files import BALL, HEAD, SQUARE, world

RIGHT = "Scale -1 1 1 " + HEAD


@pytest.fixture
def pbrt(scene):
    return lambda inside, others=None: scene("scene.pbrt", world(inside, RIGHT), others)


def area_and_orientation(mesh):
    """Returns a mesh's area, and its area with faces weighted by the cosine between their normal and their vertex normals."""
    faces = face_normals(mesh.positions, mesh.triangles)
    along = np.einsum("tc,tc->t", faces, mesh.normals[mesh.triangles].mean(axis=1))
    return np.linalg.norm(faces, axis=1).sum() / 2, along.sum() / 2


@pytest.mark.parametrize(
    ("shape", "area"),
    [
        ('"sphere" "float radius" 2 "float zmin" -1 "float zmax" 1.5', 2 * math.pi * 2 * 2.5),
        ('"sphere" "float phimax" 90', math.pi),
        ('"cylinder" "float radius" 0.5 "float zmin" 0 "float zmax" 3', 3 * math.pi),
        ('"disk" "float radius" 2 "float innerradius" 1', 3 * math.pi),
        ('"disk" "float phimax" 180', math.pi / 2),
        (
            '"curve" "string type" "cylinder" "point3 P" [0 0 0 1 0 0 2 0 0 3 0 0] "float width" 0.2',
            2 * math.pi * 0.1 * (3 + 0.1),
        ),
    ],
)
def test_shape_areas(pbrt, shape, area):
    (mesh,) = pbrt(f"Shape {shape}").meshes
    found, outside = area_and_orientation(mesh)
    assert found == pytest.approx(area, rel=6e-2 if "curve" in shape else 2e-3)
    assert outside == pytest.approx(found, rel=0.05)
    turned = pbrt(f"ReverseOrientation Shape {shape}").meshes[0]
    if "curve" not in shape:
        np.testing.assert_allclose(np.sort(turned.normals.sum(axis=0)), np.sort(-mesh.normals.sum(axis=0)), atol=1e-3)


def test_empty_partial_quadric_is_rejected(pbrt):
    for shape in ('"sphere" "float zmin" 0.5 "float zmax" 0.5', '"disk" "float phimax" 0', '"cylinder" "float radius" -1'):
        with pytest.raises(SceneError, match="line 9: "):
            pbrt(f"Shape {shape}")


def test_bent_and_flat_bilinear_patches(pbrt):
    flat = pbrt('Shape "bilinearmesh" "point3 P" [0 0 0 2 0 0 0 1 0 2 1 0]').meshes[0]
    assert len(flat.triangles) == 2
    assert face_normals(flat.positions, flat.triangles)[:, 2].tolist() == [2, 2]
    assert flat.uvs.tolist() == [[0, 1], [1, 1], [0, 0], [1, 0]]
    bent = pbrt('Shape "bilinearmesh" "point3 P" [0 0 0 1 0 0 0 1 0 1 1 1]').meshes[0]
    x, y, z = bent.positions.T
    np.testing.assert_allclose(z, x * y, atol=1e-6)


def test_loops_scheme_on_a_tetrahedron_and_a_plane():
    tetrahedron = np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)], float)
    faces = np.array([(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)])
    at_once, _ = subdivided(tetrahedron, faces, 0)
    # At a vertex of valence 3, beta is 3/16, so the limit is 2/5 of the vertex and 1 / (3 + 3 / (8 beta)) = 1/5 of each
    # neighbour.
    np.testing.assert_allclose(at_once[0], 0.4 * tetrahedron[0] + 0.2 * tetrahedron[1:].sum(axis=0))
    later, finer = subdivided(tetrahedron, faces, 3)
    assert len(finer) == 4 * 4**3
    np.testing.assert_allclose(later[0], at_once[0], atol=1e-12)  # the limit is the same at every level
    sheet = np.array([(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0), (0, 2, 0), (1, 2, 0), (2, 2, 0)], float)
    cells = np.array([(a, a + 1, a + 4) for a in (0, 1, 3, 4)] + [(a, a + 4, a + 3) for a in (0, 1, 3, 4)])
    smooth, _ = subdivided(sheet, cells, 2)
    assert np.abs(smooth[:, 2]).max() == 0
    np.testing.assert_allclose(smooth[4], (1, 1, 0), atol=1e-12)
    np.testing.assert_allclose(smooth[1], (1, 0, 0), atol=1e-12)  # a border is subdivided as a curve


def test_loop_normals_side_matches_pbrt(pbrt):
    """Normals of Loop subdivision are on pbrt's side.

    Tangents turn clockwise around a point where triangles run counter-clockwise.
    """
    points = "1 1 1 1 -1 -1 -1 1 -1 -1 -1 1"
    (mesh,) = pbrt(f'Shape "loopsubdiv" "integer indices" [0 1 2 0 3 1 0 2 3 1 3 2] "point3 P" [{points}]').meshes
    assert (mesh.normals * mesh.positions).sum(axis=1).max() < 0
    _, outside = area_and_orientation(mesh)
    assert outside > 0  # triangles face along their normals


def test_float_image_texture_uses_the_first_channel(pbrt, png):
    rough = '''Texture "t" "float" "imagemap" "string filename" "t.png" "string encoding" "linear"
    Material "conductor" "texture roughness" "t"'''
    found = pbrt(f"{rough} {BALL}", {"t.png": png(64, 255, 0)})
    texture = found.textures[found.materials[0].metallic_roughness_texture]
    packed = found.images[texture.image].pixels
    np.testing.assert_allclose(packed[0, 0], ((64 / 255) ** 0.25, (64 / 255) ** 0.25, 1), rtol=1e-5)


def test_textured_index_of_refraction(pbrt):
    """An index of refraction may be a texture: a constant texture's value is used, of others the mean, with a warning."""
    texture = 'Texture "e" "{}" "{}" {} Material "{}" "texture eta" "e" '
    glass = pbrt(texture.format("float", "constant", '"float value" 1.3', "dielectric") + BALL)
    assert glass.materials[0].ior == pytest.approx(1.3)
    metal = pbrt(
        texture.format("spectrum", "constant", '"rgb value" [.2 1.9 1.1]', "conductor") + '"rgb k" [3.9 2.4 2.2] ' + BALL
    )
    assert metal.materials[0].eta == pytest.approx((0.2, 1.9, 1.1))
    varies = pbrt(texture.format("float", "checkerboard", '"float tex1" 1.2 "float tex2" 1.8', "dielectric") + BALL)
    assert varies.materials[0].ior == pytest.approx(1.5)
    assert any("eta of material 'dielectric' is a texture" in each for each in varies.warnings)


def test_invisible_area_light_still_emits(pbrt):
    """An area light on a shape of alpha 0, which pbrt makes invisible, still emits."""
    light = 'AreaLightSource "diffuse" "rgb L" [4 4 4]'
    made = pbrt(f'{light} Shape "sphere" "float alpha" 0')
    (material,) = made.materials
    assert (material.lamp, material.unseen, material.emission) == (True, True, (4, 4, 4))
    assert len(made.spheres) == 1
    assert not pbrt(f'{BALL} Shape "disk" "float alpha" 0').instances


def test_roughness_conversion(pbrt):
    def made(words):
        return pbrt(f"Material {words} {BALL}").materials[0]

    assert made('"conductor" "float roughness" 0.16').roughness == pytest.approx(0.16**0.25)
    assert made('"conductor" "float roughness" 0.16 "bool remaproughness" false').roughness == pytest.approx(0.4)
    assert made('"dielectric"').roughness == 0
    brushed = made('"conductor" "float uroughness" 0.25 "float vroughness" 0.01')
    along, across = 0.5, 0.1  # roughness alphas along u and v
    alpha = brushed.roughness**2
    assert alpha == pytest.approx(across)
    assert alpha + (1 - alpha) * brushed.anisotropy**2 == pytest.approx(along)
    assert brushed.anisotropy_rotation == 0
    assert made('"conductor" "float uroughness" 0.01 "float vroughness" 0.25').anisotropy_rotation == pytest.approx(math.pi / 2)


def test_materials(pbrt):
    def made(words):
        return pbrt(f"{words} {BALL}").materials[0]

    leaf = made('Material "diffusetransmission" "rgb reflectance" [.2 .2 .2] "rgb transmittance" [.6 .3 0]')
    back = (1 - leaf.diffuse_transmission) * np.array(leaf.base_color)
    through = leaf.diffuse_transmission * np.array(leaf.diffuse_transmission_color)
    np.testing.assert_allclose([back, through], [[0.2, 0.2, 0.2], [0.6, 0.3, 0]], atol=1e-9)
    metal = made('Material "conductor" "rgb reflectance" [.9 .5 .1]')
    eta, k = np.array(metal.eta), np.array(metal.k)
    np.testing.assert_allclose(((eta - 1) ** 2 + k**2) / ((eta + 1) ** 2 + k**2), (0.9, 0.5, 0.1), atol=1e-9)
    assert made('Material "thindielectric" "float eta" 1.3').thin
    two = 'MakeNamedMaterial "a" "string type" "diffuse" "rgb reflectance" [1 0 0] MakeNamedMaterial "b" "string type" "diffuse" '
    mixed = made(two + '"rgb reflectance" [0 0 1] Material "mix" "string materials" ["a" "b"] "float amount" 0.25')
    assert mixed.base_color == (0.75, 0, 0.25)


def looked_up(description, u, v):
    """Returns the base colour texture at pbrt's (u, v)."""
    texture = description.textures[description.materials[0].base_color_texture]
    a, b, c, d, e, f = texture.transform
    x, y = a * u + b * (1 - v) + c, d * u + e * (1 - v) + f
    pixels = linear(description.images[texture.image])
    height, width = pixels.shape[:2]
    return pixels[int((y % 1) * height), int((x % 1) * width)] * description.materials[0].base_color


@pytest.mark.parametrize("inner", ['"rgb tex1" [.9 .2 .1]', '"texture tex1" "red"'])
def test_checkerboard_matches_pbrt(pbrt, inner):
    found = pbrt(
        f"""Texture "half" "float" "constant" "float value" 0.5 Texture "both" "spectrum" "constant" "rgb value" [.9 .2 .1]
        Texture "red" "spectrum" "mix" "rgb tex1" [.9 .2 .1] "rgb tex2" [.9 .2 .1] "texture amount" "half"
        Texture "c" "spectrum" "checkerboard" "float uscale" 3 "float vscale" 2 "float udelta" 0.5 "rgb tex2" [.1 .2 .9] {inner}
        Material "diffuse" "texture reflectance" "c" {SQUARE}"""
    )
    for u, v in ((0.1, 0.1), (0.3, 0.1), (0.1, 0.6), (0.9, 0.9), (0.55, 0.2)):
        even = (math.floor(3 * u + 0.5) + math.floor(2 * v)) % 2 == 0
        np.testing.assert_allclose(looked_up(found, u, v), (0.9, 0.2, 0.1) if even else (0.1, 0.2, 0.9), atol=1e-6)


def test_image_texture_orientation_scale_and_invert(pbrt, png):
    def shown(words):
        text = f'Texture "t" "spectrum" "imagemap" "string filename" "t.png" {words} '
        text += f'Material "diffuse" "texture reflectance" "t" {SQUARE}'
        return pbrt(text, {"t.png": png(255, 0, 0)})  # red above, black below

    found = shown("")
    assert looked_up(found, 0.5, 0.9).tolist() == [1, 0, 0]
    assert looked_up(found, 0.5, 0.1).tolist() == [0, 0, 0]
    assert looked_up(shown('"float vscale" 0.5'), 0.5, 0.9).tolist() == [0, 0, 0]
    assert looked_up(shown('"float scale" 0.5'), 0.5, 0.9).tolist() == [0.5, 0, 0]
    assert looked_up(shown('"bool invert" true'), 0.5, 0.9).tolist() == [0, 1, 1]


def test_holes(pbrt, png):
    text = 'Texture "h" "float" "imagemap" "string filename" "h.png" Shape "trianglemesh" "texture alpha" "h" '
    found = pbrt(text + SQUARE.removeprefix('Shape "trianglemesh"'), {"h.png": png(255, 255, 255)})
    made = found.materials[0]
    image = found.images[found.textures[made.base_color_texture].image]
    assert made.alpha_mode == "blend"
    assert image.pixels[:, 0, 3].tolist() == [255, 0]
    assert pbrt(f'Shape "sphere" "float alpha" 0.25 {BALL}').materials[0].opacity == 0.25


def test_equal_area_mapping():
    directions = np.random.default_rng(1).normal(size=(2000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    u, v = to_square(directions)
    # The inverse of Clarberg's map, as in pbrt.
    x, y = 2 * u - 1, 2 * v - 1
    depth = 1 - (np.abs(x) + np.abs(y))
    r = 1 - np.abs(depth)
    phi = ((np.abs(y) - np.abs(x)) / r + 1) * np.pi / 4
    out = r * np.sqrt(2 - r * r)
    back = np.stack([np.copysign(np.cos(phi), x) * out, np.copysign(np.sin(phi), y) * out, np.copysign(1 - r * r, depth)], axis=1)
    np.testing.assert_allclose(back, directions, atol=1e-7)
    counts, _, _ = np.histogram2d(u, v, bins=2, range=[[0, 1], [0, 1]])
    assert counts.min() > 400  # quadrants have equal solid angles


def test_sky_image_rotation_and_flux(pbrt):
    size = 64
    middles = (np.arange(size) + 0.5) / size * 2 - 1
    u, v = np.meshgrid(middles, middles)
    above = (np.abs(u) + np.abs(v)) < 1  # +Z
    pixels = np.where(above[..., None], (1.0, 2.0, 3.0), (0.1, 0.1, 0.1)).astype(np.float32)
    whole = equirectangular(pixels, np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]))  # Z to Y
    assert whole[5, 10] == pytest.approx((1, 2, 3), rel=0.02)
    assert whole[-5, 90] == pytest.approx((0.1, 0.1, 0.1), rel=0.02)
    weight = np.sin((np.arange(size) + 0.5) * np.pi / size)
    mean = (whole.mean(axis=1) * weight[:, None]).sum(axis=0) / weight.sum()
    np.testing.assert_allclose(mean, pixels.mean(axis=(0, 1)), rtol=1e-4)
    found = pbrt(
        f'LightSource "infinite" "string filename" "s.exr" "float illuminance" {2 * math.pi} {BALL}',
        {"s.exr": encode(pixels, "exr")},
    )
    # pbrt counts only the upper hemisphere's solid angle: a constant upper half of luminance L has illuminance pi L / 2.
    light = np.dot((1, 2, 3), (0.2126, 0.7152, 0.0722))
    assert found.environment.color[0] == pytest.approx(2 * math.pi / (math.pi * light / 2), rel=0.01)


LAID = 'Texture "t" "spectrum" "checkerboard" "string mapping" "{}" {} Material "diffuse" "texture reflectance" "t" '


def test_planar_mapping_uses_texture_space(pbrt):
    words = LAID.format("planar", '"vector3 v1" [2 0 0] "vector3 v2" [0 3 0] "float udelta" .25')
    found = pbrt(f"AttributeBegin Translate 0 1 0 {words} AttributeEnd Translate 5 0 0 Scale 2 1 1 {words} {SQUARE}")
    (mesh,) = found.meshes
    x, y = mesh.positions[:, 0], mesh.positions[:, 1]
    np.testing.assert_allclose(mesh.uvs1, np.stack([2 * x + 0.25, 1 - 3 * y], axis=1), atol=1e-5)
    moved = pbrt(f"Translate 0 1 0 {words} Translate 5 0 0 Scale 2 1 1 {SQUARE}").meshes[0]
    np.testing.assert_allclose(moved.uvs1, np.stack([2 * (2 * x + 5) + 0.25, 1 - 3 * y], axis=1), atol=1e-5)
    texture = found.textures[found.materials[mesh.material].base_color_texture]
    assert texture.uv_set == 1
    assert not any("mapping" in warning or "v1" in warning for warning in found.warnings)


@pytest.mark.parametrize("kind", ["spherical", "cylindrical"])
def test_round_mappings_are_continuous_across_the_seam(pbrt, kind):
    (mesh,) = pbrt(LAID.format(kind, "") + BALL).meshes
    off_the_axis = (np.hypot(*mesh.positions[:, :2].T) > 1e-3)[mesh.triangles].all(axis=1)
    corners = mesh.uvs1[mesh.triangles[off_the_axis]]
    assert np.ptp(corners, axis=1).max() < 0.5
    x, y, z = mesh.positions.T.astype(float)
    if kind == "spherical":
        np.testing.assert_allclose(mesh.uvs1[:, 0], np.arccos(np.clip(z, -1, 1)) / np.pi, atol=1e-5)
    else:
        np.testing.assert_allclose(mesh.uvs1[:, 1], 1 - z, atol=1e-5)
    turn = mesh.uvs1[:, 0] - 0.5 if kind == "cylindrical" else 1 - mesh.uvs1[:, 1]
    away = np.hypot(x, y)
    np.testing.assert_allclose(away * np.cos(2 * np.pi * turn), x, atol=1e-4)
    np.testing.assert_allclose(away * np.sin(2 * np.pi * turn), y, atol=1e-4)


def test_baked_texture_keeps_the_mapping(pbrt):
    made = LAID.format("spherical", "").partition("Material")[0]
    mixed = (
        made + 'Texture "m" "spectrum" "scale" "texture tex" "t" "texture scale" "f" Material "diffuse" "texture reflectance" "m"'
    )
    for mapping, says in (("spherical", False), ("uv", True)):
        other = f'Texture "f" "float" "checkerboard" "string mapping" "{mapping}" '
        found = pbrt(other + mixed + BALL)
        assert found.meshes[0].uvs1 is not None
        assert any("uses textures with different mappings: all use one" in warning for warning in found.warnings) == says
    with pytest.raises(SceneError, match="has the mapping 'odd'; known are uv, planar, spherical and cylindrical"):
        pbrt(LAID.format("odd", "") + BALL)
