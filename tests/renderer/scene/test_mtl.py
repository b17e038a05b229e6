"""Tests that materials of MTL files, as exporters write them, become the nearest physical surface."""

import io

import numpy as np
import pytest
from PIL import Image

from renderer.image.encode import encode

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl m\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def material(scene):
    """Returns a function `material(mtl, files)` that reads a triangle whose MTL file has these statements.

    The function returns (scene description, material).
    """

    def read(statements, others=None, faces=TRIANGLE + "usemtl m\nf 1 2 3\n"):
        description = scene("a.obj", f"mtllib a.mtl\n{faces}", {"a.mtl": f"newmtl m\n{statements}\n", **(others or {})})
        return description, description.materials[0]

    return read


def picture(pixels):
    out = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(out, "PNG")
    return out.getvalue()


@pytest.mark.parametrize(
    ("statement", "name", "wrap", "transform"),
    [
        ("1 wood.png", "1 wood.png", "repeat", (1, 0, 0, 0, 1, 0)),
        ("-bm 1 1 wood.png", "1 wood.png", "repeat", (1, 0, 0, 0, 1, 0)),
        ("-s 2 3 1 -o 0.25 0.5 wood.png", "wood.png", "repeat", (2, 0, 0.25, 0, 3, -2.5)),
        ("-clamp on\t-s 1 1 1  1 wood.png", "1 wood.png", "clamp", (1, 0, 0, 0, 1, 0)),
    ],
)
def test_map_options(material, png, statement, name, wrap, transform):
    description, _ = material(f"map_Kd {statement}", {name: png(1, 2, 3)})
    assert description.images[0].name == name
    assert (description.textures[0].wrap_s, description.textures[0].transform) == (wrap, transform)


def test_map_base_and_gain(material):
    grey = picture([[[0, 0, 0], [127, 127, 127], [255, 255, 255]]])
    description, found = material("map_Pr -mm 0.2 0.4 r.png", {"r.png": grey})
    image = description.images[description.textures[found.metallic_roughness_texture].image]
    assert image.pixels[0, :, 1].tolist() == [51, 102, 153]  # 0.2 + 0.4 x
    description, found = material("map_Kd -mm 0 0.5 c.png", {"c.png": grey})
    image = description.images[description.textures[found.base_color_texture].image]
    assert image.pixels[0, :, 0].tolist() == [0, 92, 188]  # colours are scaled in linear light
    _, found = material("map_Kd -mm 0 one c.png", {"one c.png": grey, "c.png": grey})
    assert found.base_color_texture is not None


def test_decal_blends_map_and_color(material):
    """A decal shows map_Kd where the decal map is 1 and Kd where it is 0, as specified; each map has its own options."""
    files = {"a.png": picture([[[250, 0, 0], [0, 250, 0]]]), "shape.png": picture([[[0, 0, 0], [200, 200, 200]]])}
    statements = "Kd 0.5 0.25 1\nmap_Kd -s 4 4 a.png\ndecal -clamp on -s 2 2 shape.png"
    description, found = material(statements, files)
    lowest = description.textures[found.base_color_texture]
    assert description.images[lowest.image].pixels[0].tolist() == [[250, 0, 0, 255], [0, 250, 0, 255]]
    (layer,) = lowest.layers
    assert (layer.blend, layer.strength, found.base_color) == ("over", 1, (1, 1, 1))
    above = description.textures[layer.texture]
    color = [188, 137, 255]  # Kd in sRGB
    image = description.images[above.image]
    assert image.srgb and image.pixels[0].tolist() == [[*color, 255], [*color, 55]]
    assert (lowest.wrap_s, lowest.transform) == ("repeat", (4, 0, 0, 0, 4, -3))
    assert (above.wrap_s, above.transform) == ("clamp", (2, 0, 0, 0, 2, -1))


