"""Tests of image files as various programs write them.

They differ in straight alpha, layers, data windows, orientations, wrong suffixes and bit depths.
"""

import io
import struct

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from PIL import Image

from renderer.errors import SceneError
from renderer.image import read

COLOR = (240, 160, 80)


def written(folder, suffix, pixels, names=None, setup=lambda spec: None, straight=False):
    """Returns the bytes of an image file written by OpenImageIO. straight: whether alpha is not premultiplied."""
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, {"u1": oiio.UINT8, "u2": oiio.UINT16, "f4": oiio.FLOAT}[pixels.dtype.str[1:]])
    if names:
        spec.channelnames = names
        spec.alpha_channel = names.index("A") if "A" in names else -1
    if straight:
        spec.attribute("oiio:UnassociatedAlpha", 1)
    setup(spec)
    path = folder / f"image{suffix}"
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec), out.geterror()
    assert out.write_image(pixels), out.geterror()
    out.close()
    return path.read_bytes()


@pytest.mark.parametrize("suffix", [".tif", ".sgi", ".png", ".webp", ".tga"])
@pytest.mark.parametrize("alpha", [128, 0])
def test_straight_alpha_leaves_colours_as_they_are(tmp_path, suffix, alpha):
    pixels = np.full((32, 32, 4), (*COLOR, alpha), np.uint8)
    lossless = {".webp": lambda spec: spec.attribute("compression", "lossless")}
    data = written(tmp_path, suffix, pixels, setup=lossless.get(suffix, lambda spec: None), straight=True)
    found = read.read(data, f"image{suffix}")
    if suffix == ".webp" and alpha == 0:
        return  # the encoder drops the colour of transparent pixels
    np.testing.assert_array_equal(found, pixels)


def test_jpeg_2000_has_straight_alpha():
    out = io.BytesIO()
    Image.new("RGBA", (64, 64), (*COLOR, 128)).save(out, "JPEG2000")
    np.testing.assert_array_equal(read.read(out.getvalue(), "image.jp2")[0, 0], (*COLOR, 128))


def test_premultiplied_alpha_is_divided_out(tmp_path):
    pixels = np.full((8, 8, 4), (120, 80, 40, 128), np.uint8)
    found = read.read(written(tmp_path, ".tif", pixels), "image.tif")
    assert np.abs(found[0, 0].astype(int) - (239, 159, 80, 128)).max() <= 1
    floats = np.full((8, 8, 4), (0.25, 0.5, 0.125, 0.5), np.float32)
    floats[0, 0] = 0.3, 0.2, 0.1, 0.0  # a colour with alpha 0: light without coverage
    data = written(tmp_path, ".exr", floats)
    found = read.read(data, "image.exr")
    np.testing.assert_allclose(found[1, 1], (0.5, 1.0, 0.25, 0.5))
    np.testing.assert_allclose(found[0, 0], (0.3, 0.2, 0.1, 0.0))
    radiance = read.decode(data, "image.exr", is_environment=True).pixels
    np.testing.assert_allclose(radiance[1, 1], (0.25, 0.5, 0.125))


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["R", "G"], (1, 2, 0)),
        (["B"], (0, 0, 1)),
        (["Z", "env.R", "env.G", "env.B"], (2, 3, 4)),
        (["Y"], (1, 1, 1)),
        (["ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B", "ViewLayer.Depth.Z"], (1, 2, 3)),
        (["A.Normal.X", "A.Normal.Y", "A.Normal.Z", "B.Combined.R", "B.Combined.G", "B.Combined.B"], (4, 5, 6)),
        (["diffuse.red", "diffuse.green", "diffuse.blue"], (1, 2, 3)),
        (["crypto00.r", "crypto00.g", "crypto00.b", "Image.R", "Image.G", "Image.B"], (4, 5, 6)),
        (["B", "G", "R"], (3, 2, 1)),
        (["N.X", "N.Y", "N.Z"], (1, 2, 3)),
        (["height"], (1, 1, 1)),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, list) else None,
)
def test_channels_are_chosen_by_the_last_part_of_their_names(tmp_path, names, expected):
    values = np.arange(1, len(names) + 1, dtype=np.float32)
    data = written(tmp_path, ".exr", np.tile(values, (4, 4, 1)), names)
    np.testing.assert_array_equal(read.read(data, "image.exr")[2, 2], expected)


def test_channels_without_a_known_name_are_listed(tmp_path):
    data = written(tmp_path, ".exr", np.ones((4, 4, 2), np.float32), ["left", "right"])
    with pytest.raises(SceneError, match=r"\(left, right\) is named R, G, B or Y"):
        read.read(data, "image.exr")


