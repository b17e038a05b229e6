"""Tests of USD: materials and textures have the values of their shaders."""

import re

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdShade, Vt

from tests.renderer.scene.usd_files import TYPES, bind, cube, material, mesh, read, stage, texture

F, C = TYPES.Float, TYPES.Color3f


@pytest.fixture
def shaded(tmp_path, png):
    """Returns a function `shaded(make)` that reads a square with the material made by `make(stage)`; t.png is (200, 100, 50)."""

    def make_scene(make):
        made = stage(tmp_path / "a.usda")
        square = mesh(made, "/m")
        UsdGeom.PrimvarsAPI(square).CreatePrimvar("st", TYPES.TexCoord2fArray, "vertex").Set([(0, 0), (1, 0), (1, 1), (0, 1)])
        (tmp_path / "t.png").write_bytes(png(200, 100, 50))
        bind(square, make(made))
        made.GetRootLayer().Save()
        found = read(tmp_path / "a.usda")
        return found, found.materials[found.meshes[0].material]

    return make_scene


def preview(**inputs):
    """Returns a function that makes a UsdPreviewSurface material.

    inputs: (type, value), or (type, function that makes an output).
    """

    def make(made):
        given = {name: (kind, value(made) if callable(value) else value) for name, (kind, value) in inputs.items()}
        return material(made, "/look", **given)[0]

    return make


def image(output="rgb", **inputs):
    """Returns an input value that connects to a texture of t.png."""
    return lambda made: texture(made, f"/look/{output}{len(inputs)}", "t.png", output, **inputs)


def test_preview_surface_constants(shaded):
    _, found = shaded(
        preview(
            diffuseColor=(C, (0.1, 0.2, 0.3)),
            roughness=(F, 0.35),
            metallic=(F, 0.6),
            ior=(F, 1.8),
            clearcoat=(F, 0.7),
            clearcoatRoughness=(F, 0.15),
            emissiveColor=(C, (2, 3, 4)),
        )
    )
    assert found.kind == "metallic_roughness"
    got = (*found.base_color, found.roughness, found.metallic, found.ior, found.clearcoat, found.clearcoat_roughness)
    np.testing.assert_allclose((*got, *found.emission), (0.1, 0.2, 0.3, 0.35, 0.6, 1.8, 0.7, 0.15, 2, 3, 4), atol=1e-6)


def test_preview_surface_defaults(shaded):
    _, found = shaded(preview())
    got = (*found.base_color, found.roughness, found.metallic, found.ior, found.clearcoat, found.opacity, found.transmission)
    np.testing.assert_allclose(got, (0.18, 0.18, 0.18, 0.5, 0, 1.5, 0, 1, 0), atol=1e-6)


@pytest.mark.parametrize(
    ("inputs", "expected"),
    [
        ({"opacity": (F, 0.25)}, ("opaque", 1.0, 0.75)),
        ({"opacity": (F, 0.25), "opacityMode": (TYPES.Token, "presence")}, ("blend", 0.25, 0.0)),
        ({"opacity": (F, 0.25), "opacityThreshold": (F, 0.4)}, ("mask", 0.25, 0.0)),
    ],
)
def test_preview_surface_opacity_modes(shaded, inputs, expected):
    _, found = shaded(preview(**inputs))
    assert (found.alpha_mode, found.opacity, found.transmission) == expected
    assert found.thin == (found.transmission > 0)  # a square is open, so it is a pane


def test_specular_workflow_reflectance(shaded):
    _, found = shaded(preview(useSpecularWorkflow=(TYPES.Int, 1), specularColor=(C, (0.5, 0.3, 0.1)), metallic=(F, 1.0)))
    own = ((found.ior - 1) / (found.ior + 1)) ** 2
    np.testing.assert_allclose(np.multiply(found.specular_color, own), (0.5, 0.3, 0.1), rtol=1e-5)
    assert found.metallic == 0


def linear(code):
    x = code / 255
    return x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4


def seen(description, number, channel=0):
    """Returns one channel of the upper left texel of texture `number`, decoded as shaders read it."""
    picture = description.images[description.textures[number].image]
    code = int(picture.pixels[0, 0, channel])
    return linear(code) if picture.srgb and channel < 3 else code / 255


