"""Bakes a formula of several textures into one texture."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from renderer.image.tonemap import encode_srgb
from renderer.scene.description import Image, Texture
from renderer.scene.readers.image_baking import grid, looked_up
from renderer.scene.readers.usd.textures import CHANNELS, TextureInput, linear
from renderer.scene.textures import IDENTITY_UV_TRANSFORM, TextureShelf

__all__ = ["baked", "span_of"]

MAX_SIDE = 4096
_MOST, _NEAR = 1e9, 1e-6
_ROWS = 1 << 18  # texels computed at a time
F64 = npt.NDArray[np.float64]
Formula = Callable[[list[F64]], F64]


def baked(
    shelf: TextureShelf, texture_input: Sequence[TextureInput], what: str, formula: Formula, has_alpha: bool
) -> TextureInput | None:
    """Returns a texture of the (h, w, 4) values of a formula of other textures; None if their UV mappings differ.

    what: key that distinguishes formulas of the same textures. The mappings agree if all textures use the same UV set and
    either the same transform and wrap modes, or transforms that repeat with the unit square.
    """
    textures = [shelf.texture_of(one.texture) for one in texture_input]
    frame = textures[0]
    if all(_has_equal_mapping(texture, frame) for texture in textures):
        textures = [replace(texture, transform=IDENTITY_UV_TRANSFORM) for texture in textures]
    elif all(texture.uv_set == frame.uv_set and _repeats(texture) for texture in textures):
        frame = replace(frame, transform=IDENTITY_UV_TRANSFORM)
    else:
        return None

    images = [shelf.image_of(one.texture) for one in texture_input]

    def bake() -> Image:
        width, height = size = _size(images, textures)
        each = [_values(*given, size) for given in zip(images, textures, texture_input, strict=True)]
        rows = max(_ROWS // width, 1)
        name = f"{images[0].name} with others"

        def bands() -> Iterator[tuple[slice, npt.NDArray[np.float32]]]:
            for first in range(0, height, rows):
                at = slice(first, min(first + rows, height))
                found = np.broadcast_to(formula([of(at) for of in each]), (at.stop - first, width, 4))
                yield at, np.nan_to_num(found, nan=0.0, posinf=_MOST, neginf=-_MOST).astype(np.float32)

        is_fine = any(image.pixels.dtype != np.uint8 for image in images)
        most_code = 65535.0 if is_fine else 255.0
        codes = np.full((height, width, 4), most_code, np.uint16 if is_fine else np.uint8)
        for at, values in bands():
            if float(values[..., :3].min()) < -_NEAR or float(values[..., :3].max()) > 1 + _NEAR:
                break
            codes[at, :, :3] = np.rint(encode_srgb(np.clip(values[..., :3], 0, 1)) * most_code)
            if has_alpha:
                codes[at, :, 3] = np.rint(np.clip(values[..., 3], 0, 1) * most_code)
        else:
            return Image(name, codes, True)
        channels = 4 if has_alpha else 3
        lights = np.empty((height, width, channels), np.float32)  # values outside 0..1 remain floats
        for at, values in bands():
            lights[at] = values[..., :channels]
        return Image(name, lights, True)

    found = shelf.calculated(f"{what} of {[*zip(texture_input, textures, strict=True)]}", images, bake)
    texture = shelf.texture(found, frame.wrap_s, frame.wrap_t, frame.uv_set, frame.transform, filter=frame.filter)
    return None if texture is None else TextureInput(texture)


def span_of(shelf: TextureShelf, texture_input: TextureInput) -> tuple[float, float]:
    """Returns (minimum, maximum) of the values that the image's texels can have; (0, 1) for images of integers."""
    pixels = shelf.image_of(texture_input.texture).pixels
    return (0.0, 1.0) if pixels.dtype != np.float32 else (float(pixels.min(initial=0)), float(pixels.max(initial=1)))


def _has_equal_mapping(one: Texture, other: Texture) -> bool:
    return replace(one, image=other.image, filter=other.filter) == other


def _repeats(texture: Texture) -> bool:
    a, b, _, c, d, _ = texture.transform
    is_whole = all(abs(each - round(each)) < 1e-6 for each in (a, b, c, d))
    return is_whole and texture.wrap_s == texture.wrap_t == "repeat"


def _size(images: list[Image], textures: list[Texture]) -> tuple[int, int]:
    """Returns (width, height) with the texel density of the finest image after its UV transform, each at most MAX_SIDE."""
    sizes = []
    for image, texture in zip(images, textures, strict=True):
        height, width = image.pixels.shape[:2]
        a, b, _, c, d, _ = map(abs, texture.transform)
        sizes.append((max(a * width, c * height), max(b * width, d * height)))
    across, down = (int(min(max(size[k] for size in sizes), MAX_SIDE)) for k in (0, 1))
    return max(across, 1), max(down, 1)


def _values(image: Image, texture: Texture, texture_input: TextureInput, size: tuple[int, int]) -> Callable[[slice], F64]:
    """Returns a function that evaluates a texture input for a slice of rows of an image of the given size."""
    width, height = size
    is_as_it_is = image.pixels.shape[:2] == (height, width) and texture.transform == IDENTITY_UV_TRANSFORM
    whole = None if is_as_it_is else linear(image)

    def values_of_rows(rows: slice) -> F64:
        if whole is None:
            own = linear(replace(image, pixels=image.pixels[rows])).astype(np.float64)
        else:
            own = looked_up(texture, whole, grid(size, rows.start, rows.stop - rows.start))
        if texture_input.channel == "rgb":
            return np.asarray(own * np.array(texture_input.scale) + np.array(texture_input.bias))
        scale, bias = texture_input.span(texture_input.channel)
        return np.asarray(own[..., CHANNELS[texture_input.channel], None] * scale + bias)

    return values_of_rows