def test_decal_with_opacity_and_without_map(material):
    files = {
        "a.png": picture([[[250, 0, 0]] * 2]),
        "shape.png": picture([[[9, 9, 9]]]),
        "d.png": picture([[[0, 0, 0], [255] * 3]]),
    }
    description, found = material("Kd 0 0 0\nmap_Kd a.png\ndecal shape.png\nmap_d d.png", files)
    lowest = description.textures[found.base_color_texture]
    assert description.images[lowest.image].pixels[0].tolist() == [[250, 0, 0, 0], [250, 0, 0, 255]]
    (layer,) = lowest.layers
    assert description.images[description.textures[layer.texture].image].pixels.tolist() == [[[0, 0, 0, 246]]]
    description, found = material("Kd 0.5 0.5 0.5\ndecal shape.png", files)
    assert (found.base_color_texture, found.base_color) == (None, (0.5, 0.5, 0.5))
    assert any("its decal is left out, since there is no map_Kd" in w for w in description.warnings)


def test_huge_gain_is_clamped(material):
    sky = encode(np.ones((1, 2, 3), np.float32), "exr")
    description, found = material("map_Ke -mm 0 1e39 sky.exr", {"sky.exr": sky})
    image = description.images[description.textures[found.emission_texture].image]
    np.testing.assert_array_equal(image.pixels, np.float32(1e9))


def test_map_scale_and_offset(material, png):
    description, _ = material("map_Kd -s 2 3 -o 0.25 0.5 wood.png", {"wood.png": png(1, 2, 3)})
    matrix = np.array(description.textures[0].transform).reshape(2, 3)
    u, v = 0.3, 0.7  # v runs upwards in the file; ours is 1 - v
    found = matrix @ (u, 1 - v, 1)
    np.testing.assert_allclose((found[0], 1 - found[1]), (2 * u + 0.25, 3 * v + 0.5))


def test_the_physical_extension(material, png):
    statements = "Kd 0.5 0.4 0.3\nPr 0.3\nPm 0.75\nPc 0.6\nPcr 0.1\nPs 0.5\naniso 0.4\nanisor 0.25\nnorm bumps.png"
    description, found = material(statements, {"bumps.png": png(128, 128, 255)})
    assert (found.kind, found.base_color, found.roughness, found.metallic) == ("metallic_roughness", (0.5, 0.4, 0.3), 0.3, 0.75)
    assert (found.clearcoat, found.clearcoat_roughness, found.sheen_color) == (0.6, 0.1, (0.5, 0.5, 0.5))
    assert (found.anisotropy, found.anisotropy_rotation) == (0.4, np.pi / 2)
    assert not description.images[description.textures[found.normal_texture].image].srgb


def test_roughness_and_metal_maps_are_packed(material):
    rough, metal = picture([[[10, 0, 0], [20, 0, 0]]]), picture([[[30, 0, 0]], [[40, 0, 0]]])
    description, found = material("map_Pr r.png\nmap_Pm m.png", {"r.png": rough, "m.png": metal})
    image = description.images[description.textures[found.metallic_roughness_texture].image]
    assert image.pixels[0, :, 1].tolist() == [10, 20]
    assert image.pixels[0, :, 2].tolist() == [30, 30]
    assert (image.srgb, found.roughness, found.metallic) == (False, 1, 1)
    description, found = material("Pr 0.5\nmap_Pm m.png", {"m.png": metal})
    image = description.images[description.textures[found.metallic_roughness_texture].image]
    assert (image.pixels[..., 1] == 255).all()
    assert (image.pixels[:, 0, 2].tolist(), found.roughness) == ([30, 40], 0.5)


@pytest.mark.parametrize(("statement", "opacity"), [("d 0.25", 0.25), ("Tr 0.25", 0.75), ("d 1", 1), ("d 0", 1), ("Tr 1", 1)])
def test_opacity(material, statement, opacity):
    _, found = material(statement)
    assert (found.opacity, found.alpha_mode) == (opacity, "blend" if opacity < 1 else "opaque")


