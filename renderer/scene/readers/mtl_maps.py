"""Textures of MTL materials: map statements with options, decals, and maps combined into one image."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from renderer.image.tonemap import decode_srgb, encode_srgb
from renderer.scene.description import Image, TextureLayer, UvTransform, Vec3, Wrap
from renderer.scene.readers.linear_images import Codes, alpha, encoded, integer_codes, linear, white_value, with_equal_depth
from renderer.scene.textures import IDENTITY_UV_TRANSFORM, TextureShelf
from renderer.sentences import Sentence

__all__ = [
    "Map",
    "as_alpha",
    "holds_normals",
    "inverted",
    "parse_map",
    "with_decal",
    "with_opacity",
    "with_roughness_and_metal",
]

# Number of words after each option of a map statement; the rest of the line is the file name.
_OPTIONS = {
    "-blendu": 1,
    "-blendv": 1,
    "-boost": 1,
    "-cc": 1,
    "-clamp": 1,
    "-imfchan": 1,
    "-bm": 1,
    "-texres": 1,
    "-type": 1,
}

_SEVERAL = ("-mm", "-o", "-s", "-t")
_COMMENT = re.compile(r"(?:^|\s)#")
_OPTION_BEHIND = re.compile(rf"\s(?=(?:{'|'.join(map(re.escape, (*_OPTIONS, *_SEVERAL)))})\s)", re.IGNORECASE)
_BEHIND = re.compile(rf"{_COMMENT.pattern}|{_OPTION_BEHIND.pattern}", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")
_CHANNELS = {"r": 0, "g": 1, "b": 2, "m": 3}
_MAX_RADIANCE = 1e9  # radiance


class Map(NamedTuple):
    """A map statement: the file that it names, and its options."""

    file: str
    wrap: Wrap = "repeat"
    transform: UvTransform = IDENTITY_UV_TRANSFORM  # of UVs from the image's upper left corner
    strength: float = 1.0  # -bm
    span: tuple[float, float] = (0.0, 1.0)  # -mm: base and gain; a value x means base + gain x
    channel: str = ""  # -imfchan: r, g, b, m (alpha), l or z
    unread: tuple[str, ...] = ()  # options that affect the image but are unsupported

    def find(self, shelf: TextureShelf, beside: str, user: str, srgb: bool = False) -> int | None:
        """Returns the index of the map's texture, with its options applied; None, with a warning, if the image is missing.

        beside: name of the MTL file; user: the material named in warnings; srgb: whether the image is sRGB-encoded.
        """
        found = shelf.find(self.file, beside, user, srgb, self.wrap, self.transform)
        if self.unread:
            shelf.warn_of_surface(
                Sentence(
                    "mtl-map-options-dropped",
                    "{user}: not supported and left out: the options {options} of {file}.",
                    user=user,
                    options=[*self.unread],
                    file=self.file,
                )
            )
        if self.channel in _CHANNELS:
            found = shelf.derived_texture(found, f"channel {self.channel}", lambda i: _channel(i, self.channel))
        return (
            found
            if self.span == (0.0, 1.0)
            else shelf.derived_texture(found, f"span {self.span}", lambda i: _with_base_and_gain(i, self.span))
        )


def parse_map(value: str, is_file: Callable[[str], bool] = lambda _: True) -> Map | None:
    """Parses a map statement without its keyword. Returns None if it names no file.

    Options precede the file name, as in the specification, or follow it, as some programs write; a comment may follow.
    is_file: whether a file of this name exists, for names that contain what looks like an option or a comment.
    """
    said = _Options()
    words = value.split()
    at = said.parse_options(words, 0)
    if at >= len(words):
        return None
    rest = value.split(None, at)[at].strip()
    if not _BEHIND.search(rest) or is_file(rest):
        return said.map(rest)
    name = without = _COMMENT.split(rest, maxsplit=1)[0].strip()
    if not is_file(without) and (behind := _OPTION_BEHIND.search(without)):
        name = without[: behind.start()].strip()
        words = without[behind.start() :].split()
        end = said.parse_options(words, 0)
        if end < len(words):
            name = without  # more words follow: the whole is a file name
    return said.map(name) if name else None


class _Options:
    """The options of a map statement, parsed from its words."""

    def __init__(self) -> None:
        self.scale, self.offset = [1.0, 1.0], [0.0, 0.0]
        self.wrap: Wrap = "repeat"
        self.strength, self.span, self.channel = 1.0, (0.0, 1.0), ""
        self.unread: list[str] = []

    def parse_options(self, words: list[str], first: int) -> int:
        """Parses the options that begin at an index of `words`; returns the index after the last option."""
        while first < len(words) and words[first].lower() in (*_OPTIONS, *_SEVERAL):
            option = words[first].lower()
            first += 1
            if option in _OPTIONS:
                self._parse_option(option, words[first : first + 1])
                first += 1
                continue
            # At most two or three numbers.
            last, found = first + (2 if option == "-mm" else 3), list[float]()
            while first < min(last, len(words)) and _is_number(words[first]):
                found.append(_number(words[first]))
                first += 1
            if option == "-mm" and len(found) == 2:
                self.span = found[0], found[1]
            elif option in ("-s", "-o"):
                for axis, number in enumerate(found[:2]):
                    (self.scale if option == "-s" else self.offset)[axis] = number
            elif any(found):  # turbulence
                self.unread.append(option)
        return first

    def _parse_option(self, option: str, following: list[str]) -> None:
        word = following[0].lower() if following else ""
        if option == "-clamp" and word == "on":
            self.wrap = "clamp"
        elif option == "-bm" and _is_number(word):
            self.strength = _number(word)
        elif option == "-imfchan":
            self.channel = word
            if word == "z":
                self.unread.append("-imfchan z")
        elif option == "-cc" and word == "on":
            self.unread.append("-cc on")

    def map(self, file: str) -> Map:
        # Scale and offset hold for v counted upwards: v' = s v + o is 1 - v' = s (1 - v) + (1 - s - o).
        (s, t), (u, v) = self.scale, self.offset
        return Map(file, self.wrap, (s, 0.0, u, 0.0, t, 1.0 - t - v), self.strength, self.span, self.channel, tuple(self.unread))


def _number(word: str) -> float:
    return float(_DECIMAL_COMMA.sub(".", word))


def _is_number(word: str) -> bool:
    try:
        return bool(np.isfinite(_number(word)))
    except ValueError:
        return False


def holds_normals(image: Image) -> bool:
    """Returns True if an image looks like a normal map: mostly blue, with mean red and green near 0.5. Height maps are grey."""
    mean = image.pixels[..., :3].reshape(-1, 3).mean(axis=0, dtype=np.float64) / white_value(image.pixels)
    return bool(mean[2] > 0.65 and abs(mean[0] - 0.5) < 0.15 and abs(mean[1] - 0.5) < 0.15)


def with_decal(shelf: TextureShelf, texture: int | None, decal: int, color: Vec3) -> int | None:
    """Returns a texture blended with a colour by a decal: texture * decal + colour * (1 - decal), with the decal's UV lookup.

    Returns the texture unchanged if the decal cannot be read. Source: the specification of `decal`.
    """
    srgb = encode_srgb(np.array(color, np.float32))

    def draw_decal(image: Image) -> Image:
        shown = _alpha_or_grey(image)
        painted = np.rint(srgb * white_value(shown)).astype(shown.dtype)
        hidden = np.iinfo(shown.dtype).max - shown
        return Image(f"{image.name} as a decal", np.dstack([np.broadcast_to(painted, (*hidden.shape, 3)), hidden]))

    over = shelf.derived_texture(decal, f"decal on {color}", draw_decal)
    return texture if over is None else shelf.with_layers(texture, (TextureLayer(over),))


def with_opacity(shelf: TextureShelf, color: int | None, opacity: int) -> int | None:
    """Returns the colour of one texture (None: white) with the opacity of another: its alpha, or its grey if it is opaque."""

    def add_opacity(image: Image, mask: Image) -> Image:
        if color is not None and image.pixels.dtype == np.float32:
            shown = _resized(_alpha_or_grey(mask), image.pixels.shape)
            pixels = np.dstack([image.pixels[..., :3], (shown / np.float32(white_value(shown))).astype(np.float32)])
            return Image(f"{image.name} with opacity", pixels, image.srgb)
        own, shown = with_equal_depth(integer_codes(image), _alpha_or_grey(mask))
        pixels = own.copy()
        pixels[..., 3] = _resized(shown, pixels.shape)
        if color is None:
            pixels[..., :3] = np.iinfo(pixels.dtype).max
        return Image(f"{image.name} with opacity", pixels, image.srgb)

    return shelf.combined(opacity if color is None else color, opacity, "colour and opacity", add_opacity)


def with_roughness_and_metal(shelf: TextureShelf, roughness: int | None, metal: int | None) -> int | None:
    """Returns glTF's metallic-roughness texture (green roughness, blue metalness) from two grey textures; 1 for a missing one."""
    if roughness is None and metal is None:
        return None

    def combine(first: Image, second: Image) -> Image:
        base, other = with_equal_depth(integer_codes(first), integer_codes(second))
        pixels = np.full_like(base, np.iinfo(base.dtype).max)
        if roughness is not None:
            pixels[..., 1] = base[..., 0]
        if metal is not None:
            pixels[..., 2] = _resized(other[..., 0], pixels.shape)
        return Image(f"{first.name} as roughness and metal", pixels, srgb=False)

    one, other = (metal if roughness is None else roughness), (roughness if metal is None else metal)
    return shelf.combined(one, other, f"roughness {roughness is not None} metal {metal is not None}", combine)