def test_warning_names_the_selected_layer(tmp_path):
    names = [f"{layer}.{channel}" for layer in ("first", "second") for channel in "RGB"]
    found = read.decode(written(tmp_path, ".exr", np.ones((4, 4, 6), np.float32), names), "image.exr")
    assert found.notes == [
        'image.exr: has several layers; "first" is shown, not "second". Name one of them Combined, or remove the others'
    ]


def test_part_with_the_picture_is_read(tmp_path):
    path = tmp_path / "parts.exr"
    specs = []
    for name, channels in (("ViewLayer.Depth", ["Z"]), ("ViewLayer.Combined", ["R", "G", "B"])):
        spec = oiio.ImageSpec(4, 4, len(channels), oiio.FLOAT)
        spec.channelnames = channels
        spec.attribute("oiio:subimagename", name)
        specs.append(spec)
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), specs)
    out.write_image(np.full((4, 4, 1), 9, np.float32))
    out.open(str(path), specs[1], "AppendSubimage")
    out.write_image(np.full((4, 4, 3), (1, 2, 3), np.float32))
    out.close()
    np.testing.assert_array_equal(read.read(path.read_bytes(), "parts.exr")[0, 0], (1, 2, 3))


@pytest.mark.parametrize("window", [(2, 1, 4, 3), (-2, -1, 12, 8), (-1, 2, 4, 6), (20, 20, 2, 2)])
@pytest.mark.parametrize("origin", [(0, 0), (-5, 3)])
def test_data_window_is_placed_in_the_display_window(tmp_path, window, origin):
    x, y, width, height = window
    full = np.zeros((6, 8, 3), np.float32)
    data = np.random.default_rng(1).random((height, width, 3), np.float32)
    for j in range(6):
        for i in range(8):
            if 0 <= j - y < height and 0 <= i - x < width:
                full[j, i] = data[j - y, i - x]

    def place(spec):
        spec.x, spec.y = x + origin[0], y + origin[1]
        spec.full_x, spec.full_y, spec.full_width, spec.full_height = *origin, 8, 6

    np.testing.assert_array_equal(read.read(written(tmp_path, ".exr", data, setup=place), "image.exr"), full)


ROWS = np.random.default_rng(3).integers(128, 256, (2, 3, 3))


@pytest.mark.parametrize(
    ("size", "rows"),
    [
        ("-Y 2 +X 3", ROWS),
        ("-Y 2 -X 3", ROWS[:, ::-1]),
        ("+Y 2 +X 3", ROWS[::-1]),
        ("+Y 2 -X 3", ROWS[::-1, ::-1]),
        ("+X 3 -Y 2", ROWS.swapaxes(0, 1)),
        ("-X 3 -Y 2", ROWS[:, ::-1].swapaxes(0, 1)),
        ("+X 3 +Y 2", ROWS[::-1].swapaxes(0, 1)),
        ("-X 3 +Y 2", ROWS[::-1, ::-1].swapaxes(0, 1)),
    ],
)
def test_radiance_orientation_is_normalized(size, rows):
    texels = b"".join(bytes([*texel, 128 + 8]) for row in rows.tolist() for texel in row)
    found = read.read(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n" + size.encode() + b"\n" + texels, "turned.hdr")
    assert found.shape == (2, 3, 3)
    np.testing.assert_allclose(found, ROWS, atol=1)


def targa(bits, descriptor, texel, kind=2, extension=None):
    data = struct.pack("<BBBHHBHHHHBB", 0, 0, kind, 0, 0, 0, 0, 0, 4, 4, bits, descriptor) + bytes(texel) * 16
    if extension is not None:
        area = bytearray(495)
        area[:2], area[494] = struct.pack("<H", 495), extension
        data += bytes(area) + struct.pack("<II", len(data), 0) + b"TRUEVISION-XFILE.\0"
    return data


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (targa(32, 0x20, (80, 160, 240, 0)), (*COLOR, 255)),
        (targa(32, 0x28, (80, 160, 240, 128)), (*COLOR, 128)),
        (targa(32, 0x28, (80, 160, 240, 128), extension=3), (*COLOR, 128)),
        (targa(32, 0x28, (80, 160, 240, 9), extension=1), (*COLOR, 255)),
        (targa(32, 0x28, (40, 80, 120, 128), extension=4), (239, 159, 80, 128)),
    ],
    ids=["no-alpha-bits", "alpha", "useful", "ignored", "premultiplied"],
)
def test_tga_header_determines_the_alpha_mode(data, expected):
    found = read.read(data, "image.tga").astype(int)
    assert np.abs(found - expected).max() <= 1


def pillow(kind, mode="RGB"):
    out = io.BytesIO()
    Image.new(mode, (8, 8), COLOR).save(out, kind)
    return out.getvalue()