def test_texture_channel_color_space_scale_and_bias(shaded):
    found, look = shaded(
        preview(
            diffuseColor=(C, image(scale=(TYPES.Float4, (0.5, 0.25, 1, 1)))),
            roughness=(F, image("g", sourceColorSpace=(TYPES.Token, "raw"), scale=(TYPES.Float4, (1, 0.5, 1, 1)))),
            metallic=(F, image("b", sourceColorSpace=(TYPES.Token, "raw"), bias=(TYPES.Float4, (0, 0, 0.25, 0)))),
            clearcoat=(F, image("r", sourceColorSpace=(TYPES.Token, "sRGB"), wrapS=(TYPES.Token, "clamp"))),
        )
    )
    assert look.base_color == (0.5, 0.25, 1)
    assert [seen(found, look.base_color_texture, k) for k in range(3)] == [linear(200), linear(100), linear(50)]
    assert (look.roughness, look.metallic) == (1, 1)
    assert seen(found, look.metallic_roughness_texture, 1) == pytest.approx(100 / 255 / 2, abs=1 / 255)
    assert seen(found, look.metallic_roughness_texture, 2) == pytest.approx(50 / 255 + 0.25, abs=1 / 255)
    assert seen(found, look.clearcoat_texture) == pytest.approx(linear(200), abs=1 / 255)
    assert found.textures[look.clearcoat_texture].wrap_s == "clamp"


def test_normal_map_strength_and_orientation(shaded):
    plain = {"scale": (TYPES.Float4, (2, 2, 2, 1)), "bias": (TYPES.Float4, (-1, -1, -1, 0))}
    found, look = shaded(preview(normal=(TYPES.Normal3f, image(**plain))))
    assert look.normal_scale == 1
    assert seen(found, look.normal_texture, 1) == 100 / 255
    down = {"scale": (TYPES.Float4, (2, -2, 2, 1)), "bias": (TYPES.Float4, (-1, 1, -1, 0))}
    found, look = shaded(preview(normal=(TYPES.Normal3f, image(**down))))
    assert seen(found, look.normal_texture, 1) == 155 / 255


def test_usd_transform_2d(shaded):
    scale, angle, move = np.array((2.0, 3.0)), 30.0, np.array((0.1, 0.2))

    def make(made):
        turn = UsdShade.Shader.Define(made, "/look/turn")
        turn.CreateIdAttr("UsdTransform2d")
        reader = UsdShade.Shader.Define(made, "/look/st")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", TYPES.String).Set("st")
        turn.CreateInput("in", TYPES.Float2).ConnectToSource(reader.CreateOutput("result", TYPES.Float2))
        turn.CreateInput("scale", TYPES.Float2).Set(Gf.Vec2f(*scale))
        turn.CreateInput("rotation", F).Set(angle)
        turn.CreateInput("translation", TYPES.Float2).Set(Gf.Vec2f(*move))
        st = turn.CreateOutput("result", TYPES.Float2)
        return preview(diffuseColor=(C, texture(made, "/look/t", "t.png", st=st)))(made)

    found, look = shaded(make)
    a, b, c, d, e, f = found.textures[look.base_color_texture].transform
    cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    for s, t in ((0, 0), (1, 0), (0.3, 0.8)):
        x, y = np.array([[cosine, -sine], [sine, cosine]]) @ (scale * (s, t)) + move
        np.testing.assert_allclose((a * s + b * (1 - t) + c, d * s + e * (1 - t) + f), (x, 1 - y), atol=1e-6)


def test_missing_texture_causes_a_warning(shaded):
    found, _ = shaded(lambda made: preview(diffuseColor=(C, texture(made, "/look/t", "./deep/gone.png")))(made))
    assert any("its texture gone.png is not among the files; add it" in w for w in found.warnings)


@pytest.mark.parametrize("name", ["displayColor", "tint"])
def test_primvar_reader_uses_vertex_colors(shaded, name):
    def make(made):
        square = UsdGeom.Mesh.Get(made, "/m")
        primvar = UsdGeom.PrimvarsAPI(square).CreatePrimvar(name, TYPES.Color3fArray, "vertex")
        primvar.Set(Vt.Vec3fArray([(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)]))
        reader = UsdShade.Shader.Define(made, "/look/color")
        reader.CreateIdAttr("UsdPrimvarReader_float3")
        reader.CreateInput("varname", TYPES.String).Set(name)
        return preview(diffuseColor=(C, reader.CreateOutput("result", TYPES.Float3)))(made)

    found, look = shaded(make)
    assert look.base_color == (1, 1, 1)
    np.testing.assert_array_equal(found.meshes[0].colors[:, :3], [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)])


