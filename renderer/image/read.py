"""The bytes of a texture or an HDR image as pixels. The bytes are untrusted: sizes are judged before anything is decoded."""

from __future__ import annotations

import io
import tempfile
import warnings
from importlib import import_module
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio  # noqa: N813 -- the name its own documentation uses
from PIL import Image

from renderer.errors import SceneError

__all__ = ["IMAGE_SUFFIXES", "MAX_PIXELS", "read"]

MAX_PIXELS = 1 << 26  # 8192 x 8192

# Formats of 8 bits a channel. Pillow's others stay shut: some start programs (EPS), none is a texture.
_PILLOW = {
    ".png": "PNG",
    ".jpg": "JPEG",
    ".jpeg": "JPEG",
    ".webp": "WEBP",
    ".avif": "AVIF",
    ".tga": "TGA",
    ".bmp": "BMP",
    ".gif": "GIF",
}
_OPENIMAGEIO = (".exr", ".hdr", ".pic", ".tif", ".tiff", ".pfm", ".ppm", ".pgm", ".dds", ".psd", ".jp2", ".sgi", ".rgb")
_KTX2 = ".ktx2"
IMAGE_SUFFIXES = (*_PILLOW, *_OPENIMAGEIO, _KTX2)

_MAGIC = (
    (b"\x89PNG\r\n\x1a\n", ".png"),
    (b"\xff\xd8\xff", ".jpg"),
    (b"\x76\x2f\x31\x01", ".exr"),
    (b"#?RADIANCE", ".hdr"),
    (b"#?RGBE", ".hdr"),
    (b"GIF8", ".gif"),
    (b"BM", ".bmp"),
    (b"II*\x00", ".tif"),
    (b"MM\x00*", ".tif"),
    (b"DDS ", ".dds"),
    (b"\xabKTX 20\xbb\r\n\x1a\n", _KTX2),
)


def read(data: bytes, name: str) -> npt.NDArray[Any]:
    """The pixels of an image, rows from the top: (h, w, 4) uint8, or (h, w, 3) float32 where the format holds floats.

    `name` is said in errors and its suffix is believed only where the bytes do not say their format.
    Raises SceneError where the bytes are no image of a known format, are damaged, or hold more than MAX_PIXELS.
    """
    suffix = _suffix(data, name)
    if suffix not in IMAGE_SUFFIXES:
        raise SceneError(f"{name}: is no image of a known format; give one of {', '.join(IMAGE_SUFFIXES)}")
    try:
        if suffix in _PILLOW:
            return _through_pillow(data, name, _PILLOW[suffix])
        if suffix == _KTX2:
            return _through_basisu(data, name)
        return _through_openimageio(data, name, suffix)
    except (SceneError, MemoryError):
        raise
    except Image.DecompressionBombError as error:  # Pillow's own limit lies above ours, and is judged first
        raise SceneError(f"{name}: has too many pixels; at most {MAX_PIXELS >> 20} million fit. Give a smaller image") from error
    except Exception as error:  # the decoders raise nearly every type on damaged data
        raise SceneError(f"{name}: the image is damaged or not what its name says ({error}); export it again") from error


def _suffix(data: bytes, name: str) -> str:
    for magic, suffix in _MAGIC:
        if data.startswith(magic):
            return suffix
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return ".webp"
    if data[4:12] in (b"ftypavif", b"ftypavis"):
        return ".avif"
    return PurePosixPath(name).suffix.lower()


def _check_size(name: str, width: int, height: int) -> None:
    if width < 1 or height < 1 or width * height > MAX_PIXELS:
        raise SceneError(f"{name}: is {width} x {height} pixels; at most {MAX_PIXELS >> 20} million fit. Give a smaller image")


def _through_pillow(data: bytes, name: str, format: str) -> npt.NDArray[Any]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with Image.open(io.BytesIO(data), formats=(format,)) as image:
            _check_size(name, *image.size)
            if image.mode.startswith("I"):  # 16-bit grey
                grey = (np.asarray(image).astype(np.uint32) >> 8).clip(0, 255).astype(np.uint8)
                return np.dstack([grey, grey, grey, np.full_like(grey, 255)])
            if image.mode == "CMYK":
                return np.array(image.convert("RGB").convert("RGBA"))
            return np.array(image.convert("RGBA"))


def _through_basisu(data: bytes, name: str) -> npt.NDArray[Any]:
    """A KTX 2 file of Basis Universal (ETC1S or UASTC), as KHR_texture_basisu has them."""
    try:
        basisu = import_module("opengl_basisu")  # an extra
    except ImportError as error:
        raise SceneError(f"{name}: is a KTX2 image; install the package opengl_basisu, or give a PNG") from error
    if len(data) < 80:
        raise SceneError(f"{name}: the image is cut off; export it again")
    _check_size(name, int.from_bytes(data[20:24], "little"), max(int.from_bytes(data[24:28], "little"), 1))
    image = basisu.open(data).transcode("rgba8", level=0)
    return np.array(image.data, np.uint8)


def _through_openimageio(data: bytes, name: str, suffix: str) -> npt.NDArray[Any]:
    # OpenImageIO's Python module reads named files only.
    with tempfile.TemporaryDirectory(prefix="rayfarm-") as folder:
        path = Path(folder) / f"image{suffix}"
        path.write_bytes(data)
        source = oiio.ImageInput.open(str(path))
        if source is None:
            raise SceneError(f"{name}: the image is damaged or not what its name says ({_error(oiio, path)}); export it again")
        try:
            spec = source.spec()
            _check_size(name, spec.width, spec.height)
            if spec.nchannels < 1 or spec.nchannels > 64 or spec.depth > 1:
                raise SceneError(f"{name}: has {spec.nchannels} channels; give a plain RGB, RGBA or grey image")
            floats = spec.format.basetype in (oiio.HALF, oiio.FLOAT, oiio.DOUBLE)
            channels = _colour_channels(list(spec.channelnames), spec.nchannels)
            first, last = min(channels), max(channels) + 1
            pixels = source.read_image(0, 0, first, last, oiio.FLOAT if floats else oiio.UINT8)
            if pixels is None:
                raise SceneError(f"{name}: the image is damaged ({_error(source, path)}); export it again")
        finally:
            source.close()
    pixels = np.asarray(pixels).reshape(spec.height, spec.width, last - first)[..., [c - first for c in channels]]
    if floats:
        return np.nan_to_num(pixels[..., :3].astype(np.float32), nan=0.0, posinf=65504.0, neginf=0.0)
    opaque = np.full((*pixels.shape[:2], 1), 255, np.uint8)
    return np.ascontiguousarray(pixels if pixels.shape[2] == 4 else np.concatenate([pixels, opaque], axis=2))


def _colour_channels(names: list[str], count: int) -> list[int]:
    """Which channels are red, green, blue (and alpha), by name where the names say so, else by place."""
    lower = [n.lower() for n in names]
    if all(c in lower for c in "rgb"):
        rgb = [lower.index(c) for c in "rgb"]
        return [*rgb, lower.index("a")] if "a" in lower else rgb
    if count < 3:
        return [0, 0, 0, 1] if count == 2 else [0, 0, 0]
    return list(range(min(count, 4)))


def _error(source: Any, path: Path) -> str:
    lines = str(source.geterror()).replace(str(path), path.name).strip().splitlines()
    return lines[0] if lines else "no reason given"
