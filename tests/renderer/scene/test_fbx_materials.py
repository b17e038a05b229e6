"""Tests of FBX materials, in text files as other programs write them."""

import math

import pytest

from tests.renderer.scene.fbx_text import arnold, fbx, material, texture


def test_phong_and_lambert(scene):
    phong = material(
        30, "p", DiffuseColor=(0.2, 0.4, 0.6), SpecularColor=(1.0, 0.5, 0.5), SpecularFactor=0.5, ShininessExponent=30.0
    )
    found = scene("a.fbx", fbx(phong, [(30, 20)])).materials[0]
    assert (found.kind, found.base_color) == ("metallic_roughness", (0.2, 0.4, 0.6))
    assert found.specular_color == (0.5, 0.25, 0.25)
    assert found.roughness == pytest.approx((2 / 32) ** 0.25)
    lambert = material(30, "l", "lambert", DiffuseColor=(0.2, 0.4, 0.6), DiffuseFactor=0.5)
    found = scene("b.fbx", fbx(lambert, [(30, 20)])).materials[0]
    assert (found.kind, found.base_color) == ("diffuse", pytest.approx((0.1, 0.2, 0.3)))


def test_the_physical_material_of_3ds_max(scene):
    values = {
        "3dsMax|ClassIDa": 0x3D6B1CEC,
        "3dsMax|ClassIDb": 0xDEADC001 - 2**32,
        "3dsMax|Parameters|base_color": (0.1, 0.5, 0.3),
        "3dsMax|Parameters|base_weight": 0.5,
        "3dsMax|Parameters|roughness": 0.3,
        "3dsMax|Parameters|metalness": 0.75,
        "3dsMax|Parameters|trans_ior": 1.6,
        "3dsMax|Parameters|coating": 0.4,
        "3dsMax|Parameters|coat_roughness": 0.2,
    }
    found = scene("a.fbx", fbx(material(30, "m", "unknown", **values), [(30, 20)])).materials[0]
    assert found.base_color == pytest.approx((0.05, 0.25, 0.15))
    assert (found.roughness, found.metallic, found.ior) == pytest.approx((0.3, 0.75, 1.6))
    assert (found.clearcoat, found.clearcoat_roughness) == pytest.approx((0.4, 0.2))


def test_arnolds_standard_surface(scene):
    values = {
        "Maya|baseColor": (0.1, 0.5, 0.3),
        "Maya|base": 0.5,
        "Maya|specularRoughness": 0.3,
        "Maya|metalness": 0.75,
        "Maya|transmission": 0.25,
        "Maya|subsurface": 0.5,
        "Maya|emission": 2.0,
        "Maya|emissionColor": (1.0, 0.5, 0.0),
    }
    objects = material(30, "m", "unknown", **values) + arnold(70, values)
    description = scene("a.fbx", fbx(objects, [(30, 20), (30, 70), (71, 70)]))
    found = description.materials[0]
    assert (found.roughness, found.metallic, found.transmission) == pytest.approx((0.3, 0.75, 0.25))
    assert found.emission == pytest.approx((2, 1, 0))
    assert (found.subsurface, found.subsurface_radius) == (
        0.5,
        pytest.approx((0.01, 0.01, 0.01)),
    )  # a radius of 1, in centimetres
    assert not any("Material m" in warning for warning in description.warnings)


def test_arnold_subsurface_and_transmission_scattering(scene):
    """Arnold's subsurface and transmission scattering have lengths in the file's unit, which is centimetres.

    Standard Surface splits the attenuation in glass into scattering and absorption.
    """
    skin = {
        "Maya|baseColor": (0.1, 0.5, 0.3),
        "Maya|base": 1.0,
        "Maya|subsurface": 0.25,
        "Maya|subsurfaceColor": (0.9, 0.1, 0.7),
        "Maya|subsurfaceRadius": (3.0, 2.0, 1.0),
        "Maya|subsurfaceScale": 0.5,
        "Maya|subsurfaceAnisotropy": 0.3,
    }
    juice = {
        "Maya|base": 1.0,
        "Maya|transmission": 1.0,
        "Maya|transmissionColor": (0.5, 0.25, 0.1),
        "Maya|transmissionDepth": 10.0,
        "Maya|transmissionScatter": (0.2, 0.4, 0.6),
        "Maya|transmissionScatterAnisotropy": -0.5,
    }
    looks = []
    for values in (skin, juice):
        objects = material(30, "m", "unknown", **values) + arnold(70, values)
        description = scene("a.fbx", fbx(objects, [(30, 20), (30, 70), (71, 70)]))
        looks.append(description.materials[0])
        assert not any("Material m" in warning for warning in description.warnings)
    beneath, within = looks
    assert beneath.base_color == pytest.approx((0.3, 0.4, 0.4))
    assert beneath.subsurface_radius == pytest.approx((0.015, 0.01, 0.005))
    assert (beneath.subsurface, beneath.subsurface_anisotropy) == pytest.approx((0.25, 0.3))
    assert within.sigma_s == pytest.approx((2, 4, 6))
    assert within.sigma_a == pytest.approx([-math.log(c) / 0.1 - s for c, s in zip((0.5, 0.25, 0.1), (2, 4, 6), strict=True)])
    assert (within.g, within.attenuation_distance) == (-0.5, math.inf)


