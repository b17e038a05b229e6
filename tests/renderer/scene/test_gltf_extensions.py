"""Tests of glTF materials: each field of each KHR_materials extension, and which surfaces refract."""

import math

import numpy as np
import pytest

from renderer.scene.description import Material
from tests.renderer.scene.builders import TRIANGLE, Gltf

TETRAHEDRON = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], np.float32)
FACES = np.array([0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3], np.uint16)

# An extension, its fields, and the expected material. A texture is written as its number.
EXTENSIONS = [
    ("ior", {"ior": 1.33}, {"ior": 1.33}),
    ("ior", {"ior": 0}, {"ior": 1000.0}),
    (
        "specular",
        {"specularFactor": 0.5, "specularColorFactor": [1, 2, 0.5], "specularTexture": 0, "specularColorTexture": 1},
        {"specular": 0.5, "specular_color": (1, 2, 0.5), "specular_texture": 0, "specular_color_texture": 1},
    ),
    (
        "clearcoat",
        {
            "clearcoatFactor": 0.8,
            "clearcoatRoughnessFactor": 0.3,
            "clearcoatTexture": 0,
            "clearcoatRoughnessTexture": 1,
            "clearcoatNormalTexture": 2,
        },
        {
            "clearcoat": 0.8,
            "clearcoat_roughness": 0.3,
            "clearcoat_texture": 0,
            "clearcoat_roughness_texture": 1,
            "clearcoat_normal_texture": 2,
            "clearcoat_normal_scale": 0.25,
        },
    ),
    (
        "sheen",
        {"sheenColorFactor": [0.1, 0.2, 0.3], "sheenRoughnessFactor": 0.4, "sheenColorTexture": 1, "sheenRoughnessTexture": 0},
        {"sheen_color": (0.1, 0.2, 0.3), "sheen_roughness": 0.4, "sheen_color_texture": 1, "sheen_roughness_texture": 0},
    ),
    (
        "transmission",
        {"transmissionFactor": 0.75, "transmissionTexture": 0},
        {"transmission": 0.75, "transmission_texture": 0, "kind": "metallic_roughness"},
    ),
    (
        "volume",
        {"thicknessFactor": 1, "attenuationColor": [0.5, 0.6, 0.7], "attenuationDistance": 2},
        {"attenuation_color": (0.5, 0.6, 0.7), "attenuation_distance": 2},
    ),
    ("volume", {"thicknessFactor": 1}, {"attenuation_color": (1, 1, 1), "attenuation_distance": math.inf}),
    (
        "anisotropy",
        {"anisotropyStrength": 0.6, "anisotropyRotation": 1.5, "anisotropyTexture": 0},
        {"anisotropy": 0.6, "anisotropy_rotation": 1.5, "anisotropy_texture": 0},
    ),
    (
        "iridescence",
        {
            "iridescenceFactor": 0.9,
            "iridescenceIor": 1.8,
            "iridescenceThicknessMinimum": 50,
            "iridescenceThicknessMaximum": 700,
            "iridescenceTexture": 0,
            "iridescenceThicknessTexture": 1,
        },
        {
            "iridescence": 0.9,
            "iridescence_ior": 1.8,
            "iridescence_thickness": (50, 700),
            "iridescence_texture": 0,
            "iridescence_thickness_texture": 1,
        },
    ),
    ("dispersion", {"dispersion": 0.5}, {"dispersion": 0.5}),
    (
        "diffuse_transmission",
        {
            "diffuseTransmissionFactor": 0.4,
            "diffuseTransmissionColorFactor": [1, 0.9, 0.8],
            "diffuseTransmissionTexture": 0,
            "diffuseTransmissionColorTexture": 1,
        },
        {
            "diffuse_transmission": 0.4,
            "diffuse_transmission_color": (1, 0.9, 0.8),
            "diffuse_transmission_texture": 0,
            "diffuse_transmission_color_texture": 1,
        },
    ),
    ("unlit", {}, {"kind": "unlit"}),
]
COLOURS = {"specular_color_texture", "sheen_color_texture", "diffuse_transmission_color_texture"}


@pytest.mark.parametrize(("name", "fields", "expected"), EXTENSIONS)
def test_extension_fields(scene, png, name, fields, expected):
    g = Gltf()
    for i in range(3):
        g.texture({"bufferView": g.view(png(10 * i, 0, 0)), "mimeType": "image/png"})
    scale = {"scale": 0.25}
    written = {
        key: {"index": value, **(scale if "Normal" in key else {})} if key.endswith("Texture") else value
        for key, value in fields.items()
    }
    g.material(extensions={f"KHR_materials_{name}": written})
    g.mesh(material=0)
    description = scene("a.glb", g.glb())
    material = description.materials[0]
    for field, value in expected.items():
        found = getattr(material, field)
        if field.endswith("_texture"):
            image = description.images[description.textures[found].image]
            assert image.pixels[0, 0, 0] == 10 * value
            assert image.srgb == (field in COLOURS)
        else:
            assert found == value, field
    plain = Material(material.name, "metallic_roughness", (1.0, 1.0, 1.0), metallic=1.0, roughness=1.0)
    untouched = [f for f in vars(plain) if f not in expected and getattr(material, f) != getattr(plain, f)]
    assert untouched == []
    assert [w for w in description.warnings if "no light" not in w] == []


def test_unlit_uses_color_and_alpha_only(scene):
    g = Gltf()
    color = {"baseColorFactor": [0.5, 0.25, 0.125, 0.75]}
    g.material(pbrMetallicRoughness=color, emissiveFactor=[1, 1, 1], alphaMode="BLEND", extensions={"KHR_materials_unlit": {}})
    g.mesh(material=0)
    material = scene("a.glb", g.glb()).materials[0]
    assert (material.kind, material.base_color, material.opacity) == ("unlit", (0.5, 0.25, 0.125), 0.75)
    assert (material.alpha_mode, material.emission) == ("blend", (0, 0, 0))


@pytest.mark.parametrize("volume", [None, {"thicknessFactor": 0}, {"thicknessFactor": 0.1}])
@pytest.mark.parametrize("shape", ["closed", "open", "closed by another"])
def test_volumes_and_closed_meshes_refract(scene, volume, shape):
    g = Gltf()
    extensions = {"KHR_materials_transmission": {"transmissionFactor": 1}}
    if volume is not None:
        extensions["KHR_materials_volume"] = volume
    g.material(extensions=extensions)
    g.material()
    g.mesh(TETRAHEDRON, FACES if shape == "closed" else FACES[3:], material=0)
    if shape == "closed by another":
        attributes = {"POSITION": g.array(TETRAHEDRON)}
        g.root["meshes"][0]["primitives"].append({"attributes": attributes, "indices": g.array(FACES[:3]), "material": 1})
    description = scene("a.glb", g.glb())
    thin = description.materials[description.meshes[0].material].thin
    assert thin == (shape == "open" and volume != {"thicknessFactor": 0.1})
    assert not description.materials[0].thin  # the pane has a material of its own


def test_material_is_solid_or_thin_by_mesh(scene):
    g = Gltf()
    g.material(extensions={"KHR_materials_transmission": {"transmissionFactor": 1}})
    g.mesh(TETRAHEDRON, FACES, material=0)
    g.mesh(TRIANGLE, material=0)
    g.mesh(TRIANGLE + 1, material=0)
    description = scene("a.glb", g.glb())
    assert [description.materials[m.material].thin for m in description.meshes] == [False, True, True]
    assert len(description.materials) == 2
