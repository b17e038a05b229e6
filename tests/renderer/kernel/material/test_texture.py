"""Tests of texture lookups and layered textures, against float64 computations and in rendered pictures."""

import numpy as np
import pytest

from renderer.arrays.rows import EMISSION, EMISSION_TEXTURE, METALLIC_ROUGHNESS_TEXTURE
from renderer.errors import SceneError
from renderer.film import ALBEDO, mean
from renderer.jit import entry, subroutine
from renderer.kernel.material.blend import OPERATIONS
from renderer.kernel.material.texture import sample_texture
from renderer.reference import Packed, by_reference
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.description import (
    Image,
    Instance,
    Material,
    Mesh,
    SceneDescription,
    Sphere,
    Texture,
    TextureLayer,
)
from renderer.scene.material import PARAMETERS
from renderer.scene.material_packing import pack
from tests.grids import grid
from tests.renderer.builders import settings
from tests.renderer.judge import assert_mean

RANDOM = np.random.default_rng(7)
COLORS = RANDOM.integers(0, 256, (5, 4, 4), np.uint8)
MASKED = RANDOM.integers(0, 256, (3, 6, 4), np.uint8)
IMAGES = [Image("colors", COLORS), Image("masked", MASKED), Image("data", MASKED, srgb=False)]
MOVED = (2.0, 0.5, 0.1, -0.25, 1.5, -0.3)
SLACK = 2e-6  # float32 rounding of values of about 1
BLENDS = {
    "over": lambda b, t: t,
    "multiply": lambda b, t: b * t,
    "add": lambda b, t: b + t,
    "subtract": lambda b, t: b - t,
    "divide": lambda b, t: b / np.maximum(t, 1 / 255),
    "screen": lambda b, t: 1 - (1 - b) * (1 - t),
    "signed_add": lambda b, t: b + t - 0.5,
    "darken": np.minimum,
    "lighten": np.maximum,
    "difference": lambda b, t: np.abs(b - t),
}


def square(uvs=((0, 1), (1, 1), (1, 0), (0, 0)), uvs1=None, material=0, z=0.0):
    """Returns a square of side 2 at depth z, facing +z."""
    corners = np.array([(-1, -1, z), (1, -1, z), (1, 1, z), (-1, 1, z)], np.float32)
    second = None if uvs1 is None else np.array(uvs1, np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh("square", corners, faces, uvs=np.array(uvs, np.float32), uvs1=second, material=material)


def compiled(textures, material, images=IMAGES, meshes=None, spheres=()):
    meshes = [square()] if meshes is None else meshes
    return compile_scene(
        SceneDescription(
            meshes=meshes,
            instances=[Instance(i) for i in range(len(meshes))],
            spheres=list(spheres),
            materials=material if isinstance(material, list) else [material],
            textures=textures,
            images=list(images),
        )
    )


@subroutine
def _look_up_all(scene, number, uv, uv1, found):
    for i in range(len(uv)):
        r, g, b, a = sample_texture(scene, number, (uv[i, 0], uv[i, 1]), (uv1[i, 0], uv1[i, 1]), None)
        found[i, 0], found[i, 1], found[i, 2], found[i, 3] = r, g, b, a


@entry
def _look_up(scene, number, uv, uv1, found):
    _look_up_all(by_reference(scene), number, uv, uv1, found)


def looked_up(scene, slot=0, count=2000):
    """Returns (uv, uv1, RGBA) of a texture at `count` random coordinates."""
    uv, uv1 = np.random.default_rng(3).uniform(-2, 3, (2, count, 2)).astype(np.float32)
    found = np.empty((count, 4), np.float32)
    _look_up(Packed(scene), scene.material_texture[0, slot], uv, uv1, found)
    return uv.astype(float), uv1.astype(float), found


def expected_of(texture, images, uv, uv1):
    """Returns a texture's RGBA without its layers, (n, 4) float64."""
    image = images[texture.image]
    pixels = image.pixels / (np.iinfo(image.pixels.dtype).max if image.pixels.dtype != np.float32 else 1)
    if pixels.shape[2] == 3:
        pixels = np.dstack([pixels, np.ones(pixels.shape[:2])])
    if image.srgb and image.pixels.dtype != np.float32:
        rgb = pixels[..., :3]
        pixels = np.concatenate([np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4), pixels[..., 3:]], 2)
    rows = np.array(texture.transform, np.float64).reshape(2, 3)
    place = (uv1 if texture.uv_set else uv) @ rows[:, :2].T + rows[:, 2]
    size = np.array(pixels.shape[1::-1])
    at = place * size - 0.5
    low = np.floor(at).astype(int)
    part = at - low
    found = np.zeros((len(uv), 4))
    for dx in (0, 1):
        for dy in (0, 1):
            x, y = (_wrapped(low[:, k] + d, size[k], w) for k, d, w in ((0, dx, texture.wrap_s), (1, dy, texture.wrap_t)))
            weight = np.where(dx, part[:, 0], 1 - part[:, 0]) * np.where(dy, part[:, 1], 1 - part[:, 1])
            found += weight[:, None] * pixels[y, x]
    return found


