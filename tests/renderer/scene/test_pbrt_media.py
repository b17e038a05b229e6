"""Tests of pbrt's media, subsurface, hair and displacement, by the formulas of their sources."""

import math
import re

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.scene.description import Medium
from renderer.scene.readers.scattering import diffuse_reflectance
from renderer.scene.readers.substances import SUBSTANCES
from tests.renderer.scene.pbrt_files import BALL as SPHERE
from tests.renderer.scene.pbrt_files import HEAD, SQUARE, world

RIGHT = "Scale -1 1 1 " + HEAD
FOG = 'MakeNamedMedium "fog" "string type" "homogeneous" '
FOG += '"rgb sigma_a" [1 2 3] "rgb sigma_s" [4 5 6] "float scale" 0.5 "float g" 0.3\n'
BALL = f" {SPHERE} "
GLASS = 'Material "dielectric" '
INTO = 'MediumInterface "fog" ""\n'


@pytest.fixture
def pbrt(scene):
    return lambda inside, head=RIGHT: scene("scene.pbrt", world(inside, head))


def filled(material):
    return Medium(material.sigma_a, material.sigma_s, material.g)


HALF_FOG = Medium((0.5, 1, 1.5), (2, 2.5, 3), 0.3)


def test_medium_fills_glass_and_interfaces(pbrt):
    found = pbrt(FOG + INTO + GLASS + BALL + 'Material "interface"' + BALL + 'Material "diffuse"' + BALL)
    glass, interface, matt = (found.materials[each.material] for each in found.spheres)
    assert (glass.kind, filled(glass)) == ("glass", HALF_FOG)
    assert (interface.kind, filled(interface)) == ("interface", HALF_FOG)
    assert filled(matt) == Medium()
    assert found.medium is None
    assert not any("line" in warning for warning in found.warnings)


def test_media_interfaces_and_equal_sides(pbrt):
    inside = FOG + 'MediumInterface "fog"' + GLASS + BALL + "AttributeBegin " + INTO + BALL + "AttributeEnd " + BALL
    found = pbrt(inside)
    assert [filled(found.materials[each.material]) for each in found.spheres] == [Medium(), HALF_FOG, Medium()]
    assert any("Glass without a MediumInterface is clear inside" in warning for warning in found.warnings)


def test_area_light_on_interface_is_a_lamp_without_a_body(pbrt):
    found = pbrt('Material "interface" AreaLightSource "diffuse" "rgb L" [1 2 3]' + BALL)
    (made,) = found.materials
    assert (made.kind, made.lamp, made.unseen) == ("diffuse", True, False)
    assert min(made.emission) > 0


def test_empty_shape_in_fog_is_a_boundary(pbrt):
    found = pbrt('MediumInterface "" "fog" Material "interface"' + BALL, FOG + 'MediumInterface "" "fog"\n' + RIGHT)
    (hole,) = found.spheres
    assert found.materials[hole.material].kind == "interface"
    assert filled(found.materials[hole.material]) == Medium()
    assert found.medium == HALF_FOG


@pytest.mark.parametrize(("radius", "is_world"), [(1, True), (100, False)])
def test_camera_medium_fills_the_world_unless_inside_a_shape(pbrt, radius, is_world):
    fogged = FOG + 'MediumInterface "" "fog"\n' + RIGHT
    found = pbrt(f'MediumInterface "fog" "" Material "interface" Shape "sphere" "float radius" {radius}', fogged)
    assert (found.medium is not None) == is_world


def test_named_substances_are_per_millimetre(pbrt):
    found = pbrt(
        'MakeNamedMedium "fog" "string type" "homogeneous" "string preset" "Wholemilk" "float scale" 10 ' + INTO + GLASS + BALL
    )
    np.testing.assert_allclose(found.materials[0].sigma_s, (25.5, 32.1, 37.7))
    np.testing.assert_allclose(found.materials[0].sigma_a, (0.011, 0.024, 0.14))
    assert len(SUBSTANCES) == 47


@pytest.mark.parametrize(
    ("inside", "sentence"),
    [
        (
            'MakeNamedMedium "fog" "string type" "uniformgrid" ' + INTO + GLASS + BALL,
            "'fog' varies in space .uniformgrid",
        ),
        (FOG.replace('g" 0.3', 'g" 0.3 "rgb Le" [1 1 1]') + INTO + GLASS + BALL, "its emission .Le. is ignored"),
        (FOG + INTO + 'Material "thindielectric"' + BALL, "its medium is ignored, since it is thin"),
        (FOG + 'MediumInterface "" "fog"' + GLASS + BALL, "'fog' of a shape is ignored, since it fills no other shape"),
        (
            'MakeNamedMedium "fog" "string type" "homogeneous" "string preset" "Tar" ' + INTO + GLASS + BALL,
            "'Tar' is not a known substance: its numbers are used",
        ),
        ('Material "interface"' + BALL + 'Material "diffuse"' + BALL, "no medium on either side, is left out"),
        ('Material "subsurface" "string name" "Tar"' + BALL, "'Tar' is not a known substance: rendered as milk"),
    ],
)
def test_unsupported_content_is_named(pbrt, inside, sentence):
    assert any(re.search(sentence, warning) for warning in pbrt(inside).warnings)


