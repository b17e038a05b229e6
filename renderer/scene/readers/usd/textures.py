"""Textures of USD shaders: images among the scene's files, UV transforms and channel selection."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.image.tonemap import decode_srgb
from renderer.scene.description import Image, UvTransform, Wrap
from renderer.scene.readers.linear_images import alpha, encoded
from renderer.scene.readers.linear_images import linear as linear_colors
from renderer.scene.readers.usd.layers import Stage
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.readers.usd.sources import Sources
from renderer.scene.textures import IDENTITY_UV_TRANSFORM, TextureShelf
from renderer.scene.udim import atlas_transform, composed_transform, is_tiled, tile_name
from renderer.sentences import Sentence

__all__ = ["CHANNELS", "Images", "TextureInput", "color_space", "composed_transform", "linear"]

_WRAPS: dict[str, Wrap] = {"repeat": "repeat", "mirror": "mirror", "clamp": "clamp", "black": "clamp", "periodic": "repeat"}
CHANNELS = {"r": 0, "g": 1, "b": 2, "a": 3}
F32 = npt.NDArray[np.float32]
Four = tuple[float, float, float, float]
PLAIN: tuple[Four, Four] = (1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class TextureInput:
    """The value that a shader input takes from a texture: `scale * texel + bias`, for one channel or for `rgb`."""

    texture: int
    channel: str = "rgb"
    scale: Four = PLAIN[0]
    bias: Four = PLAIN[1]

    def span(self, channel: str) -> tuple[float, float]:
        """Returns (scale, bias) of one channel of the texture."""
        return self.scale[CHANNELS[channel]], self.bias[CHANNELS[channel]]

    @property
    def is_plain(self) -> bool:
        """True if scale is 1 and bias is 0 in all channels of the texture."""
        return (self.scale, self.bias) == PLAIN


class Images:
    """Finds the images that a stage names, and adds them and their textures to the description."""

    def __init__(self, stage: Stage, sources: Sources, shelf: TextureShelf, notes: Notes) -> None:
        self._stage, self._sources, self.shelf, self._notes = stage, sources, shelf, notes
        self._atlases: dict[tuple[str, str, bool, str], tuple[int, UvTransform] | None] = {}

    def asset_path(self, attribute: Any, time: Any) -> tuple[str, str] | None:
        """Returns the asset path in an attribute and the file whose layer sets it; None if the attribute is empty."""
        path = attribute.Get(time) if attribute else None
        named = getattr(path, "path", path)  # Arnold's nodes store a string
        if not named or not isinstance(named, str):
            return None
        for spec in attribute.GetPropertyStack(time):
            if spec.HasInfo("default") or spec.HasInfo("timeSamples"):
                return named, self._stage.file_of(spec.layer)
        return None

    def find(
        self, attribute: Any, user: str, srgb: bool, time: Any, is_environment: bool = False, space: str = ""
    ) -> tuple[int, UvTransform] | None:
        """Returns the index of the image that an attribute names, and the image's UV transform.

        Returns None, with a warning, if the image is missing. user: the object named in the warning. srgb: whether the image is
        sRGB-encoded. is_environment: whether it is an environment image. space: as of TextureColors.encoding.
        """
        named = self.asset_path(attribute, time)
        if named is None:
            return None
        reference, beside = named
        if is_tiled(reference):
            return self._atlas(reference, beside, user, srgb, space)
        name = self._sources.find(reference, beside)
        if name is None:
            self.shelf.warn_of_missing(reference, user)
            return None
        if is_environment:
            found = self.shelf.environment_file(name, lambda: self._sources.read(name), space)
        else:
            found = self._image(name, srgb, space)
        return None if found is None else (found, IDENTITY_UV_TRANSFORM)

    def file(self, attribute: Any, time: Any) -> tuple[str, Callable[[], bytes]] | None:
        """Returns the name of the file that an attribute names, and a function that reads the file; None if it is missing."""
        named = self.asset_path(attribute, time)
        name = None if named is None else self._sources.find(*named)
        return None if name is None else (name, lambda: self._sources.read(name))

    def texture(self, image: int, wraps: tuple[str, str], uv_set: int, transform: UvTransform, user: str) -> int | None:
        """Returns the index of a texture of an image; None if the texture cannot be added. user: the material named in notes."""
        if "black" in wraps:
            self._notes.add(
                Sentence("usd-texture-border-clamped", "Textures with the wrap mode black are clamped at their edges"),
                user,
            )
        wrap_s, wrap_t = (_WRAPS.get(wrap, "repeat") for wrap in wraps)
        return self.shelf.texture(image, wrap_s, wrap_t, uv_set, transform)

    def _image(self, name: str, srgb: bool, space: str) -> int | None:
        if name.endswith("]"):
            return self.shelf.image_file(name, srgb, space, lambda: self._sources.read(name))
        return self.shelf.image_file(name, srgb, space)

    def _atlas(self, reference: str, beside: str, user: str, srgb: bool, space: str) -> tuple[int, UvTransform] | None:
        """Combines the tiles of a UDIM texture in one image; returns the image's index and the UV transform to it.

        Returns None if there are no tiles.
        """
        key = (reference, beside, srgb, space)
        if key not in self._atlases:
            tiles = self._sources.tiles(reference, beside)
            if not tiles:
                self.shelf.warn_of_missing(tile_name(reference, 1001), user)
                self._atlases[key] = None
                return None
            image = self.shelf.tiles(reference, tiles, self._sources.read, srgb, space)
            self._atlases[key] = None if image is None else (image, atlas_transform(tiles))
        return self._atlases[key]


def color_space(attribute: Any) -> str:
    """Returns the colour space that the metadata of an attribute names; an empty text for none or `auto`."""
    space = str(attribute.GetColorSpace()) if attribute and attribute.HasColorSpace() else ""
    return "" if space.lower() == "auto" else space


def transform_2d(scale: tuple[float, float], degrees: float, translation: tuple[float, float]) -> UvTransform:
    """Returns a UsdTransform2d, defined for v upwards, as a UV transform for v downwards.

    UsdTransform2d applies the scale, then the counter-clockwise rotation, then the translation.
    """
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    (sx, sy), (x, y) = scale, translation
    a, b, c, d = cosine * sx, -sine * sy, sine * sx, cosine * sy
    # s' = a s + b t + x, t' = c s + d t + y, with v = 1 - t.
    return a, -b, x + b, -c, d, 1 - y - d


def linear(image: Image) -> F32:
    """Returns (h, w, 4) linear RGBA values of an image."""
    pixels = image.pixels
    values = np.ones((*pixels.shape[:2], 4), np.float32)
    if pixels.dtype == np.uint16:
        values[..., :3], values[..., 3] = linear_colors(image), alpha(image)
    elif pixels.dtype == np.uint8:
        level = np.arange(256, dtype=np.float32) / 255
        values[..., :3] = (decode_srgb(level) if image.srgb else level)[pixels[..., :3]]
        values[..., 3] = level[pixels[..., 3]]
    else:
        values[..., : pixels.shape[2]] = pixels
    return values


def grey(shelf: TextureShelf, texture_input: TextureInput) -> int | None:
    """Returns the index of a grey texture with the values of one channel of a texture input, clamped to 0..1.

    The input's scale and bias are applied to the values, which are stored as linear data.
    """
    channel = "r" if texture_input.channel == "rgb" else texture_input.channel
    scale, bias = texture_input.span(channel)

    def to_grey(image: Image) -> Image:
        values = np.clip(linear(image)[..., CHANNELS[channel]] * scale + bias, 0, 1)
        return Image(f"{image.name} {channel}", encoded(np.dstack([values] * 3 + [np.ones_like(values)]), image), srgb=False)

    return shelf.derived_texture(texture_input.texture, f"{channel} {scale} {bias}", to_grey)


def colored(
    shelf: TextureShelf, texture_input: TextureInput, maximum: float = 1.0
) -> tuple[tuple[float, float, float], int | None]:
    """Returns an RGB factor and the index of a texture; their product is the colour of a texture input.

    maximum: upper limit of the factor; beyond it, the scale is applied to the texture's pixels.
    """
    red, green, blue = texture_input.scale[:3]
    lightest, darkest = max(red, green, blue), min(red, green, blue)
    if texture_input.channel == "rgb" and max(map(abs, texture_input.bias[:3])) < 1e-6 and darkest >= 0 and lightest <= maximum:
        return (red, green, blue), texture_input.texture

    def apply_scale(image: Image) -> Image:
        values = linear(image)
        if texture_input.channel != "rgb":
            scale, bias = texture_input.span(texture_input.channel)
            values[..., :3] = (values[..., CHANNELS[texture_input.channel]] * scale + bias)[..., None]
        else:
            values[..., :3] = values[..., :3] * np.array(texture_input.scale[:3], np.float32) + np.array(
                texture_input.bias[:3], np.float32
            )
        name = f"{image.name} {texture_input.channel}"
        if image.pixels.dtype == np.float32:
            return Image(name, np.clip(values, 0, max(maximum, 1.0)).astype(np.float32), srgb=True)
        return Image(name, encoded(values, image, srgb=True), srgb=True)

    key = f"colour {texture_input.channel} {texture_input.scale} {texture_input.bias}"
    return (1.0, 1.0, 1.0), shelf.derived_texture(texture_input.texture, key, apply_scale)


def normals(shelf: TextureShelf, texture_input: TextureInput) -> tuple[int | None, float]:
    """Returns a normal map in glTF's encoding, and its scale.

    The normal is `2 x - 1` of the texel x unless the input's scale and bias specify otherwise.
    """
    if texture_input.is_plain:
        return texture_input.texture, 1.0
    (x, y, _, _), (_, below, _, _) = texture_input.scale, texture_input.bias
    if y > 0 and below < 0.5:
        return texture_input.texture, x / 2

    def flip_green(image: Image) -> Image:
        pixels = image.pixels.copy()
        pixels[..., 1] = (1 if pixels.dtype == np.float32 else np.iinfo(pixels.dtype).max) - pixels[..., 1]
        return replace(image, name=f"{image.name} with green downwards", pixels=pixels)

    return shelf.derived_texture(texture_input.texture, "green downwards", flip_green), abs(x) / 2
