"""Textures of a preview mesh: images reduced to at most 1024 pixels a side, and encoded as browsers read them."""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image as Pillow

from renderer.image.tonemap import encode_srgb
from renderer.preview_mesh import NO_TEXTURE, PreviewTexture
from renderer.scene.description import Image, SceneDescription

__all__ = ["Textures"]

WIDEST = 1024  # pixels of a side
MOST_TEXELS = 1 << 24  # of all textures: with JPEG and WebP, about half a byte each
MOST_TEXTURES = 256  # further ones are not shown
_QUALITY = 88
_SMALL = 64  # pixels of a side, up to which files are small without losses
_INTEGERS, _FLOATS = 8, 3  # pixels averaged for one, along a side: others of huge images are left out, for time and memory
_FASTEST = 0  # of WebP's methods


class Textures:
    """Collects the textures that a preview shows. Layers of textures are left out."""

    def __init__(self, description: SceneDescription) -> None:
        self._description = description
        self._numbers: dict[tuple[Any, ...], int] = {}  # by image and sampler

    def number(self, texture: int, is_data: bool = False) -> int:
        """Returns the number of a texture in the preview, which is added if it is new; NO_TEXTURE if there are too many.

        is_data: its values are no colours.
        """
        source = self._description.textures[texture]
        key = (source.image, is_data, source.wrap_s, source.wrap_t, source.filter == "nearest")
        if key not in self._numbers and len(self._numbers) >= MOST_TEXTURES:
            return NO_TEXTURE
        return self._numbers.setdefault(key, len(self._numbers))

    def mean(self, texture: int) -> tuple[float, float]:
        """Returns the means of a texture's green and blue channels, 0 ... 1, as they are stored."""
        pixels = self._description.images[self._description.textures[texture].image].pixels
        step = max(1, min(pixels.shape[:2]) // 64)
        green, blue = pixels[::step, ::step, 1:3].reshape(-1, 2).mean(axis=0, dtype=np.float64)
        most = 1.0 if pixels.dtype.kind == "f" else float(np.iinfo(pixels.dtype).max)
        return float(green / most), float(blue / most)

    def encoded(self) -> tuple[PreviewTexture, ...]:
        """Returns the collected textures as JPEG or, if they are small, PNG files; with transparent pixels as WebP files."""
        side = int(min(WIDEST, math.sqrt(MOST_TEXELS / max(len(self._numbers), 1))))
        files: dict[tuple[int, bool], tuple[bytes, str]] = {}
        found = []
        for image, is_data, wrap_s, wrap_t, nearest in self._numbers:
            if (image, is_data) not in files:
                files[image, is_data] = _encoded(_reduced(self._description.images[image], is_data, side, nearest))
            found.append(PreviewTexture(*files[image, is_data], wrap_s, wrap_t, nearest))
        return tuple(found)


def _reduced(image: Image, is_data: bool, side: int, nearest: bool) -> Pillow.Image:
    """Returns an image of 8 bits a channel of at most `side` pixels a side. Colours become sRGB, data stay as they are."""
    pixels = image.pixels
    height, width = pixels.shape[:2]
    is_encoded = is_data or (image.srgb and pixels.dtype.kind != "f")
    most = (_INTEGERS if is_encoded and pixels.dtype.kind != "f" else _FLOATS) * side
    step = max(1, -(-max(width, height) // most))
    shown = Pillow.fromarray(_bytes(pixels[::step, ::step], is_encoded))
    scale = side / max(shown.size)
    if scale >= 1.0:
        return shown
    size = tuple(max(1, round(scale * length)) for length in shown.size)
    return shown.resize((size[0], size[1]), Pillow.Resampling.NEAREST if nearest else Pillow.Resampling.BOX)


def _bytes(pixels: npt.NDArray[Any], is_encoded: bool) -> npt.NDArray[np.uint8]:
    """Returns pixels (h, w, 3 or 4) as uint8. is_encoded: they are sRGB or data, and not linear colours."""
    if pixels.dtype == np.uint8 and is_encoded:
        return np.ascontiguousarray(pixels)
    if pixels.dtype == np.uint16 and is_encoded:
        return (pixels >> 8).astype(np.uint8)
    most = np.float32(1.0 if pixels.dtype.kind == "f" else np.iinfo(pixels.dtype).max)
    shares = np.clip(np.nan_to_num(pixels.astype(np.float32) / most), 0.0, 1.0)
    if not is_encoded:
        shares[..., :3] = encode_srgb(shares[..., :3])
    return np.rint(shares * 255.0).astype(np.uint8)


def _encoded(picture: Pillow.Image) -> tuple[bytes, str]:
    file = io.BytesIO()
    if picture.mode == "RGBA" and np.asarray(picture.getchannel("A")).min() < 255:
        picture.save(file, "WEBP", quality=_QUALITY, method=_FASTEST, exact=True)  # opaque materials show transparent pixels
        return file.getvalue(), "image/webp"
    if max(picture.size) <= _SMALL:
        picture.convert("RGB").save(file, "PNG")
        return file.getvalue(), "image/png"
    picture.convert("RGB").save(file, "JPEG", quality=_QUALITY, subsampling=0)  # hues of neighbouring texels stay apart
    return file.getvalue(), "image/jpeg"