@pytest.mark.parametrize(
    ("given", "color", "rough"),
    [(None, (0.2, 0.4, 0.6), 0.9), ("constant", (1, 0.5, 0.25), 0.3)],
)
def test_missing_and_constant_primvars(shaded, given, color, rough):
    def reader(made, kind, type_name, name, fallback):
        found = UsdShade.Shader.Define(made, f"/look/{name}")
        found.CreateIdAttr(f"UsdPrimvarReader_{kind}")
        found.CreateInput("varname", TYPES.String).Set(name)
        found.CreateInput("fallback", type_name).Set(fallback)
        return found.CreateOutput("result", type_name)

    def make(made):
        on = UsdGeom.PrimvarsAPI(made.GetPrimAtPath("/m"))
        if given:
            on.CreatePrimvar("tint", TYPES.Color3fArray, "constant").Set([color])
            on.CreatePrimvar("dull", F, "constant").Set(rough)
        tint = reader(made, "float3", TYPES.Float3, "tint", (0.2, 0.4, 0.6))
        return material(made, "/look", diffuseColor=(C, tint), roughness=(F, reader(made, "float", F, "dull", 0.9)))[0]

    found, look = shaded(make)
    np.testing.assert_allclose((*look.base_color, look.roughness), (*color, rough), atol=1e-6)
    assert found.meshes[0].colors is None


@pytest.mark.parametrize("file", [None, "nothing.png"])
def test_texture_without_image_uses_its_fallback(shaded, file):
    def make(made):
        outputs = [texture(made, f"/look/{o}", file or "", o, fallback=(TYPES.Float4, (0.1, 0.7, 0.3, 1))) for o in ("rgb", "g")]
        return material(made, "/look", diffuseColor=(C, outputs[0]), roughness=(F, outputs[1]))[0]

    _, look = shaded(make)
    np.testing.assert_allclose((*look.base_color, look.roughness), (0.1, 0.7, 0.3, 0.7), atol=1e-6)


@pytest.mark.parametrize("surface", ["standard_surface", "open_pbr_surface"])
def test_transmission_depth_in_stage_units(tmp_path, surface):
    made = stage(tmp_path / "a.usda", "Y", 0.01)
    weight = "transmission" if surface == "standard_surface" else "transmission_weight"
    inputs = {weight: (F, 1.0), "transmission_depth": (F, 10.0), "transmission_color": (C, (1, 0.5, 0.5))}
    bind(cube(made, "/m"), material(made, "/look", f"ND_{surface}_surfaceshader", "mtlx", **inputs)[0])
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    assert found.materials[found.meshes[0].material].attenuation_distance == pytest.approx(0.1)


def test_materialx_standard_surface(shaded):
    def make(made):
        picture = UsdShade.Shader.Define(made, "/look/picture")
        picture.CreateIdAttr("ND_image_color3")
        picture.CreateInput("file", TYPES.Asset).Set("t.png")
        return material(
            made,
            "/look",
            "ND_standard_surface_surfaceshader",
            "mtlx",
            base=(F, 0.5),
            base_color=(C, picture.CreateOutput("out", C)),
            metalness=(F, 0.25),
            specular_roughness=(F, 0.3),
            specular_IOR=(F, 1.7),
            coat=(F, 0.8),
            sheen=(F, 0.5),
            sheen_color=(C, (1, 0.5, 0)),
            emission=(F, 2.0),
            emission_color=(C, (1, 0.5, 0.25)),
            subsurface=(F, 0.5),
        )[0]

    found, look = shaded(make)
    assert look.base_color == (0.5, 0.5, 0.5)
    assert seen(found, look.base_color_texture) == linear(200)
    np.testing.assert_allclose(
        (look.metallic, look.roughness, look.ior, look.clearcoat, look.clearcoat_roughness, *look.sheen_color, *look.emission),
        (0.25, 0.3, 1.7, 0.8, 0.1, 0.5, 0.25, 0, 2, 1, 0.5),
        atol=1e-6,
    )
    assert any(
        "Of a MaterialX surface's base colour and subsurface colour, the one with the larger weight is used" in w
        for w in found.warnings
    )


def test_unknown_surface_uses_the_display_color(shaded):
    def make(made):
        UsdGeom.Mesh.Get(made, "/m").CreateDisplayColorAttr([(0.1, 0.2, 0.3)])
        return material(made, "/look", "arnold_standard", "arnold")[0]

    found, look = shaded(make)
    np.testing.assert_allclose(look.base_color, (0.1, 0.2, 0.3), atol=1e-6)
    assert any("unknown surface shader" in w and "look" in w for w in found.warnings)


