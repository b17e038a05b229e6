"""Tests of USD: MaterialX surfaces and their input nodes evaluate to the values that MaterialX defines."""

import numpy as np
import pytest
from PIL import Image
from pxr import UsdGeom, UsdShade

from tests.renderer.scene.test_usd_materials import linear, seen, shaded  # noqa: F401
from tests.renderer.scene.usd_files import TYPES, material

F, C, V2, V3, ASSET = TYPES.Float, TYPES.Color3f, TYPES.Float2, TYPES.Float3, TYPES.Asset
STANDARD, OPEN_PBR, GLTF = (f"ND_{name}_surfaceshader" for name in ("standard_surface", "open_pbr_surface", "gltf_pbr"))
PICTURE = (200, 100, 50)


def node(made, name, kind, output=C, **inputs):
    """Returns the output of a new node; inputs are (type, value) or (type, output of another node)."""
    shader = UsdShade.Shader.Define(made, f"/look/{name}")
    shader.CreateIdAttr(f"ND_{kind}")
    for key, (type_name, value) in inputs.items():
        given = shader.CreateInput(key, type_name)
        if isinstance(value, UsdShade.Output):
            given.ConnectToSource(value)
        else:
            given.Set(value)
    return shader.CreateOutput("out", output)


def picture(made, **inputs):
    return node(made, "picture", "image_color3", file=(ASSET, "t.png"), **inputs)


@pytest.fixture
def looks(shaded):  # noqa: F811
    """Returns a function `looks(kind, name=(type, value or a function that makes an output), ...)`: (description, material)."""

    def make(kind=STANDARD, **inputs):
        def build(made):
            given = {name: (kind, value(made) if callable(value) else value) for name, (kind, value) in inputs.items()}
            return material(made, "/look", kind, "mtlx", **given)[0]

        return shaded(build)

    return make


ARITHMETIC = {  # operation on an image and constants, and its result for red, green and blue
    "multiply": ({"in2": (C, (0.5, 0.25, 1))}, lambda x: x * (0.5, 0.25, 1)),
    "add": ({"in2": (C, (0.1, 0.2, 0.3))}, lambda x: np.add(x, (0.1, 0.2, 0.3))),
    "subtract": ({"in2": (C, (0.1, 0, 0))}, lambda x: x - (0.1, 0, 0)),
    "divide": ({"in2": (C, (2, 4, 1))}, lambda x: x / (2, 4, 1)),
    "mix": ({"bg": (C, (0.5, 0.25, 1)), "mix": (F, 0.25)}, lambda x: 0.25 * x + 0.75 * np.array((0.5, 0.25, 1))),
    "invert": ({}, lambda x: 1 - x),
    "remap": ({"outlow": (C, (0.5,) * 3), "outhigh": (C, (1,) * 3)}, lambda x: 0.5 + 0.5 * x),
}


@pytest.mark.parametrize("name", ARITHMETIC)
def test_arithmetic_on_image_and_constants(looks, name):
    inputs, expected = ARITHMETIC[name]
    first = {"mix": "fg", "invert": "in", "remap": "in"}.get(name, "in1")
    found, look = looks(
        base_color=(C, lambda made: node(made, "sum", f"{name}_color3", **{first: (C, picture(made))}, **inputs)),
    )
    got = [seen(found, look.base_color_texture, k) * look.base_color[k] for k in range(3)]
    np.testing.assert_allclose(got, expected(np.array([linear(c) for c in PICTURE])), atol=0.004)
    assert not any("MaterialX" in w for w in found.warnings)


def texels(folder, name, rows):
    """Writes an image, and returns its linear values (h, w, 3)."""
    codes = np.array(rows, np.uint8)
    Image.fromarray(codes).save(folder / name)
    return np.array([[[linear(int(c)) for c in texel] for texel in row] for row in rows])


