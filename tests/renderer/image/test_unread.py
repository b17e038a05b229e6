"""Tests of the warnings about colour information in image files that we do not use; usual files cause none."""

import io

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from PIL import Image, ImageCms, PngImagePlugin

from renderer.image.read import decode

PICTURE = Image.fromarray(np.arange(48, dtype=np.uint8).reshape(4, 4, 3) * 5)


def saved(kind, picture=PICTURE, **more):
    data = io.BytesIO()
    picture.save(data, kind, **more)
    return data.getvalue()


def notes_of(data):
    return decode(data, "a").notes


def gamma_of(value):
    text = PngImagePlugin.PngInfo()
    text.add(b"gAMA", int(value * 100_000).to_bytes(4, "big"))
    return saved("PNG", pnginfo=text)


def profile(space):
    return ImageCms.ImageCmsProfile(ImageCms.createProfile(space)).tobytes()


def turned():
    exif = Image.Exif()
    exif[0x0112] = 6
    return saved("JPEG", exif=exif)


def exr(tmp_path, chromaticities=None, value=1.0):
    spec = oiio.ImageSpec(4, 4, 3, "float")
    if chromaticities:
        spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), chromaticities)
    output = oiio.ImageOutput.create(str(tmp_path / "a.exr"))
    output.open(str(tmp_path / "a.exr"), spec)
    pixels = np.ones((4, 4, 3), np.float32)
    pixels[0, :2] = value
    output.write_image(pixels)
    output.close()
    return (tmp_path / "a.exr").read_bytes()


def hdr(more):
    return b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n" + more + b"\n-Y 4 +X 4\n" + bytes([128, 128, 128, 129]) * 16


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda _: saved("PNG", icc_profile=profile("LAB")), "colour profile"),
        (lambda _: saved("PNG", icc_profile=b"damaged"), "colour profile is damaged"),
        (lambda _: gamma_of(1.0), "its gamma of 1 is ignored; it is read as sRGB, whose gamma is"),
        (lambda _: saved("JPEG", PICTURE.convert("CMYK")), "CMYK is converted"),
        (lambda _: saved("GIF", save_all=True, append_images=[PICTURE.rotate(90)]), "has 2 frames; only the first is shown"),
        (lambda _: turned(), "Exif orientation 6"),
        (lambda path: exr(path, (0.7347, 0.2653, 0, 1, 0.0001, -0.077, 0.32168, 0.33767)), "its primaries (0.7347 0.2653"),
        (lambda path: exr(path, value=np.nan), "2 pixels are not finite; they are black, or as bright as possible"),
        (lambda _: hdr(b"EXPOSURE=2\nEXPOSURE=3\n"), "its values are 6 times the radiance (EXPOSURE)"),
        (lambda _: hdr(b"COLORCORR=1 2 1\n"), "its values are 1 2 1 times the radiance (COLORCORR)"),
        (lambda _: hdr(b"PRIMARIES=0.7 0.29 0.17 0.79 0.13 0.04 0.31 0.32\n"), "its primaries (0.7 0.29"),
    ],
)
def test_unsupported_content_is_named(tmp_path, make, sentence):
    assert any(sentence in note for note in notes_of(make(tmp_path)))


@pytest.mark.parametrize(
    "make",
    [
        lambda _: saved("PNG"),
        lambda _: saved("PNG", icc_profile=profile("sRGB")),
        lambda _: gamma_of(0.45455),
        lambda _: saved("JPEG"),
        lambda path: exr(path, (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)),
        lambda _: hdr(b"EXPOSURE=2\nEXPOSURE=0.5\nPRIMARIES=0.64 0.33 0.3 0.6 0.15 0.06 0.3333 0.3333\n"),
    ],
)
def test_ordinary_files_cause_no_notes(tmp_path, make):
    assert not notes_of(make(tmp_path))