def test_undefined_medium_is_rejected(pbrt):
    with pytest.raises(SceneError, match="there is no medium 'mist'"):
        pbrt('MediumInterface "mist" ""' + GLASS + BALL)


def test_subsurface_by_reflectance(pbrt):
    """The walk below the surface reflects the given colour, and spreads light as far as pbrt's medium of that mean free path."""
    found = pbrt(
        'Material "subsurface" "rgb reflectance" [0.8 0.5 0.2] "rgb mfp" [1 2 3] "float scale" 0.5 "float roughness" 0' + BALL
    )
    (made,) = found.materials
    np.testing.assert_allclose(made.base_color, (0.8, 0.5, 0.2), atol=1e-6)
    assert (made.kind, made.subsurface, made.ior, made.roughness) == ("metallic_roughness", 1, 1.33, 0)
    for color, path, radius in zip(made.base_color, (0.5, 1, 1.5), made.subsurface_radius, strict=True):
        albedos = np.linspace(0, 1, 100_001)
        albedo = np.interp(color, diffuse_reflectance(albedos, 1.33), albedos)
        similarity = np.linspace(1, 0, 100_001)
        sent_back = (
            (1 - similarity) * (1 - 0.139 * similarity) / (1 + 1.17 * similarity)
        )  # van de Hulst's formula, as in the kernel's walk
        walk = 1 - np.interp(color, sent_back, similarity) ** 2
        assert radius / math.sqrt(3 * (1 - walk)) == pytest.approx(path / math.sqrt(3 * (1 - albedo)), rel=1e-3)


def test_subsurface_by_coefficients_matches_jensen(pbrt):
    """Subsurface coefficients yield the reflectance of equation 15 of Jensen et al. 2001.

    A half-space of albedo 1 reflects all light.
    """
    found = pbrt('Material "subsurface" "rgb sigma_a" [0.1 0 1] "rgb sigma_s" [2 3 1] "float g" 0.5 "float eta" 1.5' + BALL)
    (made,) = found.materials
    inner = -1.44 / 1.5**2 + 0.71 / 1.5 + 0.668 + 0.0636 * 1.5
    a = (1 + inner) / (1 - inner)
    for color, (absorbed, scattered) in zip(made.base_color, ((0.1, 1.0), (0, 1.5), (1, 0.5)), strict=True):
        albedo = scattered / (absorbed + scattered)
        root = math.sqrt(3 * (1 - albedo))
        assert color == pytest.approx(albedo / 2 * (1 + math.exp(-4 / 3 * a * root)) * math.exp(-root))
    assert made.base_color[1] == 1
    milk = pbrt('Material "subsurface"' + BALL).materials[0]
    assert milk.base_color == pbrt('Material "subsurface" "string name" "Wholemilk"' + BALL).materials[0].base_color
    assert min(milk.base_color) > 0.75


def test_hair(pbrt):
    """Hair keeps its absorption, its colour or its pigments, in that order, and its roughnesses and tilt."""
    brown, red, dyed, absorbing, rough = (
        pbrt(f'Material "hair" {said}' + BALL).materials[0]
        for said in (
            "",
            '"float pheomelanin" 2',
            '"rgb color" [0.6 0.3 0.1] "float eumelanin" 1',
            '"rgb sigma_a" [0.419 0.697 1.37] "rgb color" [0.6 0.3 0.1]',
            '"float beta_m" 0.25 "float beta_n" 0.5 "float alpha" 3 "float eta" 1.4',
        )
    )
    assert (brown.kind, brown.eumelanin, brown.pheomelanin, brown.sigma_a) == ("hair", 1.3, 0.0, (0.0, 0.0, 0.0))
    assert (brown.beta_m, brown.beta_n, brown.ior, math.degrees(brown.tilt)) == (0.3, 0.3, 1.55, pytest.approx(2))
    assert (red.eumelanin, red.pheomelanin) == (0.0, 2.0)
    np.testing.assert_allclose(dyed.base_color, (0.6, 0.3, 0.1), atol=1e-6)
    assert dyed.eumelanin == 0
    np.testing.assert_allclose(absorbing.sigma_a, (0.419, 0.697, 1.37))
    assert (rough.beta_m, rough.beta_n, rough.ior, math.degrees(rough.tilt)) == (0.25, 0.5, 1.4, pytest.approx(3))


def heights(columns=64):
    """Returns a PNG whose values rise linearly along u by 1 over its width, for use as a float texture."""
    import io

    from PIL import Image

    row = np.minimum(np.arange(columns) * 2, 255).astype(np.uint8)
    out = io.BytesIO()
    Image.fromarray(np.tile(row, (8, 1))).save(out, "PNG")
    return out.getvalue()