@pytest.fixture
def pictures(tmp_path):
    """Writes two images next to t.png; returns their values and a function that makes the nodes that read them."""
    random = np.random.default_rng(4)
    one = texels(tmp_path, "one.png", random.integers(0, 255, (4, 8, 3)).tolist())
    other = texels(tmp_path, "other.png", random.integers(0, 255, (4, 8, 3)).tolist())

    def shown(made, name, kind="color3", **inputs):
        return node(made, name, f"image_{kind}", F if kind == "float" else C, file=(ASSET, f"{name}.png"), **inputs)

    return one, other, shown


def values_of(found, number):
    """Returns the values (h, w, 3) of texture `number`, decoded as shaders read them."""
    picture = found.images[found.textures[number].image]
    values = picture.pixels[..., :3].astype(float) / (255 if picture.pixels.dtype == np.uint8 else 1)
    return np.vectorize(lambda x: linear(255 * x))(values) if picture.pixels.dtype == np.uint8 and picture.srgb else values


BETWEEN = {
    "multiply": ("in1", "in2", lambda a, b: a * b),
    "add": ("in1", "in2", lambda a, b: a + b),
    "subtract": ("in1", "in2", lambda a, b: a - b),
    "divide": ("in1", "in2", lambda a, b: np.divide(a, b, out=np.zeros_like(a), where=b != 0)),
    "max": ("in1", "in2", np.maximum),
    "screen": ("bg", "fg", lambda a, b: 1 - (1 - a) * (1 - b)),
    "overlay": ("bg", "fg", lambda b, f: np.where(b < 0.5, 2 * f * b, 1 - 2 * (1 - f) * (1 - b))),
}


@pytest.mark.parametrize("name", BETWEEN)
def test_arithmetic_on_two_images_is_baked(looks, pictures, name):
    one, other, shown = pictures
    first, second, expected = BETWEEN[name]
    found, look = looks(
        emission=(F, 1.0),
        emission_color=(
            C,
            lambda made: node(
                made,
                "sum",
                f"{name}_color3",
                **{first: (C, shown(made, "one")), second: (C, shown(made, "other"))},
            ),
        ),
    )
    got = values_of(found, look.emission_texture)
    want = expected(one, other)
    np.testing.assert_allclose(got, want, atol=0.008 if want.min() >= 0 and want.max() <= 1 else 1e-6, rtol=1e-5)
    assert not any("MaterialX" in w for w in found.warnings)


def test_image_as_mix_weight(looks, pictures):
    """The mix weight is an image's first channel, which is data and therefore not decoded."""
    one, other, shown = pictures

    def mixed(made):
        share = node(made, "third", "image_float", F, file=(ASSET, "t.png"))
        return node(made, "mix", "mix_color3", fg=(C, shown(made, "one")), bg=(C, shown(made, "other")), mix=(F, share))

    found, look = looks(base_color=(C, mixed))
    got = values_of(found, look.base_color_texture)
    assert got.shape == (4, 8, 3)
    # t.png has two rows, the lower one black; each is sampled a quarter of a texel above or below its centre.
    share = np.array((0.75, 0.75, 0.25, 0.25))[:, None, None] * (200 / 255)
    np.testing.assert_allclose(got, share * one + (1 - share) * other, atol=0.006)


def test_images_with_different_tiling_are_baked(looks, pictures):
    one, other, shown = pictures

    def tiled(made):
        file = (ASSET, "other.png")
        twice = node(made, "twice", "tiledimage_color3", file=file, uvtiling=(V2, (2.0, 1.0)))
        return node(made, "product", "multiply_color3", in1=(C, shown(made, "one")), in2=(C, twice))

    found, look = looks(base_color=(C, tiled))
    got = values_of(found, look.base_color_texture)
    assert got.shape == (4, 16, 3)
    # Every second fine texel samples the coarse image a quarter of a texel away from its centre.
    coarse = 0.75 * one + 0.25 * np.roll(one, 1, axis=1)
    np.testing.assert_allclose(got[:, ::2], np.tile(other, (1, 2, 1))[:, ::2] * coarse, atol=0.008)


