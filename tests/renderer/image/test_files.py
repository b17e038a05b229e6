"""Tests of writing and reading images, and of damaged image files."""

import io

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from renderer.errors import SceneError, SettingsError
from renderer.image import encode, read, tonemap

RGB = np.random.default_rng(7).random((9, 14, 3), np.float32) * 4


def png(pixels, **options):
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "PNG", **options)
    return out.getvalue()


def test_exr_is_scene_linear_float32_to_the_bit_with_standard_names(tmp_path):
    path = tmp_path / "picture.exr"
    encode.write(path, RGB, exposure=3.0, curve="agx", channels={"Depth.Z": RGB[..., 0], "Normal.X": RGB[..., 1]})
    spec = oiio.ImageInput.open(str(path)).spec()
    assert set(spec.channelnames) == {"R", "G", "B", "Depth.Z", "Normal.X"}
    assert spec.format == oiio.FLOAT
    np.testing.assert_array_equal(read.read(path.read_bytes(), "picture.exr"), RGB)


def test_hdr_keeps_radiance_within_its_eight_bit_mantissa():
    found = read.read(encode.encode(RGB, "hdr"), "picture.hdr")
    assert (np.abs(found - RGB) <= RGB.max(axis=-1, keepdims=True) / 128).all()


def test_png_matches_the_tone_curve():
    found = read.read(encode.encode(RGB, "png", -1.0, "filmic"), "picture.png")
    np.testing.assert_array_equal(found[..., :3], tonemap.apply(RGB, -1.0, "filmic"))
    assert (found[..., 3] == 255).all()


def test_jpg_approximates_the_png():
    smooth = np.dstack([np.tile(np.linspace(0, 1, 64, dtype=np.float32), (48, 1))] * 3)
    found = read.read(encode.encode(smooth, "jpg"), "picture.jpg")[..., :3].astype(int)
    assert np.abs(found - tonemap.apply(smooth)).max() <= 4


def test_failed_write_leaves_no_file(tmp_path):
    with pytest.raises(SettingsError, match=r"\.exr"):
        encode.write(tmp_path / "picture.bmp", RGB)
    with pytest.raises(SettingsError, match="known are"):
        encode.write(tmp_path / "picture.png", RGB, curve="sepia")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("mode", ["L", "LA", "P", "RGB", "RGBA", "1", "I;16"])
def test_every_kind_of_png_becomes_rgba(mode):
    if mode == "I;16":
        data = png(np.full((2, 3), 0x80FF, np.uint16))
    else:
        out = io.BytesIO()
        Image.new("RGB", (3, 2), (128, 128, 128)).convert(mode).save(out, "PNG")
        data = out.getvalue()
    pixels = read.read(data, "grey.png")
    assert pixels.shape == (2, 3, 4)
    assert pixels.dtype == (np.uint16 if mode == "I;16" else np.uint8)
    if mode not in ("1", "P"):  # these modes may dither
        assert np.abs(pixels[..., :3].astype(int) - (0x80FF if mode == "I;16" else 128)).max() <= 1


def test_format_is_detected_from_the_bytes():
    assert read.read(png(np.zeros((2, 2, 3), np.uint8)), "really.jpg").shape == (2, 2, 4)


@pytest.mark.parametrize(
    ("data", "name", "said"),
    [
        (b"", "empty.png", "empty.png"),
        (b"hello", "note.txt", "is not an image of a known format; give one of"),
        (b"%!PS-Adobe-3.0 EPSF-3.0", "drawing.eps", "is not an image of a known format; give one of"),
        (png((RGB * 60).astype(np.uint8))[:-60], "cut.png", "damaged"),
        (b"\x76\x2f\x31\x01" + bytes(40), "broken.exr", "damaged"),
    ],
    ids=["empty", "text", "eps", "cut-png", "broken-exr"],
)
def test_non_image_data_is_an_error_message(data, name, said):
    with pytest.raises(SceneError, match=said):
        read.read(data, name)


def test_a_decompression_bomb_is_refused_before_it_is_decoded(monkeypatch):
    monkeypatch.setattr(read, "MAX_PIXELS", 1000)
    for data, name in (
        (png(np.zeros((40, 40, 3), np.uint8)), "big.png"),
        (encode.encode(np.zeros((40, 40, 3)), "exr"), "big.exr"),
    ):
        with pytest.raises(SceneError, match="40 x 40"):
            read.read(data, name)


def test_image_above_pillows_limit_is_too_large():
    """An image above Pillow's decompression-bomb limit is reported as too large, not as damaged.

    A texture of 16384 x 16384 is a valid file, so advice to export it again would not help.
    """
    header = b"VP8X" + (10).to_bytes(4, "little") + bytes(4) + (16383).to_bytes(3, "little") * 2
    webp = b"RIFF" + (4 + len(header)).to_bytes(4, "little") + b"WEBP" + header
    with pytest.raises(SceneError, match=r"has too many pixels; at most 64 million are allowed. Give a smaller image"):
        read.read(webp, "large.webp")


def test_error_message_names_no_temporary_file():
    with pytest.raises(SceneError) as told:
        read.read(b"\x76\x2f\x31\x01" + bytes(40), "broken.exr")
    assert "/" not in str(told.value)


SAMPLES = [png((RGB * 60).astype(np.uint8)), *(encode.encode(RGB, kind) for kind in ("jpg", "hdr", "exr"))]


@settings(deadline=None)
@given(st.sampled_from(SAMPLES), st.data())
def test_damaged_image_yields_pixels_or_an_error(sample, data):
    damaged = bytearray(sample[: data.draw(st.integers(0, len(sample)))])
    for _ in range(data.draw(st.integers(0, 4))):
        if damaged:
            damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    try:
        pixels = read.read(bytes(damaged), "damaged.png")
    except SceneError as error:
        assert "damaged.png" in str(error)
    else:
        assert pixels.ndim == 3