BUMPY = """Texture "rise" "float" "imagemap" "string filename" "h.png"
"string wrap" "clamp" "string encoding" "linear" "float scale" 0.5
Material "diffuse" "texture displacement" "rise"
"""


def test_displacement_slopes(scene):
    """A square 2 wide whose height rises by 0.5 * 2 / 255 per texel of 1/64 of its width gets the slopes of these heights."""
    found = scene("scene.pbrt", world(BUMPY + SQUARE + "Scale 4 4 4 " + SQUARE, RIGHT), {"h.png": heights()})
    first, second = (found.materials[found.meshes[i.mesh].material] for i in found.instances)
    slope = 0.5 * 2 / 255 * 64 / 2
    for made, expected in ((first, slope), (second, slope / 4)):
        texture = found.textures[made.normal_texture]
        pixels = found.images[texture.image].pixels[4, 20, :3] / 127.5 - 1
        assert pixels[0] / pixels[2] * made.normal_scale == pytest.approx(-expected, rel=0.02)
        assert abs(pixels[1]) < 0.01
    assert first.normal_texture == second.normal_texture


def test_displaced_ply_mesh(scene):
    """The `displacement` of a PLY mesh moves its surface; other meshes of the material are as they are."""
    ply = (
        b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty float u\n"
        b"property float v\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        b"-1 -1 0 0 0\n1 -1 0 1 0\n1 1 0 1 1\n-1 1 0 0 1\n4 0 1 2 3\n"
    )
    head = BUMPY.split("Material")[0] + 'Material "diffuse"\n'
    mesh = 'Shape "plymesh" "string filename" "a.ply" '
    inside = f'{head}{mesh}"texture displacement" "rise" "float displacement.edgelength" 0.1\n{mesh}'
    found = scene("scene.pbrt", world(inside, RIGHT), {"h.png": heights(), "a.ply": ply})
    moved, still = (found.materials[found.meshes[i.mesh].material] for i in found.instances)
    assert moved.displacement_scale == pytest.approx(0.5)
    assert found.textures[moved.displacement_texture].wrap_s == "clamp"
    assert still.displacement_texture is None
    assert not any("isplacement" in warning for warning in found.warnings)


def test_normal_map_overrides_displacement(scene, png):
    inside = BUMPY.replace('"rise"\n', '"rise" "string normalmap" "n.png"\n') + SQUARE
    found = scene("scene.pbrt", world(inside, RIGHT), {"h.png": heights(), "n.png": png(128, 128, 255)})
    made = found.materials[found.meshes[0].material]
    assert found.images[found.textures[made.normal_texture].image].name == "n.png"
    assert made.normal_scale == 1
    even = scene("scene.pbrt", world('Material "diffuse" "float displacement" 3 ' + SQUARE, RIGHT))
    assert even.materials[even.meshes[0].material].normal_texture is None


def test_named_subsurface_uses_reduced_scattering(pbrt):
    """The scattering coefficient sigma_s of a named substance is multiplied by 1 - g, like coefficients given in the file."""
    named = pbrt('Material "subsurface" "string name" "Wholemilk" "float g" 0.5' + BALL).materials[0]
    scattered, absorbed = SUBSTANCES["Wholemilk"]
    given = " ".join(f'"rgb {name}" [{" ".join(map(str, v))}]' for name, v in (("sigma_s", scattered), ("sigma_a", absorbed)))
    same = pbrt(f'Material "subsurface" {given} "float g" 0.5' + BALL).materials[0]
    assert named.subsurface_radius == pytest.approx(same.subsurface_radius)
    assert named.base_color == pytest.approx(same.base_color)


def test_g_with_reflectance_causes_a_warning(pbrt):
    found = pbrt('Material "subsurface" "rgb reflectance" [0.8 0.5 0.2] "float g" 0.5' + BALL)
    assert any("'g' of material 'subsurface' is ignored, since its reflectance is given" in warning for warning in found.warnings)


def test_a_uniform_grid_is_the_density_of_its_medium(pbrt):
    values = " ".join(map(str, range(24)))
    grid = (
        'Translate 0 1 0 MakeNamedMedium "fog" "string type" "uniformgrid" "integer nx" 2 "integer ny" 3 "integer nz" 4 '
        f'"float density" [{values}] "point3 p0" [-1 -2 -3] "point3 p1" [1 2 3] "rgb sigma_s" [1 2 3] "rgb sigma_a" [0 0 1] '
        '"float scale" 2 Identity '
    )
    found = pbrt(grid + INTO + GLASS + BALL)
    made = found.materials[0]
    np.testing.assert_allclose((*made.sigma_a, *made.sigma_s), (0, 0, 2, 2, 4, 6))
    volume = found.volumes[made.volume]
    np.testing.assert_array_equal(volume.density, np.arange(24).reshape(4, 3, 2))
    corners = volume.to_world @ np.array([[0, 0, 0, 1], [1, 1, 1, 1]]).T
    assert sorted(np.abs(corners[:3]).max(axis=1).tolist()) == [1, 3, 3]
