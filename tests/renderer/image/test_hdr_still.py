"""Tests of high dynamic range stills: values of the PQ signal, and files read back by decoders of other libraries."""

from __future__ import annotations

import io
from pathlib import Path

import av
import numpy as np
import OpenImageIO as oiio  # noqa: N813 -- the name its own documentation uses
import pytest
from PIL import Image

from renderer.errors import SettingsError
from renderer.image import encode
from renderer.image.hdr_still import pq_of_nits, pq_picture
from renderer.image.ocio import curve_of

ACES_PQ = "ocio:Rec.2100-PQ - Display/ACES 2.0 - HDR 1000 nits (Rec.2020)"


def smooth_picture(height: int = 97, width: int = 131) -> np.ndarray:
    """Returns scene-linear Rec.709 from 0 to 8, smooth, of odd size."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    return np.stack([8 * (x / width) ** 3, y / height, 0.5 + 0 * x], axis=-1).astype(np.float32)


@pytest.mark.parametrize(("nits", "signal"), [(0, 0), (100, 0.5081), (203, 0.5807), (1000, 0.7518), (10_000, 1)])
def test_pq_signal_is_that_of_the_standard(nits: float, signal: float) -> None:
    """Values of ITU-R BT.2408, annex 1."""
    assert pq_of_nits(np.array([nits], np.float32)) == pytest.approx(signal, abs=1e-4)


def test_white_is_the_reference_white_and_highlights_approach_the_peak() -> None:
    greys = np.repeat(np.array([0.18, 1, 2, 8, 1e6], np.float32)[:, None], 3, axis=1)[None]
    shown = pq_picture(greys)[0, :, 1]
    assert shown[:2] == pytest.approx(pq_of_nits(np.array([36.54, 203], np.float32)), abs=1e-4)
    assert (np.diff(shown) > 0).all() and shown[-1] == pytest.approx(0.7518, abs=1e-3)
    assert pq_picture(greys / 4, 2.0) == pytest.approx(pq_picture(greys), abs=1e-6)


def decoded_avif(data: bytes) -> tuple[np.ndarray, tuple[int, int, int, int]]:
    """Returns the signal of an AVIF, and its codes of primaries, transfer, matrix and range."""
    with av.open(io.BytesIO(data)) as file:
        frame = next(file.decode(video=0))
        codes = frame.color_primaries, frame.color_trc, frame.colorspace, frame.color_range
        planes = [
            np.frombuffer(plane, "<u2").reshape(plane.height, plane.line_size // 2)[:, : plane.width] for plane in frame.planes
        ]
    luma, blues, reds = (plane / 1023 for plane in planes)
    blues, reds = (np.kron(c - 512 / 1023, np.ones((2, 2)))[: luma.shape[0], : luma.shape[1]] for c in (blues, reds))
    red, blue = luma + 2 * (1 - 0.2627) * reds, luma + 2 * (1 - 0.0593) * blues
    green = (luma - 0.2627 * red - 0.0593 * blue) / 0.6780
    return np.stack([red, green, blue], axis=-1), (codes[0], codes[1], codes[2], codes[3])


def test_avif_has_the_signal_and_says_so() -> None:
    picture = smooth_picture()
    data = encode.encode(picture, "avif")
    signal, codes = decoded_avif(data)
    assert codes == (9, 16, 9, 2)
    assert np.abs(signal - pq_picture(picture)).mean() < 4 / 1023
    with Image.open(io.BytesIO(data)) as opened:  # libavif
        assert opened.size == (131, 97)
    with pytest.raises(SettingsError, match="64 x 64 pixels; the picture has 131 x 63"):
        encode.encode(picture[:63], "avif")


def test_jpeg_xl_has_the_signal_and_says_so(tmp_path: Path) -> None:
    picture = smooth_picture()
    (tmp_path / "a.jxl").write_bytes(encode.encode(picture, "jxl", 1.0))
    file = oiio.ImageInput.open(str(tmp_path / "a.jxl"))
    assert file.spec().getattribute("CICP") == (9, 16, 0, 1)
    assert np.abs(file.read_image(oiio.FLOAT) - pq_picture(picture, 1.0)).mean() < 3 / 1023


def test_view_must_be_for_pq() -> None:
    grey = np.full((64, 64, 3), 0.18, np.float32)
    assert pq_picture(grey, 0.0, curve_of(ACES_PQ, "cg"))[0, 0] == pytest.approx(pq_of_nits(np.float32(15)), abs=0.02)
    with pytest.raises(SettingsError, match="of a Rec"):
        encode.encode(grey, "avif", 0.0, curve_of("ocio", "cg"))