def test_opacity_map_becomes_the_color_alpha(material):
    leaf, mask = picture([[[1, 2, 3], [4, 5, 6]]]), picture([[[0, 0, 0], [200, 200, 200]]])
    description, found = material("map_Kd leaf.png\nmap_d mask.png", {"leaf.png": leaf, "mask.png": mask})
    image = description.images[description.textures[found.base_color_texture].image]
    assert image.pixels[0].tolist() == [[1, 2, 3, 0], [4, 5, 6, 200]]
    assert (found.alpha_mode, image.srgb) == ("blend", True)
    cut = picture([[[9, 9, 9, 0], [9, 9, 9, 255]]])  # an image with an alpha channel
    description, found = material("Kd 0.5 0.5 0.5\nmap_d cut.png", {"cut.png": cut})
    image = description.images[description.textures[found.base_color_texture].image]
    assert image.pixels[0].tolist() == [[255, 255, 255, 0], [255, 255, 255, 255]]
    assert found.base_color == (0.5, 0.5, 0.5)


def test_bump_map_with_normals_is_used(material, png):
    flat = picture(np.full((2, 2, 3), (128, 127, 255)))
    description, found = material("map_Bump -bm 0.5 n.png", {"n.png": flat})
    assert (found.normal_scale, description.textures[found.normal_texture].image) == (0.5, 0)
    description, found = material("map_Bump heights.png", {"heights.png": png(90, 90, 90)})
    assert found.normal_texture is None
    assert any("m: its bump map contains heights and is left out; bake it to a normal map" in w for w in description.warnings)


@pytest.mark.parametrize(("faces", "thin"), [(TETRAHEDRON, False), (TRIANGLE + "usemtl m\nf 1 2 3\n", True)])
def test_glass_is_thin_on_open_meshes(material, faces, thin):
    _, found = material("illum 4\nNi 1.45\nTf 0.5 0.9 0.5\nKd 0.2 0.2 0.2\nd 0.1", faces=faces)
    assert (found.kind, found.ior, found.base_color, found.thin) == ("glass", 1.45, (0.5, 0.9, 0.5), thin)
    assert found.alpha_mode == "opaque"


def test_highlights_of_phong(material):
    _, plastic = material("Kd 0.5 0 0\nKs 0.25 0.25 0.25\nNs 96\nNi 1")
    assert (plastic.kind, plastic.specular, plastic.ior) == ("metallic_roughness", 0.5, 1.5)
    assert plastic.roughness == pytest.approx((2 / 98) ** 0.25)
    _, matte = material("Kd 0.5 0 0\nKs 0.25 0.25 0.25\nNs 96\nillum 1")
    assert matte.kind == "diffuse"
    _, metal = material("Kd 0 0 0\nKs 0.9 0.7 0.2\nNs 300")
    assert (metal.metallic, metal.base_color, metal.specular) == (1, (0.9, 0.7, 0.2), 1)


def test_specular_map_is_read_and_others_are_named(material, png):
    files = {f"{name}.png": png(90, 40, 20) for name in ("s", "n", "d")}
    description, plastic = material("Kd 0.5 0 0\nKs 1 1 1\nNs 96\nmap_Ks s.png\nmap_Ns n.png\ndisp d.png\nmap_Ka s.png", files)
    texture = description.textures[plastic.specular_color_texture]
    assert description.images[texture.image].pixels[0, 0].tolist() == [90, 40, 20, 255]
    assert [w for w in description.warnings if "not supported" in w] == [
        "Material m: not supported and left out: the textures of map_ns, disp."
    ]
    _, metal = material("Kd 0 0 0\nKs 0.9 0.9 0.9\nNs 300\nmap_Ks s.png", files)
    assert (metal.base_color_texture, metal.specular_color_texture) == (0, None)


