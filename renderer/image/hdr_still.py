"""High dynamic range stills: AVIF and JPEG XL with the PQ signal of ITU-R BT.2100 (Rec.2020 primaries).

Radiance 1, after exposure, is shown at 203 nits, the reference white of BT.2408; brighter values approach 1000 nits and keep
their hue. A view of an OpenColorIO config is written as it is if its display takes this signal.
"""

from __future__ import annotations

import io
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio  # noqa: N813 -- the name its own documentation uses

from renderer.encoder_priority import restored_priorities
from renderer.errors import SettingsError
from renderer.image.tonemap import Curve, check_pq, exposed
from renderer.sentences import Sentence

__all__ = ["FORMATS", "check_size", "encode_still", "highlights_rolled", "pq_of_nits", "pq_picture"]

F32 = npt.NDArray[np.float32]
FORMATS = ("avif", "jxl")

WHITE, PEAK = 203.0, 1000.0  # nits
REC_2020_FROM_REC_709 = np.array(  # ITU-R BT.2087
    [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]], np.float32
)
# Codes of ITU-T H.273: primaries and matrix of BT.2020, transfer PQ, full range.
PRIMARIES, TRANSFER, MATRIX, FULL_RANGE = 9, 16, 9, 2
KR, KB = 0.2627, 0.0593  # of BT.2020's matrix
SMALLEST = 64  # of SVT-AV1, pixels a side
SVT_OPTIONS = {"crf": "10", "preset": "6", "svtav1-params": "lp=2:avif=1"}


def pq_of_nits(nits: F32) -> F32:
    """Returns PQ signal values 0..1 of luminance. Source: SMPTE ST 2084, inverse EOTF."""
    y = np.clip(nits / np.float32(10_000), 0, 1) ** np.float32(2610 / 16384)
    return ((3424 / 4096 + 2413 / 128 * y) / (1 + 2392 / 128 * y)) ** np.float32(2523 / 32)


def pq_picture(rgb: F32, exposure: float = 0.0, curve: Curve = "neutral") -> F32:
    """Returns the PQ signal, (h, w, 3) float32 in 0..1, of scene-linear Rec.709 radiance.

    exposure: in stops. curve: a view for a PQ display; the tone curves, which are for displays of standard range, have no effect.
    Raises SettingsError for a view of another display.
    """
    linear = exposed(rgb, exposure)
    if not isinstance(curve, str):
        check_pq(curve)
        return np.clip(curve.encode(linear), 0, 1)
    return pq_of_nits(np.float32(WHITE) * (highlights_rolled(linear) @ REC_2020_FROM_REC_709.T))


def highlights_rolled(linear: F32) -> F32:
    """Returns linear values, (h, w, 3), relative to the reference white, with those above 1 compressed to PEAK / WHITE.

    A pixel keeps the ratios of its channels.
    """
    brightest = linear.max(axis=-1, keepdims=True)
    room = np.float32(PEAK / WHITE - 1)
    rolled = 1 + room * (1 - np.exp((1 - np.maximum(brightest, 1)) / room))
    return linear * np.where(brightest > 1, rolled / np.maximum(brightest, 1), 1)


def check_size(format: str, width: int, height: int) -> None:
    """Raises SettingsError if a picture is too small for a file of this format. width, height: in pixels."""
    if format == "avif" and min(height, width) < SMALLEST:
        raise SettingsError(
            Sentence(
                "still-too-small",
                "an .avif has at least {least} x {least} pixels; the picture has {width} x {height}",
                least=SMALLEST,
                width=width,
                height=height,
            )
        )


def encode_still(signal: F32, format: str) -> bytes:
    """Returns an avif or jxl file of a PQ signal, (h, w, 3) in 0..1. Raises SettingsError if it cannot be written."""
    return _avif(signal) if format == "avif" else _jxl(signal)


def _jxl(signal: F32) -> bytes:
    height, width, _ = signal.shape
    spec = oiio.ImageSpec(width, height, 3, oiio.UINT16)
    spec.attribute("CICP", oiio.TypeDesc("int[4]"), (PRIMARIES, TRANSFER, 0, 1))
    spec.attribute("oiio:ColorSpace", "pq_rec2020_display")
    spec.attribute("compression", "jpegxl:95")
    spec.attribute("Software", "Rayfarm")
    with tempfile.TemporaryDirectory(prefix="rayfarm-") as folder:  # OpenImageIO's Python module writes to named files only
        path = Path(folder) / "picture.jxl"
        output = oiio.ImageOutput.create(str(path))
        is_written = output is not None and output.open(str(path), spec) and output.write_image(np.ascontiguousarray(signal))
        if not (output is not None and output.close() and is_written):
            raise _not_written("jxl", (output or oiio).geterror())
        return path.read_bytes()


def _avif(signal: F32) -> bytes:
    """Encodes 10 bits, 4:2:0, by SVT-AV1."""
    os.environ.setdefault("SVT_LOG", "1")  # of the encoder: errors only
    import av  # only if needed: FFmpeg is large

    height, width, _ = signal.shape
    check_size("avif", width, height)
    out = io.BytesIO()
    try:
        with av.open(out, "w", format="avif") as container, restored_priorities() as restore:
            stream: Any = container.add_stream("libsvtav1", rate=1, options=dict(SVT_OPTIONS))
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p10le"
            frame = av.VideoFrame(width, height, "yuv420p10le")
            for plane, values in zip(frame.planes, _planes(signal), strict=True):
                rows = np.zeros((plane.height, plane.line_size // 2), "<u2")
                rows[:, : values.shape[1]] = values
                plane.update(rows.tobytes())
            frame.pts = 0
            for each in (stream.codec_context, frame):
                each.color_primaries, each.color_trc, each.colorspace, each.color_range = PRIMARIES, TRANSFER, MATRIX, FULL_RANGE
            stream.codec_context.open()
            restore()
            for last in (frame, None):
                container.mux(stream.encode(last))
                restore()
    except (av.FFmpegError, ValueError) as error:
        raise _not_written("avif", error) from error
    return out.getvalue()


def _planes(signal: F32) -> tuple[F32, F32, F32]:
    """Returns the planes of Y', Cb, Cr as 10-bit codes; the last two of half the size, rounded up. Source: ITU-R BT.2100."""
    height, width, _ = signal.shape
    red, green, blue = np.moveaxis(signal, -1, 0)
    luma = KR * red + (1 - KR - KB) * green + KB * blue
    chroma = np.stack([(blue - luma) / (2 * (1 - KB)), (red - luma) / (2 * (1 - KR))])
    chroma = np.pad(chroma, ((0, 0), (0, height % 2), (0, width % 2)), "edge")
    halves = chroma.reshape(2, (height + 1) // 2, 2, (width + 1) // 2, 2).mean(axis=(2, 4))
    blues, reds = np.clip(np.rint(halves * 1023 + 512), 0, 1023)
    return np.rint(luma * 1023), blues, reds


def _not_written(format: str, error: object) -> SettingsError:
    return SettingsError(
        Sentence("still-not-writable", "the .{format} cannot be written ({error})", format=format, error=str(error))
    )
