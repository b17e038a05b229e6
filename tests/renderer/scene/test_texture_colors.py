"""Tests of colour spaces of textures: pixels equal those of OpenColorIO's own processor; faults are one warning."""

import io

import numpy as np
import PyOpenColorIO as ocio  # noqa: N813 -- the name its own documentation uses
import pytest
from PIL import Image
from pxr import Sdf, UsdShade

from renderer.image.encode import encode
from renderer.image.ocio import BUILTIN
from renderer.image.tonemap import decode_srgb
from renderer.scene import texture_colors
from tests.renderer.scene.test_usd_materials import shaded  # noqa: F401
from tests.renderer.scene.usd_files import TYPES, material, texture

# A config as of a studio: a paint space by a LUT in a file, with a role and a file rule of its own.
STUDIO = """
ocio_profile_version: 2
search_path: luts
roles: {aces_interchange: aces, scene_linear: aces, default: aces, paint: curve}
file_rules:
  - !<Rule> {name: Painted, colorspace: curve, pattern: "*_paint", extension: "*"}
  - !<Rule> {name: Default, colorspace: aces}
displays: {Screen: [!<View> {name: Plain, colorspace: aces}]}
colorspaces:
  - !<ColorSpace> {name: aces, aliases: [ap0], isdata: false}
  - !<ColorSpace> {name: numbers, isdata: true}
  - !<ColorSpace>
    name: curve
    isdata: false
    to_scene_reference: !<FileTransform> {src: LUT}
"""
LUT = "Version 1\nFrom 0.0 1.0\nLength 3\nComponents 1\n{\n0.0\n0.25\n1.0\n}\n"
CODES = np.array([[(200, 100, 50, 255), (128, 128, 128, 100)], [(255, 255, 255, 255), (90, 80, 70, 0)]], np.uint8)
FILES = {"studio.ocio": STUDIO.replace("LUT", "c.spi1d"), "luts/c.spi1d": LUT}


def png(pixels=CODES):
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "PNG")
    return out.getvalue()


def picture(scene, lines, files, name="t.png"):
    """Returns the image of the base colour, and the warnings, of a scene whose one texture has `lines`."""
    top, _, own = lines.rpartition("|")
    text = f"{top}\ntextures: {{t: {{image: {name}, {own}}}}}\nmaterials: {{m: {{texture: t}}}}\n"
    text += "shapes: [{type: quad, material: m}]\n"
    found = scene("s.yaml", text, files)
    number = found.materials[0].base_color_texture
    return found.images[found.textures[number].image], found.warnings


def linear(image):
    """Returns an image's linear RGB."""
    if image.pixels.dtype == np.float32:
        return image.pixels[..., :3]
    share = image.pixels[..., :3] / np.float32(np.iinfo(image.pixels.dtype).max)
    return decode_srgb(share.astype(np.float32)) if image.srgb else share


def by_ocio(config, space, rgb):
    """Returns colours converted to linear Rec.709 by OpenColorIO's default processor."""
    made = ocio.Config.GetProcessorToBuiltinColorSpace(config, space, "lin_rec709_srgb").getDefaultCPUProcessor()
    values = np.array(rgb, np.float32, order="C")
    made.applyRGB(values.reshape(-1, 3))
    return values


@pytest.mark.parametrize("space", ["Utility - Gamma 2.2 - Rec.709 - Texture", "scene_linear"])
def test_built_in_names_aliases_and_roles_are_converted(scene, space):
    found, _ = picture(scene, f"|colorspace: {space}", {"t.png": png()})
    wanted = by_ocio(ocio.Config.CreateFromFile(BUILTIN["cg"]), space, CODES[..., :3] / np.float32(255))
    np.testing.assert_allclose(linear(found), np.maximum(wanted, 0), rtol=1e-3, atol=2e-4)
    assert found.srgb and (found.pixels[..., 3] / found.pixels.max(initial=1) * 255).round().max() <= 255