@pytest.mark.parametrize("name", ["image.png", "image.jpg", "image.exr", "image", "image.txt"])
@pytest.mark.parametrize("kind", ["TGA", "JPEG", "PPM", "SGI", "WEBP", "DDS", "JPEG2000", "TIFF", "AVIF"])
def test_image_is_read_despite_wrong_suffix(name, kind):
    found = read.read(pillow(kind), name)
    assert np.abs(found[4, 4].astype(int) - (*COLOR, 255)).max() <= 6


@pytest.mark.parametrize("name", ["image.png", "image.tga", "image.dds"])
@pytest.mark.parametrize(
    "data", [b"", b"\x89PNG\r\n\x1a\n" + bytes(40), b"GIF89a", b"DDS " + bytes(10), b"RIFF\0\0\0\0WEBP", bytes(99)]
)
def test_error_messages_contain_no_addresses(name, data):
    with pytest.raises(SceneError) as told:
        read.read(data, name)
    assert "0x" not in str(told.value)
    assert "_io" not in str(told.value)


def dds(fourcc, block, dxgi=None):
    """Returns a DDS file of 4 x 4 pixels in one block."""
    header = struct.pack("<4s7I44x", b"DDS ", 124, 0x81007, 4, 4, len(block), 0, 0)
    header += struct.pack("<II4s5I", 32, 4, fourcc, 0, 0, 0, 0, 0) + struct.pack("<5I", 0x1000, 0, 0, 0, 0)
    if dxgi is not None:
        header += struct.pack("<5I", dxgi, 3, 0, 1, 0)
    return header + block


def one(code):
    return bytes([code, code]) + bytes(6)


@pytest.mark.parametrize(("fourcc", "dxgi"), [(b"ATI2", None), (b"BC5U", None), (b"DX10", 83)])
def test_blocks_of_two_channels_are_normals(fourcc, dxgi):
    found = read.read(dds(fourcc, one(128) + one(200), dxgi), "normals.dds")[0, 0].astype(float)
    x, y = 2 * found[:2] / 255 - 1
    assert tuple(found[:2]) == (128, 200)
    assert found[2] == round(255 * (0.5 + 0.5 * (1 - x * x - y * y) ** 0.5))
    assert found[3] == 255


@pytest.mark.parametrize(("fourcc", "dxgi"), [(b"ATI1", None), (b"BC4U", None), (b"DX10", 80)])
def test_blocks_of_one_channel_are_grey(fourcc, dxgi):
    assert read.read(dds(fourcc, one(77), dxgi), "grey.dds")[0, 0].tolist() == [77, 77, 77, 255]


@pytest.mark.parametrize("suffix", [".png", ".tif", ".sgi", ".ppm"])
def test_sixteen_bits_are_kept(tmp_path, suffix):
    pixels = np.random.default_rng(5).integers(0, 65536, (9, 7, 3)).astype(np.uint16)
    found = read.read(written(tmp_path, suffix, pixels), "image.png")
    assert found.dtype == np.uint16
    np.testing.assert_array_equal(found[..., :3], pixels)
    assert (found[..., 3] == 65535).all()


def test_redundant_16_bits_are_reduced_to_8(tmp_path):
    pixels = np.random.default_rng(5).integers(0, 256, (9, 7, 3)).astype(np.uint16)
    found = read.read(written(tmp_path, ".png", pixels * 257), "image.png")
    assert found.dtype == np.uint8
    np.testing.assert_array_equal(found[..., :3], pixels)


@pytest.mark.parametrize("suffix", [".exr", ".hdr", ".png"])
@pytest.mark.parametrize("tiled", [False, True])
def test_large_environment_is_scaled_down_with_a_warning(tmp_path, monkeypatch, suffix, tiled):
    monkeypatch.setattr(read, "MAX_PIXELS", 512)
    pixels = np.random.default_rng(2).random((32, 64, 3), np.float32)
    if suffix == ".png":
        pixels = np.rint(pixels * 65535).astype(np.uint16)

    def tiles(spec):
        if tiled and suffix == ".exr":
            spec.tile_width = spec.tile_height = 16

    data = written(tmp_path, suffix, pixels, setup=tiles)
    found = read.decode(data, f"sky{suffix}", is_environment=True)
    expected = pixels.reshape(16, 2, 32, 2, 3).mean(axis=(1, 3))
    assert found.pixels.shape[:2] == (16, 32)
    np.testing.assert_allclose(found.pixels[..., :3], expected, rtol=1e-2 if suffix == ".hdr" else 1e-4, atol=2e-2)
    assert "64 x 32 pixels are reduced to 32 x 16" in found.notes[0]
    with pytest.raises(SceneError, match="at most"):
        read.read(data, "texture")