def _wrapped(i, size, mode):
    if mode == "clamp":
        return np.clip(i, 0, size - 1)
    if mode == "repeat":
        return i % size
    i = i % (2 * size)
    return np.where(i < size, i, 2 * size - 1 - i)


def expected_stack(textures, number, images, uv, uv1, most=1.0):
    lowest = textures[number]
    found = expected_of(lowest, images, uv, uv1)
    for layer in lowest.layers:
        color = expected_of(textures[layer.texture], images, uv, uv1)
        mixed = found[:, :3] + layer.strength * color[:, 3:] * (BLENDS[layer.blend](found[:, :3], color[:, :3]) - found[:, :3])
        found[:, :3] = np.clip(mixed, 0, most)
    return found


WIDE = RANDOM.integers(0, 65536, (5, 4, 4)).astype(np.uint16)
FLOATS = (RANDOM.random((5, 4, 4)) ** 6).astype(np.float32)


@pytest.mark.parametrize(
    ("image", "relative", "absolute"),
    [
        (Image("data", WIDE, srgb=False), 0, 1e-5),
        (Image("colours", WIDE), 6e-4, 1e-6),
        (Image("floats", FLOATS), 6e-4, 1e-6),
        (Image("floats without alpha", FLOATS[..., :3]), 6e-4, 1e-6),
        (Image("float data", FLOATS, srgb=False), 0, 1e-5),
    ],
    ids=lambda value: value.name if isinstance(value, Image) else None,
)
def test_images_of_more_than_eight_bits_keep_their_precision(image, relative, absolute):
    """Images of 16 bits keep half a code's precision, half floats half a unit in the last place, at float32 coordinates."""
    images = [IMAGES[0], image]  # the preceding 8-bit image is still addressed correctly
    textures = [Texture(0), Texture(1, "repeat", "mirror", transform=MOVED)]
    materials = [Material(base_color_texture=1, metallic_roughness_texture=0)]
    scene = compiled(textures, materials, images)
    uv, uv1, found = looked_up(scene)
    np.testing.assert_allclose(found, expected_of(textures[1], images, uv, uv1), rtol=relative, atol=absolute + 2e-5)
    _, _, found = looked_up(scene, METALLIC_ROUGHNESS_TEXTURE)
    np.testing.assert_allclose(found, expected_of(textures[0], images, uv, uv1), atol=2e-5)


def test_emission_keeps_a_range_of_ten_million():
    levels = np.array([500.0, 0.02, 5e-5, 31.25], np.float32)
    image = Image("levels", np.repeat(levels[None, :, None], 3, axis=2))
    material = Material(emission=(1, 1, 1), emission_texture=0)
    scene = compiled([Texture(0, filter="nearest")], material, [image])
    uv, _, found = looked_up(scene, EMISSION_TEXTURE)
    shown = found[:, 0] * scene.material[0, EMISSION]
    expected = levels[np.floor(uv[:, 0] * 4).astype(int) % 4]
    np.testing.assert_allclose(shown, expected, rtol=1e-3)