def as_alpha(shelf: TextureShelf, texture: int | None) -> int | None:
    """Returns a white texture with the alpha of another texture, or with its grey if it is opaque."""

    def to_alpha(image: Image) -> Image:
        grey = _alpha_or_grey(image)
        return Image(
            f"{image.name} as alpha",
            np.dstack([np.full((*grey.shape, 3), np.iinfo(grey.dtype).max, grey.dtype), grey]),
            srgb=False,
        )

    return shelf.derived_texture(texture, "as alpha", to_alpha)


def inverted(shelf: TextureShelf, texture: int | None) -> int | None:
    """Returns a texture of linear values 1 - x, such as roughness from glossiness."""

    def invert(image: Image) -> Image:
        pixels = integer_codes(image).copy()
        pixels[..., :3] = np.iinfo(pixels.dtype).max - pixels[..., :3]
        return Image(f"{image.name} inverted", pixels, srgb=False)

    return shelf.derived_texture(texture, "inverted", invert)


def _channel(image: Image, channel: str) -> Image:
    """Returns one channel of an image as grey; an image without the channel, as float images without alpha, is unchanged."""
    at = _CHANNELS[channel]
    if at >= image.pixels.shape[2]:
        return image
    pixels = image.pixels.copy()
    pixels[..., :3] = image.pixels[..., at, None]
    if pixels.shape[2] == 4:
        pixels[..., 3] = 255
    return Image(f"{image.name} channel {channel}", pixels, image.srgb)