def test_floats_keep_their_range_and_warn_of_colors_outside_the_gamut(scene):
    pixels = np.array([[(20, 15, 10), (0, 1, 0)]], np.float32)
    found, warnings = picture(scene, "|colorspace: ACEScg", {"t.exr": encode(pixels, "exr")}, "t.exr")
    wanted = by_ocio(ocio.Config.CreateFromFile(BUILTIN["cg"]), "ACEScg", pixels)
    assert wanted.max() > 20 and wanted[0, 1].min() < 0
    np.testing.assert_allclose(linear(found), np.maximum(wanted, 0), rtol=2e-3)
    assert [w for w in warnings if "outside Rec.709" in w] == [
        "t.exr: 50.0 % of its texels have colours outside Rec.709, which are clipped to it"
    ]


@pytest.mark.parametrize(
    ("lines", "name"), [("|colorspace: curve", "t.png"), ("|colorspace: paint", "t.png"), ("|wrap: repeat", "a_paint.png")]
)
def test_own_config_by_name_role_and_file_rule(scene, lines, name):
    found, warnings = picture(scene, f"color_config: studio.ocio\n{lines}", {**FILES, name: png()}, name)
    axis = np.interp(CODES[..., :3] / 255, [0, 0.5, 1], [0, 0.25, 1])
    plain = ocio.Config.CreateFromStream(STUDIO.replace("FileTransform> {src: LUT}", "MatrixTransform> {}"))
    np.testing.assert_allclose(linear(found), np.maximum(by_ocio(plain, "aces", axis), 0), rtol=1e-3, atol=2e-4)
    assert not [w for w in warnings if "OCIO" in w]


def test_config_beside_the_scene_applies_and_an_encoding_overrides_its_rules(scene):
    files = {"config.ocio": FILES["studio.ocio"], "luts/c.spi1d": LUT, "a_paint.png": png()}
    by_rule, _ = picture(scene, "|wrap: repeat", files, "a_paint.png")
    assert by_rule.pixels.dtype != np.uint8
    explicit, _ = picture(scene, "|encoding: srgb", files, "a_paint.png")
    np.testing.assert_array_equal(explicit.pixels, CODES)
    data, _ = picture(scene, "|colorspace: numbers", files, "a_paint.png")
    assert not data.srgb and (data.pixels == CODES).all()


def test_unknown_space_is_one_warning_and_read_as_srgb(scene):
    found, warnings = picture(scene, "|colorspace: ACEScgg", {"t.png": png()})
    assert found.srgb and (found.pixels == CODES).all()
    (warning,) = [w for w in warnings if "ACEScgg" in w]
    assert "t.png: the OCIO config studio has no colour space 'ACEScgg'" in warning and "ACEScg" in warning.split("known are")[1]


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ("gone.ocio", "gone.ocio is not among the files"),
        ("bad.ocio", "bad.ocio cannot be used"),
        ("outside.ocio", "outside.ocio cannot be used"),
    ],
)
def test_faulty_configs_are_one_warning(scene, tmp_path_factory, config, said):
    """OpenColorIO opens no file outside the scene's folder: the LUT that outside.ocio names exists."""
    outside = tmp_path_factory.mktemp("outside") / "outside.spi1d"
    outside.write_text(LUT)
    files = {"bad.ocio": "nothing: [", "outside.ocio": STUDIO.replace("LUT", str(outside)), "t.png": png()}
    found, warnings = picture(scene, f"color_config: {config}\n|colorspace: curve", files)
    assert found.srgb and (found.pixels == CODES).all()
    assert len([w for w in warnings if said in w]) == 1


def test_an_empty_lut_does_not_open_the_file_of_its_path(scene, tmp_path_factory):
    """OpenColorIO opens the path itself if it is given no bytes."""
    outside = tmp_path_factory.mktemp("outside")
    (outside / "outside.spi1d").write_text(LUT)
    config = STUDIO.replace("LUT", "outside.spi1d").replace("search_path: luts", f"search_path: {outside}")
    files = {"studio.ocio": config, "outside.spi1d": "", "t.png": png()}
    found, warnings = picture(scene, "color_config: studio.ocio\n|colorspace: curve", files)
    assert found.srgb and (found.pixels == CODES).all()
    assert [w for w in warnings if "outside.spi1d is empty" in w]