@pytest.mark.parametrize(("wrap_s", "wrap_t"), [("repeat", "mirror"), ("mirror", "clamp"), ("clamp", "repeat")])
def test_lookup_interpolates_linear_light(wrap_s, wrap_t):
    textures = [Texture(0, wrap_s, wrap_t, transform=MOVED)]
    uv, uv1, found = looked_up(compiled(textures, Material(base_color_texture=0)))
    np.testing.assert_allclose(
        found, expected_of(textures[0], IMAGES, uv, uv1), atol=2e-5
    )  # error of float32 UVs up to 10 texels away


@grid("strength", [0.0, 0.35, 1.0])
@pytest.mark.parametrize("blend", OPERATIONS)
def test_layer_blending_by_alpha_and_strength(blend, strength):
    textures = [Texture(0, layers=(TextureLayer(1, blend, strength),)), Texture(1, "mirror", "mirror")]
    uv, uv1, found = looked_up(compiled(textures, Material(base_color_texture=0)))
    expected = expected_stack(textures, 0, IMAGES, uv, uv1)
    # A divisor of 1 / 255 multiplies the rounding error by 255.
    np.testing.assert_allclose(found, expected, atol=3e-3 if blend == "divide" else 2e-5)
    if strength == 0:
        plain = looked_up(compiled([Texture(0)], Material(base_color_texture=0)))
        np.testing.assert_array_equal(found, plain[2])


def test_layers_have_their_own_mapping_and_encoding():
    """Each texture layer has its own image, coordinates, transform, wrap mode and encoding; one layer uses the second UVs."""
    layers = TextureLayer(1, "multiply", 0.8), TextureLayer(2), TextureLayer(3, "screen", 0.5), TextureLayer(1, "signed_add")
    textures = [
        Texture(0, layers=layers),
        Texture(2, "clamp", "clamp", uv_set=1),
        Texture(1, transform=MOVED),
        Texture(0, "mirror", "repeat", uv_set=1, transform=MOVED),
    ]
    mesh = square(uvs1=((0, 1), (1, 1), (1, 0), (0, 0)))
    uv, uv1, found = looked_up(compiled(textures, Material(base_color_texture=0), meshes=[mesh]))
    expected = expected_stack(textures, 0, IMAGES, uv, uv1)
    np.testing.assert_allclose(found, expected, atol=5e-5)
    np.testing.assert_allclose(found[:, 3], expected_of(textures[0], IMAGES, uv, uv1)[:, 3], atol=2e-5)


def test_data_textures_are_blended_without_decoding():
    """Data textures are blended without decoding: roughness 0.5 with a layer of 1 at half strength is 0.75."""
    images = [Image(name, np.full((1, 1, 4), (v, v, v, 255), np.uint8), srgb=False) for name, v in (("half", 128), ("one", 255))]
    textures = [Texture(0, layers=(TextureLayer(1, strength=0.5),)), Texture(1)]
    made = compiled(textures, Material(kind="metallic_roughness", metallic_roughness_texture=0), images)
    np.testing.assert_allclose(looked_up(made, 2)[2][0, :3], (128 / 255 + 1) / 2, atol=SLACK)


def test_emission_layers_may_exceed_one():
    images = [Image(f"{v}", np.full((1, 1, 4), (v, v, v, 255), np.uint8), srgb=False) for v in (204, 153)]
    images.append(Image("bright", np.full((1, 1, 3), 8, np.float32), srgb=False))
    layers = TextureLayer(1, "add"), TextureLayer(2, "add", 0.25)
    textures = [Texture(0, layers=layers), Texture(1), Texture(2)]
    material = Material(emission=(2, 2, 2), emission_texture=0, base_color_texture=0)
    made = compiled(textures, material, images)
    np.testing.assert_allclose(looked_up(made, 1)[2][0, :3], 0.8 + 0.6 + 0.25 * 8, rtol=1e-5)
    np.testing.assert_array_equal(looked_up(made, 0)[2][0, :3], 1)  # a reflectance is limited to 1
    sums = render_frame(made, settings((0, 0, 2), (0, 0, 0), 30, max_depth=1), 4)
    np.testing.assert_allclose(mean(sums, 24), 2 * 3.4, rtol=1e-5)