def test_images_with_incompatible_mappings_cause_a_warning(looks, pictures):
    _, _, shown = pictures

    def turned(made):
        file = (ASSET, "other.png")
        moved = node(made, "moved", "tiledimage_color3", file=file, uvtiling=(V2, (1.5, 1.0)))
        return node(made, "product", "multiply_color3", in1=(C, shown(made, "one")), in2=(C, moved))

    found, look = looks(base_color=(C, turned))
    assert found.images[found.textures[look.base_color_texture].image].name == "one.png"
    assert any("different placements" in w and "ND_multiply_color3" in w for w in found.warnings)


ALONE = {  # nodes that cannot be written as a factor and an addend of an image
    "power": ("in1", {"in2": (C, (2, 0.5, 1))}, lambda x: x ** np.array((2, 0.5, 1))),
    "clamp": ("in", {"low": (C, (0.3,) * 3), "high": (C, (0.5,) * 3)}, lambda x: np.clip(x, 0.3, 0.5)),
    "smoothstep": ("in", {"low": (C, (0.1,) * 3), "high": (C, (0.6,) * 3)}, None),
    "luminance": ("in", {}, lambda x: np.repeat((x @ (0.2722287, 0.6740818, 0.0536895))[..., None], 3, axis=-1)),
    "saturate": ("in", {"amount": (F, 0.0)}, lambda x: np.repeat((x @ (0.2722287, 0.6740818, 0.0536895))[..., None], 3, axis=-1)),
}


@pytest.mark.parametrize("name", ALONE)
def test_nonlinear_functions_are_baked(looks, pictures, name):
    one, _, shown = pictures
    first, inputs, expected = ALONE[name]
    found, look = looks(
        base_color=(C, lambda made: node(made, "n", f"{name}_color3", **{first: (C, shown(made, "one"))}, **inputs))
    )
    t = np.clip((one - 0.1) / 0.5, 0, 1)
    want = t * t * (3 - 2 * t) if expected is None else expected(one)
    np.testing.assert_allclose(values_of(found, look.base_color_texture), want, atol=0.006)


@pytest.mark.parametrize("first", ["in1", "in2"])
def test_image_times_vertex_color(shaded, first):  # noqa: F811
    def build(made):
        colors = UsdGeom.PrimvarsAPI(made.GetPrimAtPath("/m")).CreatePrimvar("displayColor", TYPES.Color3fArray, "vertex")
        colors.Set([(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)])
        second = {"in1": "in2", "in2": "in1"}[first]
        given = {first: (C, picture(made)), second: (C, node(made, "painted", "geomcolor_color3"))}
        product = node(made, "product", "multiply_color3", **given)
        return material(made, "/look", STANDARD, "mtlx", base_color=(C, product))[0]

    found, look = shaded(build)
    assert seen(found, look.base_color_texture) == linear(200)
    np.testing.assert_allclose(
        np.sort(found.meshes[0].colors[:, :3], axis=0), np.sort([(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)], axis=0)
    )
    assert not any("Primvars" in w for w in found.warnings)


def test_channels_of_two_images_are_combined(looks, pictures):
    one, other, shown = pictures

    def channel(made, name, index):
        given = {"in": (C, shown(made, name)), "index": (TYPES.Int, index)}
        return (F, node(made, f"{name}{index}", "extract_color3", F, **given))

    found, look = looks(
        base_color=(
            C,
            lambda made: node(
                made, "c", "combine3_color3", in1=channel(made, "one", 2), in2=channel(made, "other", 0), in3=(F, 0.25)
            ),
        )
    )
    want = np.stack([one[..., 2], other[..., 0], np.full((4, 8), 0.25)], axis=-1)
    np.testing.assert_allclose(values_of(found, look.base_color_texture), want, atol=0.006)