def test_luts_of_equal_names_are_those_of_their_scenes(scene):
    """OpenColorIO caches LUTs by path, also those that it reads from a scene's files."""
    made = []
    for middle in ("0.25", "0.75"):
        files = {**FILES, "luts/c.spi1d": LUT.replace("0.25", middle), "t.png": png()}
        made.append(picture(scene, "color_config: studio.ocio\n|colorspace: curve", files)[0].pixels)
    assert (made[0] != made[1]).any()


def test_common_names_need_no_opencolorio(scene, monkeypatch):
    monkeypatch.setattr(texture_colors, "find_spec", lambda name: None)
    for space, srgb in (("Utility - sRGB - Texture", True), ("lin_rec709", False), ("Raw", False)):
        found, warnings = picture(scene, f"|colorspace: {space}", {"t.png": png()})
        assert (found.srgb, (found.pixels == CODES).all()) == (srgb, True)
        assert not [w for w in warnings if "opencolorio" in w]
    found, warnings = picture(scene, "|colorspace: ACEScg", {"t.png": png()})
    assert found.srgb and any("pip install" in w for w in warnings)


def usd_texture(made, space, config):
    """Returns a material of a UsdUVTexture or a MaterialX image with a colour space; sets the stage's config."""
    if config:
        made.GetRootLayer().colorConfiguration = Sdf.AssetPath(config)
    if space.startswith("mtlx:"):
        shader = texture(made, "/look/t", "t.png", "rgb").GetPrim()
        shader.GetAttribute("info:id").Set("ND_image_color3")
        shader.GetAttribute("inputs:file").SetColorSpace(space[5:])
        output = UsdShade.Shader(shader).CreateOutput("out", TYPES.Color3f)
        return material(made, "/look", "ND_standard_surface_surfaceshader", "mtlx", base_color=(TYPES.Color3f, output))[0]
    output = texture(made, "/look/t", "t.png", "rgb", sourceColorSpace=(TYPES.Token, space))
    return material(made, "/look", diffuseColor=(TYPES.Color3f, output))[0]


@pytest.mark.parametrize(("space", "config"), [("ACEScct", ""), ("mtlx:paint", "studio.ocio")])
def test_usd_and_materialx_textures(shaded, tmp_path, space, config):  # noqa: F811
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    found, look = shaded(lambda made: usd_texture(made, space, config))
    image = found.images[found.textures[look.base_color_texture].image]
    rgb = np.array((200, 100, 50), np.float32) / 255
    if config:
        plain = ocio.Config.CreateFromStream(STUDIO.replace("FileTransform> {src: LUT}", "MatrixTransform> {}"))
        wanted = by_ocio(plain, "aces", np.interp(rgb, [0, 0.5, 1], [0, 0.25, 1]))
    else:
        wanted = by_ocio(ocio.Config.CreateFromFile(BUILTIN["cg"]), "ACEScct", rgb)
    np.testing.assert_allclose(linear(image)[0, 0], np.maximum(wanted, 0), rtol=1e-3, atol=2e-4)
    assert not [w for w in found.warnings if "OCIO" in w]


def test_colors_without_a_texture_are_converted(shaded):  # noqa: F811
    def make(made):
        look, shader = material(made, "/look", diffuseColor=(TYPES.Color3f, (0.5, 0.2, 0.1)))
        shader.GetInput("diffuseColor").GetAttr().SetColorSpace("lin_ap1")
        return look

    _, look = shaded(make)
    wanted = by_ocio(ocio.Config.CreateFromFile(BUILTIN["cg"]), "ACEScg", (0.5, 0.2, 0.1))
    np.testing.assert_allclose(look.base_color, wanted, rtol=1e-4)