@pytest.mark.long
def test_rendered_albedo_equals_the_layered_texture():
    """In a picture of a wall, the albedo of each pixel equals the layered texture at the point that the pixel sees."""
    layers = (TextureLayer(1), TextureLayer(2, "multiply", 0.5))
    textures = [Texture(0, layers=layers), Texture(1, transform=MOVED), Texture(2)]
    made = compiled(textures, Material(base_color=(1, 1, 1), base_color_texture=0))
    size, samples = 24, 1024
    fov = float(np.degrees(2 * np.arctan(1 / 4)))  # the square fills the view
    seen = mean(render_frame(made, settings((0, 0, 4), (0, 0, 0), fov, size, max_depth=1), samples), 24, ALBEDO)
    fine = 32
    v, u = (np.mgrid[0 : size * fine, 0 : size * fine].reshape(2, -1) + 0.5) / (size * fine)
    uv = np.stack([u, v], 1)
    expected = expected_stack(textures, 0, IMAGES, uv, uv)[:, :3].reshape(size, fine, size, fine, 3).mean((1, 3))
    # A pixel's 1024 Sobol' points and a grid of 1024 points differ far less than independent samples would.
    np.testing.assert_allclose(seen, expected, atol=2e-3)


@grid("sampling", ["mis", "light", "bsdf"], ordinary=("mis",))
@grid("kind", ["square", "square with others", "sphere"], ordinary=("square with others",))
@pytest.mark.parametrize("uv_set", [0, 1])
def test_layered_emission_lights_like_brute_force(kind, sampling, uv_set):
    """A lamp whose emission is only a texture layer with a hole lights a floor as computed by a sum over the emitter's points.

    An emitter without second texture coordinates uses its first ones, whether or not other meshes have second ones.
    """
    spot = np.zeros((8, 8, 4), np.uint8)
    spot[1:4, 2:5] = (255, 255, 255, 255)
    images = [Image("dark", np.full((1, 1, 4), (0, 0, 0, 255), np.uint8)), Image("spot", spot)]
    textures = [Texture(0, layers=(TextureLayer(1, "add"),)), Texture(1, "clamp", "clamp", uv_set=uv_set)]
    lamp = Material(base_color=(0, 0, 0), emission=(9, 9, 9), emission_texture=0, double_sided=True)
    corners = np.array([(-9, -2, 9), (9, -2, 9), (9, -2, -9), (-9, -2, -9)], np.float32)
    floor = Mesh("floor", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), material=1)
    meshes = [floor] if kind == "sphere" else [floor, square()]
    if kind == "square with others":
        meshes.append(square(uvs1=((0, 0), (0, 0), (0, 0), (0, 0)), material=1, z=-50.0))
    spheres = [Sphere((0, 0, 0), 1.0)] if kind == "sphere" else []
    made = compiled(textures, [lamp, Material(base_color=(1, 1, 1))], images, meshes, spheres)
    assert len(made.light_primitive) == (1 if kind == "sphere" else 2)
    eye, point = np.array((0.0, -1.9, 1.5)), np.array((0.3, -2.0, 1.5))
    sums = render_frame(made, settings(tuple(eye), tuple(point), 0.01, 8, max_depth=2, sampling=sampling), 4096)
    assert_mean(sums, _irradiance(kind, textures, images, point) / np.pi, slack=2e-3, most_error=0.03, tests=18)


def _irradiance(kind, textures, images, point):
    """Returns the irradiance on a floor facing up, summed over midpoints of the emitter's UVs in float64."""
    n = 256
    u, v = (np.mgrid[0:n, 0:n].reshape(2, -1) + 0.5) / n
    radiance = 9 * expected_stack(textures, 0, images, np.stack([u, v], 1), np.stack([u, v], 1), most=np.inf)[:, 0]
    if kind != "sphere":
        place = np.stack([2 * u - 1, 1 - 2 * v, 0 * u], 1)
        normal, area = np.array((0.0, 0.0, 1.0)), 4 / n**2
    else:
        turn, polar = 2 * np.pi * (u - 0.5), np.pi * v
        place = np.stack([np.sin(polar) * np.sin(turn), np.cos(polar), -np.sin(polar) * np.cos(turn)], 1)
        normal, area = place, np.sin(polar) * 2 * np.pi**2 / n**2
    way = place - point
    square_distance = (way**2).sum(1)
    way /= np.sqrt(square_distance)[:, None]
    cosine = -(way * normal).sum(1)
    cosine = np.abs(cosine) if kind != "sphere" else np.maximum(cosine, 0)
    return float((radiance * cosine * np.maximum(way[:, 1], 0) / square_distance * area).sum())


