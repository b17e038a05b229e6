"""Decodes a texture or an HDR image into pixels. The bytes are untrusted: sizes are checked before anything is decoded."""

from __future__ import annotations

import io
import warnings
from importlib import import_module
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from renderer.errors import SceneError
from renderer.image.kinds import IMAGE_SUFFIXES, KTX2, PILLOW, is_deep_png, suffix_of, targa_alpha
from renderer.image.openimageio import Decoded, Limits, decode_with_openimageio, unpremultiplied
from renderer.image.unread import pillow_notes
from renderer.library_messages import library_message
from renderer.sentences import Sentence

__all__ = ["IMAGE_SUFFIXES", "MAX_PIXELS", "Decoded", "decode", "read"]

MAX_PIXELS = 1 << 26  # 8192 x 8192
_LARGER = 8  # times MAX_PIXELS: environments up to this are averaged to fewer pixels


def read(data: bytes, name: str) -> npt.NDArray[Any]:
    """Returns the pixels of `decode` without its notes."""
    return decode(data, name).pixels


def decode(data: bytes, name: str, is_environment: bool = False) -> Decoded:
    """Returns the pixels of an image, rows from the top, and notes on guesses and changes.

    Pixels: (h, w, 4) uint8; (h, w, 4) uint16 if the format has more bits and they are used; linear float32 for floats, (h, w, 4)
    with alpha, else (h, w, 3). Alpha is straight (not premultiplied). name: for error messages. The format is detected from the
    bytes alone. is_environment: floats have no alpha, colours stay premultiplied, and images of more than MAX_PIXELS are scaled
    down. Raises SceneError if the bytes are not an image of a known format, are damaged, or contain too many pixels.
    """
    suffix = suffix_of(data)
    if suffix is None:
        raise SceneError(
            Sentence(
                "image-format-unknown",
                "{name} is not an image of a known format; give one of {formats}",
                name=name,
                formats=[*IMAGE_SUFFIXES],
            )
        )
    limits = Limits(MAX_PIXELS * _LARGER if is_environment else MAX_PIXELS, MAX_PIXELS)
    try:
        if suffix == KTX2:
            return Decoded(_decode_with_basisu(data, name, limits), [])
        if suffix in PILLOW and not (suffix == ".png" and is_deep_png(data)):
            return _decode_with_pillow(data, name, suffix, limits)
        found = decode_with_openimageio(data, name, suffix, limits, straight=not is_environment)
    except (SceneError, MemoryError):
        raise
    except Image.DecompressionBombError as error:  # Pillow's own limit is above ours, and is checked first
        raise SceneError(
            Sentence(
                "image-pixels-too-many",
                "{name} has too many pixels; at most {million} million are allowed. Give a smaller image",
                name=name,
                million=MAX_PIXELS >> 20,
            )
        ) from error
    except Exception as error:  # the decoders raise nearly every type on damaged data
        raise SceneError(
            Sentence(
                "image-damaged-or-misnamed",
                "{name}: the image is damaged or of another format than its name says ({error}); export it again",
                name=name,
                error=library_message(error),
            )
        ) from error
    pixels = found.pixels
    if is_environment and pixels.dtype == np.float32:
        pixels = np.ascontiguousarray(pixels[..., :3])
    return Decoded(_reduced_to_eight_bits(pixels) if pixels.dtype == np.uint16 else pixels, found.notes)


def _reduced_to_eight_bits(pixels: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Converts 16-bit pixels to 8 bits if that is lossless; otherwise returns them unchanged."""
    codes = (pixels >> 8).astype(np.uint8)
    return codes if (pixels == codes.astype(np.uint16) * 257).all() else pixels


def _decode_with_pillow(data: bytes, name: str, suffix: str, limits: Limits) -> Decoded:
    notes: list[str] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with Image.open(io.BytesIO(data), formats=(PILLOW[suffix],)) as source:
            factor = limits.factor(name, *source.size)
            notes += pillow_notes(source, name)
            image: Image.Image = source
            if source.mode == "CMYK":
                image = source.convert("RGB")
            if factor > 1:
                image = image.convert("RGBA").reduce(factor)
                notes.append(
                    Sentence(
                        "image-reduced",
                        "{name}: its {width} x {height} pixels are reduced to {new_width} x {new_height}, as at "
                        "most {million} million are kept; give it in that size to save time",
                        name=name,
                        width=source.width,
                        height=source.height,
                        new_width=image.width,
                        new_height=image.height,
                        million=limits.kept >> 20,
                    )
                )
            pixels = np.array(image.convert("RGBA"))
    if suffix == ".tga":
        alpha = targa_alpha(data)
        if alpha == "none":
            pixels[..., 3] = 255
        elif alpha == "premultiplied":
            pixels = unpremultiplied(pixels)
    return Decoded(pixels, notes)


def _decode_with_basisu(data: bytes, name: str, limits: Limits) -> npt.NDArray[Any]:
    """Decodes a KTX 2 file of Basis Universal (ETC1S or UASTC), as used by KHR_texture_basisu."""
    try:
        basisu = import_module("opengl_basisu")  # an extra
    except ImportError as error:
        raise SceneError(
            Sentence(
                "image-ktx2-needs-package",
                "{name} is a KTX2 image; install the package opengl_basisu, or give a PNG",
                name=name,
            )
        ) from error
    if len(data) < 80:
        raise SceneError(Sentence("image-cut-off", "{name}: the image is cut off; export it again", name=name))
    size = int.from_bytes(data[20:24], "little"), max(int.from_bytes(data[24:28], "little"), 1)
    Limits(limits.kept, limits.kept).factor(name, *size)
    image = basisu.open(data).transcode("rgba8", level=0)
    return np.array(image.data, np.uint8)