def test_arithmetic_on_constants(looks):
    _, look = looks(
        base_color=(C, lambda made: node(made, "m", "mix_color3", fg=(C, (1, 0, 0)), bg=(C, (0, 0, 1)), mix=(F, 0.25))),
        specular_roughness=(F, lambda made: node(made, "p", "power_float", F, in1=(F, 0.5), in2=(F, 2.0))),
    )
    np.testing.assert_allclose((*look.base_color, look.roughness), (0.25, 0, 0.75, 0.25), atol=1e-6)


def test_unknown_nodes_are_skipped_and_named(looks):
    found, look = looks(base_color=(C, lambda made: node(made, "c", "colorcorrect_color3", **{"in": (C, picture(made))})))
    assert seen(found, look.base_color_texture) == linear(200)
    assert any("skipped" in w and "ND_colorcorrect_color3" in w for w in found.warnings)


def test_normal_map_node_scale(looks):
    def bumps(made):
        return node(made, "n", "normalmap", V3, **{"in": (V3, picture(made))}, scale=(F, 0.3))

    _, look = looks(normal=(V3, bumps))
    assert look.normal_scale == pytest.approx(0.3)


def rotated(x, y, degrees):
    """Returns MaterialX's rotate2d, which rotates clockwise."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([c * x + s * y, -s * x + c * y])


PIVOT, SCALE, OFFSET = np.array([0.5, 0.2]), np.array([2.0, 4.0]), np.array([0.1, 0.3])
PLACES = {
    "place2d_vector2": (
        {"pivot": (V2, (0.5, 0.2)), "scale": (V2, (2, 4)), "rotate": (F, 30.0), "offset": (V2, (0.1, 0.3))},
        lambda st: rotated(*((st - PIVOT) / SCALE), 30) - OFFSET + PIVOT,
    ),
    "place2d_vector2 moved first": (
        {
            "pivot": (V2, (0.5, 0.2)),
            "scale": (V2, (2, 4)),
            "rotate": (F, 30.0),
            "offset": (V2, (0.1, 0.3)),
            "operationorder": (TYPES.Int, 1),
        },
        lambda st: rotated(*(st - PIVOT - OFFSET), 30) / SCALE + PIVOT,
    ),
    "multiply_vector2": ({"in2": (V2, (4, 5))}, lambda st: st * (4, 5)),
    "subtract_vector2": ({"in2": (V2, (0.5, 0.25))}, lambda st: st - (0.5, 0.25)),
    "rotate2d_vector2": ({"amount": (F, 40.0)}, lambda st: rotated(*st, 40)),
}


@pytest.mark.parametrize("name", PLACES)
def test_texture_coordinate_nodes(looks, name):
    inputs, expected = PLACES[name]
    kind = name.split()[0]
    coordinates = {"place2d": "texcoord", "rotate2d": "in"}.get(kind.split("_")[0], "in1")

    def moved(made):
        uv = node(made, "uv", "texcoord_vector2", V2)
        return picture(made, texcoord=(V2, node(made, "moved", kind, V2, **{coordinates: (V2, uv)}, **inputs)))

    found, look = looks(base_color=(C, moved))
    rows = np.array(found.textures[look.base_color_texture].transform).reshape(2, 3)
    st = np.array([0.3, 0.9])
    u, v = rows @ (st[0], 1 - st[1], 1)
    np.testing.assert_allclose((u, 1 - v), expected(st), atol=1e-6)


def test_tiled_image_offset(looks):
    def tiled(made):
        return node(made, "t", "tiledimage_color3", file=(ASSET, "t.png"), uvtiling=(V2, (2, 3)), uvoffset=(V2, (0.25, 0.5)))

    found, look = looks(base_color=(C, tiled))
    rows = np.array(found.textures[look.base_color_texture].transform).reshape(2, 3)
    u, v = rows @ (0.3, 1 - 0.9, 1)
    np.testing.assert_allclose((u, 1 - v), (2 * 0.3 - 0.25, 3 * 0.9 - 0.5), atol=1e-6)


def test_color_opacity(looks):
    _, look = looks(opacity=(C, (0.25,) * 3))
    assert (look.opacity, look.alpha_mode) == (0.25, "blend")


def test_coat_color_tints_the_base(looks):
    found, look = looks(
        base_color=(C, (0.5, 0.5, 0.5)), coat=(F, 0.5), coat_color=(C, (1, 0.2, 0)), coat_IOR=(F, 2.0), diffuse_roughness=(F, 0.3)
    )
    np.testing.assert_allclose(look.base_color, (0.5, 0.3, 0.25), atol=1e-6)
    for what in ("coat_IOR", "diffuse_roughness"):
        assert any(f"The input {what} of MaterialX surfaces is left out (1): look" in w for w in found.warnings)


def test_specular_and_sheen_textures(looks):
    found, look = looks(
        specular_color=(C, picture), sheen=(F, 0.5), sheen_color=(C, picture), specular_anisotropy=(F, picture), base=(F, picture)
    )
    assert seen(found, look.specular_color_texture) == seen(found, look.sheen_color_texture) == linear(200)
    assert look.sheen_color == (0.5, 0.5, 0.5)
    for what in ("specular_anisotropy", "base"):
        assert any(f"Textures of the input {what} of MaterialX surfaces are left out" in w for w in found.warnings)


def test_subsurface_color(looks):
    _, look = looks(subsurface=(F, 1.0), subsurface_color=(C, (0.6, 0.3, 0.2)))
    np.testing.assert_allclose(look.base_color, (0.6, 0.3, 0.2), atol=1e-6)


def test_gltf_pbr_in_materialx(looks):
    _, look = looks(
        GLTF,
        base_color=(C, (0.1, 0.2, 0.3)),
        metallic=(F, 0.1),
        emissive=(C, (1, 2, 3)),
        emissive_strength=(F, 2.0),
        alpha=(F, 0.4),
        alpha_mode=(TYPES.Int, 2),
        ior=(F, 1.4),
        clearcoat=(F, 0.7),
    )
    np.testing.assert_allclose(
        (*look.base_color, look.metallic, look.roughness, *look.emission, look.opacity, look.ior, look.clearcoat),
        (0.1, 0.2, 0.3, 0.1, 1, 2, 4, 6, 0.4, 1.4, 0.7),
        atol=1e-6,
    )


def test_open_pbr_film_weight(looks):
    _, look = looks(OPEN_PBR, thin_film_weight=(F, 0.3), thin_film_thickness=(F, 0.4))
    assert (look.iridescence, look.iridescence_thickness) == (pytest.approx(0.3), pytest.approx((400, 400)))


@pytest.mark.parametrize("kind", ["mix_color3", "multiply_color3", "clamp_color3", "remap_color3", "combine3_color3"])
def test_nodes_with_string_inputs_are_omitted_and_named(looks, kind):
    words = dict.fromkeys(("in", "in1", "in2", "fg", "bg", "mix", "low", "inlow"), (TYPES.String, "word"))
    found, look = looks(base_color=(C, lambda made: node(made, "odd", kind, **words)))
    assert np.isfinite(look.base_color).all()
    if kind != "combine3_color3":
        assert any("inputs have wrong types" in w or "left out" in w for w in found.warnings)


@pytest.mark.parametrize("kind", ["place2d_vector2", "multiply_vector2", "rotate2d_vector2"])
def test_string_coordinates_use_the_mesh_uvs(looks, kind):
    def moved(made):
        words = dict.fromkeys(("pivot", "scale", "rotate", "in2", "amount"), (TYPES.String, "word"))
        return picture(made, texcoord=(V2, node(made, "odd", kind, V2, **words)))

    found, look = looks(base_color=(C, moved))
    assert found.textures[look.base_color_texture].transform == (1, 0, 0, 0, 1, 0)
    assert any("inputs have wrong types" in w for w in found.warnings)