def test_lamp_power_is_the_mean_of_all_layers():
    """The power of a lamp is the mean over its whole layered texture, also if another texture's texels precede it in memory."""
    textures = [Texture(1), Texture(0, layers=(TextureLayer(0, "add", 0.5),))]
    materials = [Material(emission=(1, 1, 1), emission_texture=t) for t in (0, 1)]
    emitted = pack(SceneDescription(materials=materials, textures=textures, images=IMAGES)).emitted
    n = 512
    v, u = (np.mgrid[0:n, 0:n].reshape(2, -1) + 0.5) / n
    uv = np.stack([u, v], 1)
    mean = expected_stack(textures, 1, IMAGES, uv, uv, most=np.inf)[:, :3].mean(0)
    np.testing.assert_allclose(emitted[1], mean @ (0.2126, 0.7152, 0.0722), rtol=1e-3)  # error of 131,072 points


CHECKER = np.array([[[255, 0, 0, 255], [0, 255, 0, 51]], [[0, 0, 255, 255], [255, 255, 255, 0]]], np.uint8)


@pytest.mark.parametrize(("wrap", "columns"), [("repeat", (0, 1, 0, 1)), ("mirror", (0, 1, 1, 0)), ("clamp", (0, 1, 1, 1))])
def test_nearest_filter_is_constant_per_texel(wrap, columns):
    """The nearest texel is constant up to its border, also beyond the image's right edge, where the texture repeats."""
    textures = [Texture(0, wrap, "clamp", filter="nearest"), Texture(0, wrap, "clamp")]
    scene = compiled(textures, [Material(base_color_texture=i) for i in range(2)], [Image("checker", CHECKER)])
    inside = np.linspace(0, 0.5, 12, endpoint=False, dtype=np.float32)
    for k, column in enumerate(columns):
        for row in (0, 1):
            uv = np.stack(np.meshgrid(k / 2 + inside, row / 2 + inside), -1).reshape(-1, 2).astype(np.float32)
            found = np.empty((len(uv), 4), np.float32)
            _look_up(Packed(scene), np.int32(0), uv, uv, found)
            assert np.array_equal(found, np.broadcast_to((CHECKER[row, column] / 255).astype(np.float32), found.shape))
    mixed = np.empty((1, 4), np.float32)
    _look_up(Packed(scene), np.int32(1), np.full((1, 2), 0.5, np.float32), np.zeros((1, 2), np.float32), mixed)
    np.testing.assert_allclose(
        mixed[0], (CHECKER / 255).mean((0, 1)), atol=1e-6
    )  # the other texture still interpolates all four texels


def test_nearest_texels_render_as_squares():
    """Seen frontally, each quarter of the picture has one colour, from its first pixel to its last."""
    scene = compiled([Texture(0, "clamp", "clamp", filter="nearest")], Material(base_color_texture=0), [Image("c", CHECKER)])
    size = 16
    seen = settings((0, 0, 4), (0, 0, 0), float(np.degrees(2 * np.arctan(1 / 4))), size, max_depth=1)
    albedo = mean(render_frame(scene, seen, 4), seen.film_exponent, ALBEDO)
    expected = 0.8 * np.kron(CHECKER[..., :3] / 255, np.ones((size // 2, size // 2, 1)))
    np.testing.assert_allclose(albedo, expected, atol=1e-6)


@pytest.mark.parametrize("slot", [p.name for p in PARAMETERS if p.form == "texture" and not p.layered])
def test_layers_on_unsupported_slots_are_an_error(slot):
    textures = [Texture(0, layers=(TextureLayer(1),)), Texture(1)]
    with pytest.raises(SceneError, match=f"Material tiles: its {slot} has layers, .* give it one texture"):
        compiled(textures, Material("tiles", "metallic_roughness", **{slot: 0}))
