"""JPEG files with a gain map (Ultra HDR): displays of standard range show the JPEG, others add brighter highlights.

The gain map is a second, grey JPEG in the same file. It contains log2 of the ratio of luminance between the rendition of high
dynamic range and the ordinary one. Sources: Ultra HDR image format 1.1 (developer.android.com); CIPA DC-007, multi-picture
format.
"""

from __future__ import annotations

import io
import struct

import numpy as np
import numpy.typing as npt
from PIL import Image

from renderer.image.hdr_still import highlights_rolled
from renderer.image.tonemap import Curve, apply, check_standard_range, decode_srgb, exposed
from renderer.luminance import REC_709

__all__ = ["OFFSET", "encode_jpeg_with_gain_map", "highlight_stops"]

F32 = npt.NDArray[np.float32]
OFFSET = 1 / 64  # added to both luminances, so that black has a ratio
GREY = 0.18
MIN_STOPS = 0.01  # the range of a map must not be empty
QUALITY, MAP_QUALITY = 95, 90

_XMP = b"http://ns.adobe.com/xap/1.0/\0"
_WRAPPED = (
    '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    '<rdf:Description rdf:about="" xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" hdrgm:Version="1.0"{}'
    "</rdf:RDF></x:xmpmeta>"
)
_DIRECTORY = (
    ' xmlns:Container="http://ns.google.com/photos/1.0/container/" xmlns:Item="http://ns.google.com/photos/1.0/container/item/">'
    '<Container:Directory><rdf:Seq><rdf:li rdf:parseType="Resource"><Container:Item Item:Semantic="Primary" '
    'Item:Mime="image/jpeg"/></rdf:li><rdf:li rdf:parseType="Resource"><Container:Item Item:Semantic="GainMap" '
    'Item:Mime="image/jpeg" Item:Length="{}"/></rdf:li></rdf:Seq></Container:Directory></rdf:Description>'
)
_PARAMETERS = (
    ' hdrgm:GainMapMin="0" hdrgm:GainMapMax="{0:.6f}" hdrgm:Gamma="1" hdrgm:OffsetSDR="{1}" hdrgm:OffsetHDR="{1}" '
    'hdrgm:HDRCapacityMin="0" hdrgm:HDRCapacityMax="{0:.6f}" hdrgm:BaseRenditionIsHDR="False"/>'
)
_MPF_BYTES = 90  # of the segment with the index of both pictures, with its marker


def encode_jpeg_with_gain_map(rgb: F32, exposure: float = 0.0, curve: Curve = "neutral") -> bytes:
    """Returns a JPEG file with a gain map of scene-linear Rec.709 radiance, (h, w, 3).

    exposure: in stops. The ordinary rendition has the tone curve. That of high dynamic range equals it up to middle grey; above
    white it is the radiance, scaled as the curve scales middle grey, up to 1000 nits at a white of 203. Raises SettingsError for
    an unknown curve, and for a view whose display takes PQ.
    """
    check_standard_range(curve)
    shown = apply(rgb, exposure, curve)
    stops = highlight_stops(rgb, shown, exposure, curve)
    most = max(float(stops.max()), MIN_STOPS)
    gains = np.rint(stops / most * 255).astype(np.uint8)
    parameters = _WRAPPED.format(_PARAMETERS.format(most, OFFSET))
    second = _with_segments(_jpeg(gains, MAP_QUALITY), _segment(0xE1, _XMP + parameters.encode()))
    directory = _WRAPPED.format(_DIRECTORY.format(len(second)))
    first, xmp = _jpeg(shown, QUALITY), _segment(0xE1, _XMP + directory.encode())
    length = len(first) + len(xmp) + _MPF_BYTES
    index_at = _end_of_header(first) + len(xmp) + 8  # of the index, from which offsets count: behind marker, length and "MPF\0"
    return _with_segments(first, xmp + _index(length, len(second), length - index_at)) + second


def highlight_stops(rgb: F32, shown: npt.NDArray[np.uint8], exposure: float, curve: Curve) -> npt.NDArray[np.float64]:
    """Returns by how many stops a pixel of the rendition of high dynamic range is brighter, (h, w).

    The rendition's linear colour is (ordinary + OFFSET) * 2 ** stops - OFFSET. shown: the ordinary rendition of `rgb`. The page
    has the same formula in its shader (web/js/film/film-shader.js, highRange).
    """
    base = decode_srgb(shown.astype(np.float32) / 255) @ REC_709
    middle = float(decode_srgb(apply(np.full((1, 1, 3), GREY, np.float32), 0.0, curve)[0, 0, 0] / 255))
    bright = highlights_rolled(exposed(rgb, exposure) * np.float32(middle / GREY)) @ REC_709
    share = np.clip((bright - middle) / (1 - middle), 0, 1)  # from middle grey to white
    stops: npt.NDArray[np.float64] = (
        np.log2((np.maximum(bright, base) + OFFSET) / (base + OFFSET)) * share * share * (3 - 2 * share)
    )
    return stops


def _jpeg(pixels: npt.NDArray[np.uint8], quality: int) -> bytes:
    out = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(out, "JPEG", quality=quality, subsampling=0)
    return out.getvalue()


def _end_of_header(jpeg: bytes) -> int:
    """Returns the position behind the JFIF header, which must be the first segment."""
    return 4 + struct.unpack_from(">H", jpeg, 4)[0]


def _with_segments(jpeg: bytes, segments: bytes) -> bytes:
    at = _end_of_header(jpeg)
    return jpeg[:at] + segments + jpeg[at:]


def _segment(marker: int, content: bytes) -> bytes:
    return struct.pack(">BBH", 0xFF, marker, len(content) + 2) + content


def _index(first: int, second: int, offset: int) -> bytes:
    """Returns the APP2 segment with the sizes of both pictures. offset: of the second one, from the index's own start."""
    entries = struct.pack("<IIIHH", 0x030000, first, 0, 0, 0) + struct.pack("<IIIHH", 0, second, offset, 0, 0)
    fields = (
        struct.pack("<HHI4s", 0xB000, 7, 4, b"0100")
        + struct.pack("<HHII", 0xB001, 4, 1, 2)
        + struct.pack("<HHII", 0xB002, 7, len(entries), 50)
    )
    made = _segment(0xE2, b"MPF\0" + b"II*\0" + struct.pack("<IH", 8, 3) + fields + struct.pack("<I", 0) + entries)
    assert len(made) == _MPF_BYTES
    return made
