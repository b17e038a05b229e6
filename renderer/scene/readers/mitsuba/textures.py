"""Converts Mitsuba's textures."""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer.errors import SceneError
from renderer.scene.description import Image, TexelFilter, UvTransform, Vec3, Wrap
from renderer.scene.given_spectra import GivenSpectrum, given_light, given_reflectance
from renderer.scene.observer import WAVELENGTHS
from renderer.scene.readers.coats import effective_albedo_under_coat
from renderer.scene.readers.linear_images import encoded, linear
from renderer.scene.readers.mitsuba.document import Document, Element
from renderer.scene.readers.mitsuba.values import Matrix, Spectrum, numbers, planck, rgb
from renderer.scene.readers.mtl_maps import with_opacity, with_roughness_and_metal
from renderer.scene.readers.number_ranges import unit
from renderer.scene.textures import IDENTITY_UV_TRANSFORM, TextureShelf
from renderer.sentences import Sentence

__all__ = ["Textures", "radiance_of"]

_WRAPS: dict[str, Wrap] = {"repeat": "repeat", "mirror": "mirror", "clamp": "clamp"}
WHITE: Vec3 = (1.0, 1.0, 1.0)
_LUMINANCE = np.array([0.212671, 0.715160, 0.072169], np.float32)


class Textures:
    """Reads properties of plugins that may be a constant colour or number, or a texture."""

    def __init__(self, document: Document, shelf: TextureShelf) -> None:
        self._document, self.shelf = document, shelf
        self.attribute = ""  # mesh attribute last used as colour; empty: none

    def color(self, owner: Element, name: str, default: float | Vec3 = 0.5, is_light: bool = False) -> tuple[Vec3, int | None]:
        """Returns a colour, and the index of the texture that multiplies it or None.

        is_light: whether the colour is a radiance rather than a reflectance.
        """
        texture = owner.child(name)
        if texture is None:
            return self._rgb(owner.get(name, default), is_light), None
        constant = constant_of(texture)
        if constant is not None:
            return self._rgb(constant, is_light), None
        attribute = str(texture.get("name", "")) if texture.type == "mesh_attribute" and not is_light else ""
        if attribute.startswith(("vertex_", "face_")) and self.attribute in ("", attribute):
            self.attribute = attribute
            scale = texture.number("scale", 1.0)
            if not 0 <= scale <= 1:
                self._document.ignore(
                    Sentence(
                        "mitsuba-sky-scale-units",
                        "{what}: its scale of {value} is converted to {unit}",
                        what=texture.description,
                        value=f"{scale:g}",
                        unit=f"{unit(scale):g}",
                    )
                )
            return (unit(scale),) * 3, None
        number = self.texture(texture, True)
        return (WHITE, number) if number is not None else (rgb(default, is_light), None)

    def _rgb(self, found: Any, is_light: bool) -> Vec3:
        return noted_rgb(found, is_light, self.shelf.spectra)

    def number(self, owner: Element, name: str, default: float) -> float:
        """Returns a property as a number; for a texture its mean, with a note."""
        texture = owner.child(name)
        if texture is None:
            return owner.number(name, default)
        constant = constant_of(texture)
        if constant is not None:
            return float(np.mean(rgb(constant)))
        image = self.texture(texture, False)
        if image is None:
            return default
        self._document.ignore(
            Sentence(
                "texture-averaged",
                "{name} of {what} is a texture: its mean is used",
                name=name,
                what=owner.description,
            )
        )
        return float(linear(self.shelf.image_of(image)).mean())

    def amount(self, owner: Element, name: str, default: float, power: float = 1.0) -> tuple[float, int | None]:
        """Returns a number, raised to a power, and the index of a grey texture that multiplies it; None without a texture.

        power: exponent, also applied to the texture's values.
        """
        texture = owner.child(name)
        if texture is None or constant_of(texture) is not None:
            return max(self.number(owner, name, default), 0.0) ** power, None
        found = self._grey(self.texture(texture, False), power)
        return (1.0, found) if found is not None else (default**power, None)

    def coated(self, color: Vec3, texture: int | None, inner: float) -> tuple[Vec3, int | None]:
        """Returns a colour and its texture, converted to the effective reflectance of paint under a coat.

        inner: the coat's internal albedo.
        """

        def coat(image: Image) -> Image:
            return Image(
                f"{image.name} coated",
                effective_albedo_under_coat(linear(image) * np.array(color, np.float32), inner),
                srgb=False,
            )

        if texture is None:
            return effective_albedo_under_coat(color, inner), None
        return WHITE, self.shelf.derived_texture(texture, f"under a coat of {inner} by {color}", coat)

    def scaled(self, color: Vec3, texture: int | None, factor: float) -> tuple[Vec3, int | None]:
        """Returns a colour and its texture, one of which is multiplied by a factor, with the product clamped to 1."""
        if texture is None:
            r, g, b = (unit(v * factor) for v in color)
            return (r, g, b), None
        if factor <= 1:
            return (factor,) * 3, texture

        def scale(image: Image) -> Image:
            return Image(f"{image.name} by {factor:g}", np.minimum(linear(image) * np.float32(factor), 1), srgb=False)

        return WHITE, self.shelf.derived_texture(texture, f"by {factor}", scale)

    def roughness_and_metal(self, roughness: int | None, metal: int | None) -> int | None:
        """Returns glTF's metallic-roughness texture made from two grey textures; None stands for a white one."""
        if roughness is not None and metal is not None and not self._have_equal_mapping(roughness, metal):
            self._document.ignore(
                Sentence("mitsuba-metallic-texture-placement", "The texture of metallic is placed like that of roughness")
            )
        return with_roughness_and_metal(self.shelf, roughness, metal)

    def cut_out(self, color: int | None, opacity: int) -> int | None:
        """Returns a colour texture (None: white) with the brightness of another texture as alpha."""
        if color is not None and not self._have_equal_mapping(color, opacity):
            self._document.ignore(
                Sentence("mitsuba-mask-texture-placement", "The texture of a mask is placed like that of the colour beneath it")
            )
        grey = self._grey(opacity)
        return with_opacity(self.shelf, color, opacity if grey is None else grey)

    def _grey(self, texture: int | None, power: float = 1.0) -> int | None:
        """Returns the index of a grey texture: the luminance of another texture, raised to a power."""

        def to_grey(image: Image) -> Image:
            bright = np.clip(linear(image) @ _LUMINANCE, 0, 1) ** power
            values = np.stack([bright, bright, bright, np.ones_like(bright)], axis=-1)
            return Image(f"{image.name} to {power:g}", encoded(values, image), srgb=False)

        return self.shelf.derived_texture(texture, f"brightness to {power}", to_grey)

    def _have_equal_mapping(self, first: int, second: int) -> bool:
        a, b = (self.shelf.texture_of(number) for number in (first, second))
        return (a.wrap_s, a.wrap_t, a.transform) == (b.wrap_s, b.wrap_t, b.transform)

    def texture(self, source: Element, is_color: bool) -> int | None:
        """Returns the index of the texture of a plugin; None, with a note, if the plugin is not supported.

        is_color: False for data.
        """
        transform = _uv(source.get("to_uv", _uv_transform_06(source)))
        if source.type == "bitmap":
            return self._bitmap(source, is_color, transform)
        if source.type == "checkerboard":
            dark, light = rgb(source.get("color0", 0.4)), rgb(source.get("color1", 0.2))
            pixels = np.array([[dark, light], [light, dark]], np.float32)
            image = self.shelf.add(Image(f"checkerboard {len(source.values)} {dark} {light}", pixels, srgb=False))
            return self.shelf.texture(image, transform=transform, filter="nearest")
        if source.type in ("scale", "volume") and source.children:
            self._document.ignore(
                Sentence(
                    "mitsuba-texture-wrapper-ignored", "{what} is ignored: the texture inside it is used", what=source.description
                )
            )
            return self.texture(source.children[0], is_color)
        self._document.ignore(
            Sentence(
                "mitsuba-texture-type-unsupported",
                "{what} is not supported: its surface is rendered in one colour",
                what=source.description,
            )
        )
        return None

    def _bitmap(self, source: Element, is_color: bool, transform: UvTransform) -> int | None:
        wanted = str(source.get("filename", ""))
        name = self._document.files.find(wanted, source.file)
        if name is None:
            self.shelf.warn_of_missing(wanted, source.description)
            return None
        is_raw = source.boolean("raw", source.number("gamma", -1.0) == 1.0)  # `gamma` is Mitsuba 0.6's
        if not is_raw and not is_color:
            self._document.ignore(
                Sentence(
                    "mitsuba-texture-decoded-as-colour",
                    "{what}: {name} is decoded as a colour, as in Mitsuba; if it contains numbers or normals, set raw to true",
                    what=source.description,
                    name=name,
                )
            )
        gamma, mode = source.number("gamma", -1.0), str(source.get("wrap_mode", "repeat"))
        if gamma not in (-1.0, 1.0):
            self._document.ignore(
                Sentence(
                    "mitsuba-texture-gamma-ignored",
                    "{what}: its gamma of {gamma} is ignored: the image is decoded according to its format",
                    what=source.description,
                    gamma=f"{gamma:g}",
                )
            )
        if mode not in _WRAPS:
            self._document.ignore(
                Sentence(
                    "mitsuba-wrap-mode-unknown",
                    "{what}: the wrap_mode {mode} is unknown: the image repeats",
                    what=source.description,
                    mode=repr(mode[:40]),
                )
            )
        wrap = _WRAPS.get(mode, "repeat")
        filter: TexelFilter = "nearest" if source.get("filter_type") == "nearest" else "linear"
        return self.shelf.texture(self.shelf.image_file(name, not is_raw), wrap, wrap, 0, transform, (), filter)