def test_omnipbr_without_other_surface(shaded, png, tmp_path):
    (tmp_path / "orm.png").write_bytes(png(255, 128, 64))

    def make(made):
        look = UsdShade.Material.Define(made, "/look")
        shader = UsdShade.Shader.Define(made, "/look/shader")
        shader.SetSourceAsset("OmniPBR.mdl", "mdl")
        shader.SetSourceAssetSubIdentifier("OmniPBR", "mdl")
        values = {
            "diffuse_texture": (TYPES.Asset, "t.png"),
            "diffuse_tint": (C, (0.5, 1, 1)),
            "enable_ORM_texture": (TYPES.Bool, True),
            "ORM_texture": (TYPES.Asset, "orm.png"),
            "texture_scale": (TYPES.Float2, (2, 3)),
            "enable_emission": (TYPES.Bool, True),
            "emissive_color": (C, (1, 0, 0)),
            "emissive_intensity": (F, 5),
            "enable_opacity": (TYPES.Bool, False),
            "opacity_constant": (F, 0.2),
        }
        for name, (kind, value) in values.items():
            shader.CreateInput(name, kind).Set(value)
        look.CreateSurfaceOutput("mdl").ConnectToSource(shader.ConnectableAPI(), "out")
        return look

    description, found = shaded(make)
    assert found.base_color == pytest.approx((0.5, 1, 1))
    assert found.emission == pytest.approx((5, 0, 0))
    assert (found.alpha_mode, found.roughness, found.metallic) == ("opaque", 1.0, 1.0)
    names = {n: description.textures[getattr(found, n)] for n in ("base_color_texture", "metallic_roughness_texture")}
    assert [description.images[t.image].name for t in names.values()] == ["t.png", "orm.png"]
    assert all(t.transform[0] == 2 and t.transform[4] == 3 for t in names.values())
    assert not description.warnings or not any("display colour" in w for w in description.warnings)


def test_arnold_and_karma_surfaces(shaded):
    """Surfaces of Arnold (Maya; images are named by strings) and Karma (Houdini) are read if a material has no other surface."""

    def arnold(made):
        picture = UsdShade.Shader.Define(made, "/look/picture")
        picture.CreateIdAttr("arnold:image")
        picture.CreateInput("filename", TYPES.String).Set("t.png")
        picture.CreateInput("sscale", TYPES.Float).Set(2.0)
        out = picture.CreateOutput("out", TYPES.Color4f)
        given = {"base_color": (C, out), "metalness": (F, 1.0), "specular_roughness": (F, 0.35)}
        return material(made, "/look", "arnold:standard_surface", "arnold", **given)[0]

    description, found = shaded(arnold)
    assert (found.metallic, found.roughness) == pytest.approx((1, 0.35))
    used = description.textures[found.base_color_texture]
    assert description.images[used.image].pixels[0, 0, :3].tolist() == [200, 100, 50]
    assert used.transform[0] == 2
    assert len(description.warnings) == 1  # the one about missing lights

    given = {"base_color": (C, (0.1, 0.7, 0.2)), "base": (F, 1.0)}
    _, found = shaded(lambda made: material(made, "/look", "ND_standard_surface_surfaceshader", "kma", **given)[0])
    assert found.base_color == pytest.approx((0.1, 0.7, 0.2))


def test_houdini_color_primvar(tmp_path):
    made = stage(tmp_path / "a.usda")
    colors = UsdGeom.PrimvarsAPI(mesh(made, "/m")).CreatePrimvar("Cd", TYPES.Color3fArray, "vertex")
    colors.Set([(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0)])
    made.GetRootLayer().Save()
    assert read(tmp_path / "a.usda").meshes[0].colors[:, :3].tolist() == [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0]]


@pytest.mark.parametrize(
    ("purposes", "shown", "said"),
    [
        (("proxy", "render"), ["m1"], ""),
        (("proxy",), ["m0"], "All visible prims have the purpose proxy, which is usually not rendered; they are drawn here"),
        (("proxy", "default"), ["m1"], r"purpose proxy are not drawn, although .* \(1\): /m0"),
    ],
)
def test_proxies_are_shown_without_other_geometry(purposes, shown, said, tmp_path):
    made = stage(tmp_path / "a.usda")
    for i, purpose in enumerate(purposes):
        mesh(made, f"/m{i}").CreatePurposeAttr(purpose)
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    assert [i.name for i in found.instances] == shown
    assert any(re.search(said, w) for w in found.warnings if "prox" in w) == bool(said)


def test_blender_preview_surface(shaded, tmp_path):
    """Preview surfaces that Blender wrote are read as in Blender: opacity is alpha, which also hides highlights.

    The input `specular`, which only Blender writes, is read too.
    """
    inputs = {"diffuseColor": (C, (0.5, 0.9, 0.6)), "opacity": (F, 0.42), "specular": (F, 0.35)}
    _, found = shaded(preview(**inputs))
    assert (found.opacity, found.transmission, found.specular) == (1.0, pytest.approx(0.58), 1.0)
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "a.usda"))
    layer.documentation = "Blender v4.5.15 LTS"
    layer.Save()
    (found,) = read(tmp_path / "a.usda").materials
    assert (found.opacity, found.transmission, found.specular) == (pytest.approx(0.42), 0.0, pytest.approx(0.7))
    assert (found.base_color, found.alpha_mode) == (pytest.approx((0.5, 0.9, 0.6)), "blend")