BLENDERS = """# Blender 4.5.15 LTS MTL File: 'paints.blend'
# www.blender.org

newmtl half
Ns 152.099991
Ka 0.430000 0.430000 0.430000
Kd 0.310000 0.420000 0.534000
Ks 0.350000 0.350000 0.350000
Ni 1.600000
d 1.000000
illum 3

newmtl veil
Ns 250.000000
Ka 1.000000 1.000000 1.000000
Kd 0.500000 0.900000 0.600000
Ks 0.500000 0.500000 0.500000
Ni 1.500000
d 0.420000
illum 9

newmtl coated
Kd 0.200000 0.100000 0.600000
Ks 0.500000 0.500000 0.500000
Ni 1.330000
d 1.000000
illum 2
Pr 0.500000
Pm 0.250000
Ps 0.000000
Pc 3.200000
Pcr 0.130000
aniso 0.000000
anisor 0.000000
Tf 0.850000 0.850000 0.850000
"""


def test_blender_mtl_round_trip(scene):
    """Materials written by Blender have the values that Blender reads back (tests/peers/values_kit.py)."""
    faces = TRIANGLE + "".join(f"usemtl {name}\nf 1 2 3\n" for name in ("half", "veil", "coated"))
    description = scene("a.obj", f"mtllib a.mtl\n{faces}", {"a.mtl": BLENDERS})
    half, veil, coated = description.materials
    assert {each.kind for each in (half, veil, coated)} == {"metallic_roughness"}
    got = half.roughness, half.metallic, half.ior, half.opacity, half.specular
    assert got == pytest.approx((0.61, 0.43, 1.6, 1.0, 0.7), abs=1e-6)
    assert half.base_color == pytest.approx((0.31, 0.42, 0.534))
    assert (veil.roughness, veil.metallic, veil.opacity, veil.transmission) == pytest.approx((0.5, 0.0, 0.42, 0.0))
    assert (veil.base_color, veil.alpha_mode) == (pytest.approx((0.5, 0.9, 0.6)), "blend")
    got = coated.roughness, coated.metallic, coated.clearcoat, coated.clearcoat_roughness, coated.transmission
    assert got == pytest.approx((0.5, 0.25, 0.8, 0.13, 0.85))


def test_blender_roughness_and_metal_maps(scene, png):
    text = "# Blender 4.5.15 LTS MTL File: 'None'\nnewmtl m\nNs 250\nillum 3\nmap_Ns r.png\nmap_refl m.png\n"
    files = {"a.mtl": text, "r.png": png(64, 64, 64), "m.png": png(200, 200, 200)}
    description = scene("a.obj", f"mtllib a.mtl\n{TRIANGLE}usemtl m\nf 1 2 3\n", files)
    (found,) = description.materials
    assert (found.roughness, found.metallic) == (1.0, 1.0)
    pixels = description.images[description.textures[found.metallic_roughness_texture].image].pixels
    assert pixels[0, 0, 1:3].tolist() == [64, 200]
    assert not description.warnings[:-1]


@pytest.mark.parametrize("mark", ["<UDIM>", "%(UDIM)d", "<udim>", "<UVTILE>"])
def test_udim_tiles_are_combined(scene, png, mark):
    names = ["u1_v1", "u2_v1", "u1_v2"] if mark == "<UVTILE>" else ["1001", "1002", "1011"]
    colors = [(255, 0, 0), (0, 255, 0), (0, 0, 255)]
    files = {f"tex/paint.{name}.png": png(*color) for name, color in zip(names, colors, strict=True)}
    mtl = f"newmtl a\nmap_Kd -o 1 0 0 tex/paint.{mark}.png\n"
    text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n"
    description = scene("a.obj", text, {"m.mtl": mtl, **files})
    texture = description.textures[description.materials[0].base_color_texture]
    pixels = description.images[texture.image].pixels
    assert pixels.shape == (4, 4, 4)
    assert [pixels[y, x, :3].tolist() for y, x in ((2, 0), (2, 2), (0, 0))] == [[255, 0, 0], [0, 255, 0], [0, 0, 255]]
    assert texture.transform == (0.5, 0, 0.5, 0, 0.5, 0.5)


def test_missing_tiles_are_named(scene):
    text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n"
    description = scene("a.obj", text, {"m.mtl": "newmtl a\nmap_Kd paint.<UDIM>.png\n"})
    assert any("paint.1001.png is not among the files" in w for w in description.warnings)