def _uv_transform_06(source: Element) -> Matrix:
    """Returns the UV transform of Mitsuba 0.6's texture properties: scale, then offset."""
    found = np.diag([source.number("uscale", 1.0), source.number("vscale", 1.0), 1.0, 1.0])
    found[:2, 3] = source.number("uoffset", 0.0), source.number("voffset", 0.0)
    return found


def _uv(matrix: Any) -> UvTransform:
    """Returns a UV transform from a 3x3 matrix, or from x and y of a 4x4 matrix."""
    if not isinstance(matrix, np.ndarray):
        return IDENTITY_UV_TRANSFORM
    found: Matrix = matrix
    x, y = found[0], found[1]
    last = 2 if np.allclose(found[:2, 3], 0) and not np.allclose(found[:2, 2], 0) else 3
    a, b, c, d, e, f = (float(v) for v in (x[0], x[1], x[last], y[0], y[1], y[last]))
    return a, b, c, d, e, f


def constant_of(source: Element) -> Any:
    """Returns the value or Spectrum of a texture plugin that is constant in space; None for other plugins.

    Raises SceneError if a spectrum is malformed.
    """
    if source.type == "uniform":
        return Spectrum.constant(source.number("value", 1.0))
    if source.type in ("srgb", "rawconstant"):
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
        raise SceneError(
            Sentence("mitsuba-object-invalid", "{file}: {what}: {fault}", file=source.file, what=source.description, fault=error)
        ) from None


def noted_rgb(found: Any, is_light: bool, spectra: list[GivenSpectrum]) -> Vec3:
    """Returns `rgb` of a value, after adding its spectrum to `spectra` if it has one."""
    color = rgb(found, is_light)
    if isinstance(found, Spectrum) and (is_light or np.ptp(found.values) > 0):
        spectra.append((given_light if is_light else given_reflectance)(color, found.at(WAVELENGTHS)))
    return color


def radiance_of(owner: Element, name: str, spectra: list[GivenSpectrum]) -> Vec3:
    """Returns the emission of a light without a surface; white if not set. Raises SceneError if a spectrum is malformed.

    spectra: receives its spectrum.
    """
    child = owner.child(name)
    found = None if child is None else constant_of(child)
    return noted_rgb(owner.get(name, 1.0) if found is None else found, True, spectra)
