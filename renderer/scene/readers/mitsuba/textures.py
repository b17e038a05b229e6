"""What varies over a surface: Mitsuba's textures as ours."""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer.scene.description import Image, TexelFilter, UvTransform, Vec3, Wrap
from renderer.scene.readers.mitsuba.document import Document, Element
from renderer.scene.readers.mitsuba.values import Matrix, rgb
from renderer.scene.textures import UNMOVED, TextureShelf

__all__ = ["Textures"]

_WRAPS: dict[str, Wrap] = {"repeat": "repeat", "mirror": "mirror", "clamp": "clamp"}
WHITE: Vec3 = (1.0, 1.0, 1.0)


class Textures:
    """Looks up colours and numbers, by textures or without."""

    def __init__(self, document: Document, shelf: TextureShelf) -> None:
        self._document, self._shelf = document, shelf

    def color(self, owner: Element, name: str, default: float | Vec3 = 0.5, is_light: bool = False) -> tuple[Vec3, int | None]:
        """A colour and the texture that multiplies it."""
        texture = owner.child(name)
        if texture is None:
            return rgb(owner.get(name, default), is_light), None
        if texture.type in ("uniform", "srgb", "d65"):
            return rgb(texture.get("color", texture.get("value", 1.0)), is_light), None
        number = self.texture(texture, True)
        return (WHITE, number) if number is not None else (rgb(default, is_light), None)

    def number(self, owner: Element, name: str, default: float) -> float:
        """A number; of a texture the mean, which is said."""
        texture = owner.child(name)
        if texture is None:
            return owner.number(name, default)
        image = self.texture(texture, False)
        if image is None:
            return default
        self._document.ignore(f"{name} of {owner.what} varies over the surface: its mean is taken")
        return float(_linear(self._shelf.image_of(image)).mean())

    def texture(self, source: Element, is_color: bool) -> int | None:
        """The number of a texture; None where there is none that is read."""
        transform = _uv(source.get("to_uv"))
        if source.type == "bitmap":
            return self._bitmap(source, is_color, transform)
        if source.type == "checkerboard":
            dark, light = rgb(source.get("color0", 0.4)), rgb(source.get("color1", 0.2))
            pixels = np.array([[light, dark], [dark, light]], np.float32)
            image = self._shelf.add(Image(f"checkerboard {len(source.values)} {dark} {light}", pixels, srgb=False))
            return self._shelf.texture(image, transform=transform, filter="nearest")
        if source.type in ("scale", "volume") and source.children:
            self._document.ignore(f"{source.what}: its texture is taken without it")
            return self.texture(source.children[0], is_color)
        self._document.ignore(f"{source.what} is not read: its surface is rendered in one colour")
        return None

    def _bitmap(self, source: Element, is_color: bool, transform: UvTransform) -> int | None:
        wanted = str(source.get("filename", ""))
        name = self._document.files.find(wanted, source.file)
        if name is None:
            self._shelf.missing(wanted, source.what)
            return None
        is_raw = source.flag("raw", not is_color)
        wrap = _WRAPS.get(str(source.get("wrap_mode", "repeat")), "repeat")
        filter: TexelFilter = "nearest" if source.get("filter_type") == "nearest" else "linear"
        return self._shelf.texture(self._shelf.image_file(name, not is_raw), wrap, wrap, 0, transform, (), filter)


def _uv(matrix: Any) -> UvTransform:
    """A transform of UVs: of a 3x3 matrix, or of a 4x4 one its x and y."""
    if not isinstance(matrix, np.ndarray):
        return UNMOVED
    found: Matrix = matrix
    x, y = found[0], found[1]
    last = 2 if np.allclose(found[:2, 3], 0) and not np.allclose(found[:2, 2], 0) else 3
    a, b, c, d, e, f = (float(v) for v in (x[0], x[1], x[last], y[0], y[1], y[last]))
    return a, b, c, d, e, f


def _linear(image: Image) -> np.ndarray[Any, np.dtype[np.float32]]:
    pixels = np.asarray(image.pixels[..., :3], np.float32)
    if image.pixels.dtype != np.uint8:
        return pixels
    from renderer.image.tonemap import decode_srgb

    return np.asarray(decode_srgb(pixels / 255) if image.srgb else pixels / 255, np.float32)
