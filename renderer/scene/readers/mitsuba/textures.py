"""What varies over a surface: Mitsuba's textures as ours."""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer.errors import SceneError
from renderer.scene.description import Image, TexelFilter, UvTransform, Vec3, Wrap
from renderer.scene.readers.mitsuba.document import Document, Element
from renderer.scene.readers.mitsuba.values import Matrix, Spectrum, numbers, planck, rgb
from renderer.scene.readers.mtl_maps import with_opacity
from renderer.scene.textures import UNMOVED, TextureShelf

__all__ = ["Textures", "radiance_of"]

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
        constant = constant_of(texture)
        if constant is not None:
            return rgb(constant, is_light), None
        number = self.texture(texture, True)
        return (WHITE, number) if number is not None else (rgb(default, is_light), None)

    def number(self, owner: Element, name: str, default: float) -> float:
        """A number; of a texture the mean, which is said."""
        texture = owner.child(name)
        if texture is None:
            return owner.number(name, default)
        constant = constant_of(texture)
        if constant is not None:
            return float(np.mean(rgb(constant)))
        image = self.texture(texture, False)
        if image is None:
            return default
        self._document.ignore(f"{name} of {owner.what} varies over the surface: its mean is taken")
        return float(_linear(self._shelf.image_of(image)).mean())

    def cut_out(self, color: int | None, opacity: int) -> int | None:
        """A texture of a colour, white for none, whose alpha is another's grey."""
        return with_opacity(self._shelf, color, opacity)

    def texture(self, source: Element, is_color: bool) -> int | None:
        """The number of a texture; None where there is none that is read."""
        transform = _uv(source.get("to_uv", _spread(source)))
        if source.type == "bitmap":
            return self._bitmap(source, is_color, transform)
        if source.type == "checkerboard":
            dark, light = rgb(source.get("color0", 0.4)), rgb(source.get("color1", 0.2))
            pixels = np.array([[dark, light], [light, dark]], np.float32)
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


def _spread(source: Element) -> Matrix:
    """As Mitsuba 0.6 has it: by how much UVs are multiplied, and then moved."""
    found = np.diag([source.number("uscale", 1.0), source.number("vscale", 1.0), 1.0, 1.0])
    found[:2, 3] = source.number("uoffset", 0.0), source.number("voffset", 0.0)
    return found


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


def constant_of(source: Element) -> Any:
    """The value of a plugin that is the same all over, its spectrum; None of others. Raises SceneError."""
    if source.type in ("uniform", "srgb", "rawconstant"):
        return source.get("color", source.get("value", 1.0))
    if source.type == "d65":
        return np.asarray(rgb(source.get("color", 1.0))) * source.number("scale", 1.0)
    if source.type not in ("blackbody", "irregular", "regular"):
        return None
    try:
        if source.type == "blackbody":
            return planck(source.number("temperature", 5000.0), source.number("scale", 1.0))
        values = numbers(str(source.get("values", "")))
        if source.type == "irregular":
            return Spectrum(list(numbers(str(source.get("wavelengths", "")))), list(values))
        first, last = (source.number(f"wavelength_{end}", at) for end, at in (("min", 360.0), ("max", 830.0)))
        return Spectrum(list(np.linspace(first, last, len(values))), list(values))
    except ValueError as error:
        raise SceneError(f"{source.file}: {source.what}: {error}") from None


def radiance_of(owner: Element, name: str) -> Vec3:
    """What a light without a body sends out; white where nothing is said. Raises SceneError."""
    child = owner.child(name)
    found = None if child is None else constant_of(child)
    return rgb(owner.get(name, 1.0) if found is None else found, is_light=True)
