"""Encodes a rendered image as an image file.

png, jpg: display values, after exposure and tone curve. avif, jxl: high dynamic range (hdr_still.py). exr, hdr: scene-linear
Rec.709, without exposure and tone curve. EXR stores float32 and may contain further channels. Alpha: associated (premultiplied)
in EXR, straight in PNG, left out of others, which show the picture on black.
"""

from __future__ import annotations

import io
import os
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio  # noqa: N813 -- the name its own documentation uses
from PIL import Image

from renderer.errors import SettingsError
from renderer.image import hdr_still, tonemap
from renderer.image.gain_map import encode_jpeg_with_gain_map
from renderer.image.tonemap import Curve
from renderer.sentences import Sentence

__all__ = ["ALPHA", "FORMATS", "RGB", "encode", "encode_channels", "encode_shown", "format_of", "write", "write_bands"]

F32 = npt.NDArray[np.float32]
FORMATS = ("png", "jpg", *hdr_still.FORMATS, "exr", "hdr")
RGB = ("R", "G", "B")
ALPHA = "A"

# Rec.709 primaries and the D65 white point, written to the file so that readers need not guess.
_REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)


def format_of(path: str | Path) -> str:
    """Returns the image format for a file name's suffix. Raises SettingsError if it is not supported."""
    suffix = Path(path).suffix.lower().lstrip(".")
    suffix = {"jpeg": "jpg"}.get(suffix, suffix)
    if suffix not in FORMATS:
        raise SettingsError(
            Sentence(
                "picture-file-format-unknown",
                "{name}: pictures are written as .{formats}; use one of these suffixes",
                name=Path(path).name,
                formats=", .".join(FORMATS),
            )
        )
    return suffix


def encode(
    rgb: F32,
    format: str,
    exposure: float = 0.0,
    curve: Curve = "neutral",
    channels: Mapping[str, F32] | None = None,
    header: Mapping[str, str] | None = None,
    alpha: F32 | None = None,
    gain_map: bool = False,
) -> bytes:
    """Returns an image file of scene-linear (h, w, 3) float32 radiance, as bytes.

    format: one of FORMATS. exposure (stops) and curve (a name of tonemap.CURVES, or a transform) do not apply to exr and hdr.
    channels: for exr, further (h, w) planes by channel name. header: for exr, further attributes. alpha: (h, w), for exr and png,
    with which the radiance is premultiplied. gain_map: whether a jpg has one (gain_map.py). Raises SettingsError for an unknown
    format or curve.
    """
    if gain_map and format == "jpg":
        return encode_jpeg_with_gain_map(rgb, exposure, curve)
    if format == "png" and alpha is not None:
        return encode_shown(tonemap.apply_straight(rgb, alpha, exposure, curve), format)
    if format in ("png", "jpg"):
        return encode_shown(tonemap.apply(rgb, exposure, curve), format)
    if format in hdr_still.FORMATS:
        return hdr_still.encode_still(hdr_still.pq_picture(rgb, exposure, curve), format)
    if format == "exr":
        names, planes = [*RGB], [np.asarray(rgb, np.float32)]
        for name, values in (({} if alpha is None else {ALPHA: alpha}) | dict(channels or {})).items():
            if values.shape != rgb.shape[:2]:
                raise ValueError(f"channel {name} is {values.shape}; the picture is {rgb.shape[:2]}")
            names.append(name)
            planes.append(np.asarray(values, np.float32)[..., None])
        return _encode_with_openimageio(np.concatenate(planes, axis=-1), names, ".exr", header)
    if format == "hdr":
        return _encode_with_openimageio(np.asarray(rgb, np.float32), RGB, ".hdr")
    raise SettingsError(
        Sentence(
            "picture-format-unknown", "picture format is {format}; known are {formats}", format=repr(format), formats=[*FORMATS]
        )
    )


def encode_channels(planes: F32, names: Sequence[str]) -> bytes:
    """Returns an EXR file of planes (h, w, n) that are no colours, as bytes. names: of the n channels."""
    return _encode_with_openimageio(np.asarray(planes, np.float32), names, ".exr")


def encode_shown(pixels: npt.NDArray[np.uint8], format: str) -> bytes:
    """Returns a png or jpg file of display values, (h, w, 3) uint8 sRGB, as bytes; a png may have straight alpha, (h, w, 4)."""
    out = io.BytesIO()
    picture = Image.fromarray(np.ascontiguousarray(pixels))
    if format == "png":
        picture.save(out, "PNG", compress_level=4)
    else:
        picture.save(out, "JPEG", quality=95, subsampling=0)
    return out.getvalue()


def write(
    path: str | Path,
    rgb: F32,
    format: str | None = None,
    exposure: float = 0.0,
    curve: Curve = "neutral",
    channels: Mapping[str, F32] | None = None,
    header: Mapping[str, str] | None = None,
    alpha: F32 | None = None,
    gain_map: bool = False,
) -> None:
    """Writes an image file, encoded as by `encode`, atomically. format: None: that of the name's suffix."""
    path = Path(path)
    data = encode(rgb, format or format_of(path), exposure, curve, channels, header, alpha, gain_map)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        umask = os.umask(0)
        os.umask(umask)
        Path(temporary).chmod(0o666 & ~umask)  # mkstemp makes files that only their owner reads
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def write_bands(
    path: str | Path,
    bands: Iterable[F32],
    width: int,
    height: int,
    names: Sequence[str] = RGB,
    header: Mapping[str, str] | None = None,
) -> None:
    """Writes an exr or hdr file, chosen by the name's suffix, from bands of rows: the whole image is never in memory.

    bands: from the top, (rows, width, channels) each. names: of the channels. header: further attributes of an exr. Raises
    OSError if the file cannot be written.
    """
    spec = oiio.ImageSpec(width, height, len(names), oiio.FLOAT)
    spec.channelnames = tuple(names)
    spec.attribute("compression", "zip")
    spec.attribute("oiio:ColorSpace", "lin_rec709_scene")
    spec.attribute("colorInteropID", "lin_rec709_scene")  # of the Color Interop Forum
    spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), _REC709)
    spec.attribute("Software", "Rayfarm")
    for key, value in (header or {}).items():
        spec.attribute(key, value)
    output = oiio.ImageOutput.create(str(path))
    if output is None or not output.open(str(path), spec):
        raise OSError(f"could not write a {Path(path).suffix} picture: {(output or oiio).geterror()}")
    y = 0
    is_written = True
    for band in bands:
        end = y + len(band)
        is_written = is_written and output.write_scanlines(y, end, 0, np.ascontiguousarray(band, np.float32))
        y = end
    if not (output.close() and is_written):
        raise OSError(f"could not write a {Path(path).suffix} picture: {output.geterror()}")


def _encode_with_openimageio(pixels: F32, names: Sequence[str], suffix: str, header: Mapping[str, str] | None = None) -> bytes:
    # OpenImageIO's Python module writes to named files only.
    with tempfile.TemporaryDirectory(prefix="rayfarm-") as folder:
        path = Path(folder) / f"picture{suffix}"
        write_bands(path, [pixels], pixels.shape[1], pixels.shape[0], names, header)
        return path.read_bytes()