def test_arnold_depth_dispersion_film_and_coat_color(scene):
    """Arnold's transmission depth, dispersion (Abbe number), thin film and coat colour are read; lengths are in centimetres."""
    values = {
        "Maya|base": 1.0,
        "Maya|transmission": 1.0,
        "Maya|transmissionColor": (1.0, 0.5, 0.5),
        "Maya|transmissionDepth": 10.0,
        "Maya|transmissionDispersion": 40.0,
        "Maya|coat": 0.5,
        "Maya|coatColor": (1.0, 0.2, 0.0),
        "Maya|thinFilmThickness": 400.0,
        "Maya|diffuseRoughness": 0.5,
    }
    objects = material(30, "m", "unknown", **values) + arnold(70, values)
    description = scene("a.fbx", fbx(objects, [(30, 20), (30, 70), (71, 70)]))
    found = description.materials[0]
    assert (found.attenuation_distance, found.dispersion) == pytest.approx((0.1, 0.5))
    assert found.base_color == pytest.approx((1, 0.6, 0.5))
    assert (found.iridescence, found.iridescence_thickness) == (1, (400, 400))
    assert any("diffuse roughness" in w for w in description.warnings)


@pytest.mark.parametrize("is_textured", [False, True])
def test_vertex_colors_are_ignored_with_a_texture(scene, png, is_textured):
    colors = """
		LayerElementColor: 0 {
			Version: 101
			MappingInformationType: "ByPolygonVertex"
			ReferenceInformationType: "Direct"
			Colors: *12 { a: 1,0,0,1,0,1,0,1,0,0,1,1 }
		}
		Layer: 0 {
			LayerElement:  { Type: "LayerElementColor" TypedIndex: 0 }"""
    links = [(30, 20), *([(31, 30, "DiffuseColor")] if is_textured else [])]
    text = fbx(material(30, "m", "lambert") + texture(31, "t.png"), links).replace("\t\tLayer: 0 {", colors, 1)
    description = scene("a.fbx", text, {"t.png": png(200, 100, 50)})
    assert (description.meshes[0].colors is None) == is_textured
    assert any("1 vertex colours of textured meshes" in w for w in description.warnings) == is_textured


@pytest.mark.parametrize(
    ("factor", "color", "opacity"), [(1.0, 0.0, 1), (1.0, 0.75, 0.25), (0.75, 1.0, 0.25), (0.0, 1.0, 1), (1.0, 1.0, 1)]
)
def test_phong_transparency_encodings(scene, factor, color, opacity):
    glassy = material(30, "p", TransparentColor=(color, color, color), TransparencyFactor=factor)
    found = scene("a.fbx", fbx(glassy, [(30, 20)])).materials[0]
    assert (found.opacity, found.alpha_mode) == (opacity, "opaque" if opacity == 1 else "blend")


def test_present_and_missing_textures(scene, png):
    objects = material(30, "p", DiffuseColor=(0.2, 0.4, 0.6)) + texture(40, "wood.png")
    links = [(30, 20), (40, 30, "DiffuseColor")]
    missing = scene("a.fbx", fbx(objects, links))
    assert any("wood.png is not among the files; add it" in w for w in missing.warnings)
    assert missing.materials[0].base_color_texture is None
    found = scene("a.fbx", fbx(objects, links), {"textures/wood.png": png(255, 0, 0)})
    assert found.images[0].pixels[0, 0].tolist() == [255, 0, 0, 255]
    assert not any("wood" in w for w in found.warnings)


def test_phong_specular_textures(scene, png):
    objects = material(30, "p", SpecularFactor=0.5, ReflectionFactor=0.2) + texture(40, "a.png") + texture(41, "b.png")
    links = [(30, 20), (40, 30, "SpecularColor"), (41, 30, "ReflectionFactor")]
    found = scene("a.fbx", fbx(objects, links), {"a.png": png(255, 0, 0), "b.png": png(0, 255, 0)})
    shown = found.materials[0]
    assert shown.specular_color == (0.5, 0.5, 0.5)
    assert found.images[found.textures[shown.specular_color_texture].image].pixels[0, 0].tolist() == [255, 0, 0, 255]
    assert [w for w in found.warnings if "not supported" in w] == [
        "Material p: not supported and left out: the texture of ReflectionFactor."
    ]


def test_glossiness_and_coat_textures(scene, png):
    values = {"3dsMax|ClassIDa": 0x3D6B1CEC, "3dsMax|ClassIDb": 0xDEADC001 - 2**32, "3dsMax|Parameters|roughness_inv": True}
    objects = material(30, "m", "unknown", **values) + "".join(texture(40 + i, f"{i}.png") for i in range(4))
    maps = ("roughness_map", "reflectivity_map", "coat_map", "bump_map")
    links = [(30, 20), *((40 + i, 30, f"3dsMax|Parameters|{name}") for i, name in enumerate(maps))]
    found = scene("a.fbx", fbx(objects, links), {f"{i}.png": png(64, 64, 64) for i in range(4)})
    shown = found.materials[0]

    def texel(number):
        return found.images[found.textures[number].image].pixels[0, 0].tolist()

    assert texel(shown.metallic_roughness_texture)[1] == 191
    assert texel(shown.specular_texture)[3] == 64
    assert texel(shown.clearcoat_texture)[0] == 64
    assert shown.clearcoat == 1


def test_blender_specular_level(scene):
    """Specular reflection of Blender's FBX files is read as Blender does.

    Its exporter writes half the specular level, of which 0.5 means 4 %, as plastics reflect.
    """
    text = fbx(material(30, "p", DiffuseColor=(0.3, 0.3, 0.3), SpecularFactor=0.175, ReflectionFactor=0.0), [(30, 20)])
    text = text.replace("FBX SDK/FBX Plugins version 2020.3", "Blender (stable FBX IO) - 4.5.15 LTS - 5.13.1")
    (found,) = scene("a.fbx", text).materials
    assert (found.kind, found.specular) == ("metallic_roughness", pytest.approx(0.7))