def _with_base_and_gain(image: Image, span: tuple[float, float]) -> Image:
    """Returns an image whose linear values x are replaced by base + gain * x. span: (base, gain)."""
    base, gain = span
    name = f"{image.name} from {base:g} by {gain:g}"
    if image.pixels.dtype == np.float32:
        moved = np.clip(base + gain * image.pixels[..., :3].astype(np.float64), 0, _MAX_RADIANCE).astype(np.float32)
        return Image(name, np.concatenate([moved, image.pixels[..., 3:]], axis=2), image.srgb)
    if image.pixels.dtype == np.uint16:
        moved = np.clip(base + gain * linear(image), 0, 1)
        return Image(name, encoded(np.dstack([moved, alpha(image)]), image, srgb=image.srgb), image.srgb)
    level = np.arange(256) / 255
    moved = np.clip(base + gain * (decode_srgb(level) if image.srgb else level), 0, 1).astype(np.float32)
    table = np.rint((encode_srgb(moved) if image.srgb else moved) * 255).astype(np.uint8)
    pixels = image.pixels.copy()
    pixels[..., :3] = table[pixels[..., :3]]
    return Image(name, pixels, image.srgb)


def _alpha_or_grey(image: Image) -> Codes:
    """Returns the (h, w) alpha of an image, or its grey if it is opaque."""
    pixels = integer_codes(image)
    alphas: Codes = pixels[..., 3]
    if (alphas < np.iinfo(alphas.dtype).max).any():
        return alphas
    grey: Codes = pixels[..., :3].max(axis=2)
    return grey


def _resized(channel: Codes, shape: tuple[int, ...]) -> Codes:
    rows = np.arange(shape[0]) * channel.shape[0] // shape[0]
    columns = np.arange(shape[1]) * channel.shape[1] // shape[1]
    return channel[rows[:, None], columns]
