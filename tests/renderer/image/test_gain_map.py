"""Tests of JPEG files with a gain map, read back from the file: the ordinary picture, the index, the bright rendition."""

from __future__ import annotations

import io
import re

import numpy as np
import pytest
from PIL import Image
from PIL.JpegImagePlugin import JpegImageFile

from renderer.errors import SettingsError
from renderer.image import tonemap
from renderer.image.encode import encode, encode_shown
from renderer.image.ocio import curve_of
from renderer.luminance import REC_709

PQ_VIEW = "ocio:Rec.2100-PQ - Display/ACES 2.0 - HDR 1000 nits (Rec.2020)"
XMP = re.compile(rb"http://ns.adobe.com/xap/1.0/\x00(<.*?</x:xmpmeta>)", re.DOTALL)


def picture() -> np.ndarray:
    """Returns a grey ramp over eight stops, up to 8, with a dark coloured band; smooth, since the gain map is a JPEG."""
    ramp = np.exp2(np.linspace(-5, 3, 256, dtype=np.float32))
    rgb = np.repeat(np.repeat(ramp[None, :, None], 64, axis=0), 3, axis=2)
    rgb[40:] *= np.array([0.5, 0.3, 0.1], np.float32)
    return rgb


def parts_of(data: bytes) -> tuple[Image.Image, Image.Image, bytes, bytes]:
    """Returns both pictures of a file by the index that Pillow reads, and their XMP packets."""
    with Image.open(io.BytesIO(data)) as file:
        assert isinstance(file, JpegImageFile)
        index = file._getmp()
        assert index is not None
        first = file.convert("RGB")
        one, two = index[0xB002]
        at = two["DataOffset"] + file.info["mpoffset"]
    assert (one["DataOffset"], one["Size"], at + two["Size"]) == (0, at, len(data))
    second = Image.open(io.BytesIO(data[at:]))
    packets = XMP.findall(data)
    assert len(packets) == 2
    return first, second, packets[0], packets[1]


@pytest.mark.parametrize("curve", ["neutral", "agx"])
def test_picture_is_that_without_a_map_and_the_map_restores_highlights(curve: str) -> None:
    rgb = picture()
    data = encode(rgb, "jpg", 0.0, curve, gain_map=True)
    first, second, directory, parameters = parts_of(data)
    with Image.open(io.BytesIO(encode_shown(tonemap.apply(rgb, 0.0, curve), "jpg"))) as plain:
        np.testing.assert_array_equal(np.asarray(first), np.asarray(plain.convert("RGB")))
    length = re.search(rb'Item:Length="(\d+)"', directory)
    assert length and data[-int(length[1]) :][:2] == b"\xff\xd8"
    most = re.search(rb'GainMapMax="([\d.]+)"', parameters)
    assert most and second.mode == "L"
    base = tonemap.decode_srgb(np.asarray(first).astype(np.float64) / 255) @ REC_709
    stops = np.asarray(second).astype(np.float64) / 255 * float(most[1])
    bright = (base + 1 / 64) * np.exp2(stops) - 1 / 64
    grey = float(tonemap.decode_srgb(tonemap.apply(np.full((1, 1, 3), 0.18, np.float32), 0, curve) / 255)[0, 0, 0])
    linear = picture()[20, :, 0] * grey / 0.18
    above = linear > 1.2
    wanted = 1 + 3.926 * (1 - np.exp((1 - linear[above]) / 3.926))  # up to 1000 / 203
    np.testing.assert_allclose(bright[20][above], wanted, rtol=0.06)
    assert (bright >= base - 0.01).all()
    assert stops[20][linear < grey] == pytest.approx(0, abs=0.05)


def test_dark_picture_has_an_empty_map() -> None:
    _, second, _, parameters = parts_of(encode(np.full((16, 16, 3), 0.02, np.float32), "jpg", gain_map=True))
    assert b'GainMapMax="0.010000"' in parameters
    assert np.asarray(second).max() == 0


def test_unknown_curve_and_view_of_pq_display_are_refused() -> None:
    with pytest.raises(SettingsError, match="tone curve is 'x'"):
        encode(picture(), "jpg", 0.0, "x", gain_map=True)
    with pytest.raises(SettingsError, match="pictures of standard range"):
        encode(picture(), "jpg", 0.0, curve_of(PQ_VIEW, "cg"), gain_map=True)
