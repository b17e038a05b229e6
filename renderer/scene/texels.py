"""Packs all textures of a scene into one list of texels."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from renderer.arrays.rows import (
    ABOVE,
    BLEND,
    ENCODING,
    GAIN,
    HALF_16,
    HALF_GAIN,
    LINEAR_8,
    LINEAR_16,
    NEAREST,
    SRGB_8,
    TEXTURE_COLUMNS,
    TRANSFORM_COLUMNS,
    UV_SET,
)
from renderer.errors import SceneError
from renderer.image.tonemap import decode_srgb
from renderer.kernel.light.mean_emission import mean_texels
from renderer.kernel.material.blend import OPERATIONS
from renderer.kernel.material.texture import CLAMP, MIRROR, REPEAT
from renderer.luminance import luminance
from renderer.scene.description import F32, I32, Image, SceneDescription, Texture, UvTransform
from renderer.sentences import Sentence

__all__ = ["MAX_EMISSION", "Texels"]

MAX_EMISSION = 1e9
_PATCHES = 32  # patches per side of the UV square over which the mean of layered textures is taken
_LEAST_MEAN = 1e-4  # above 0, so that a texture with a bright spot between the sampled points is still sampled
_WRAPS = {"repeat": REPEAT, "mirror": MIRROR, "clamp": CLAMP}
_MAX_TEXELS = (1 << 31) - 1
_BAND = 1 << 22  # pixels that are encoded at a time
_MOST_TRANSFORMED = 1e30  # beyond, float32 overflows; such textures are indistinguishable


class Texels:
    """Collects the texels and the table rows of textures. An image used by several textures is stored once.

    A texture with layers is a chain of table rows.
    """

    def __init__(self, description: SceneDescription) -> None:
        self._description = description
        self._rows: list[list[int]] = []
        self._transforms: list[tuple[float, ...]] = []
        self._keys: list[tuple[UvTransform, ...]] = []  # of each row
        self._blocks: list[np.ndarray] = []
        self._count = 0
        self._images: dict[tuple[int, bool], tuple[int, int, float]] = {}  # -> first texel, block, scale
        self._textures: dict[tuple[int, bool], tuple[int, float]] = {}  # -> row, scale
        self._block_of_row: list[int] = []
        self._means: dict[int, float] = {}  # first row of a layered texture -> mean
        self._block_means: dict[tuple[int, int], float] = {}

    def add(self, index: int, light: bool = False) -> tuple[int, float]:
        """Adds a texture and its layers; returns the index of its table row, and the factor to multiply its texels by.

        Texels have 8 bits per channel if the image has, else 16. light: whether the texture is for emission. An HDR image for
        emission is divided by its maximum, which is returned as the factor; with layers, each row stores its own factor, and 1 is
        returned. Other images are clipped at 1, the greatest reflectance. Raises SceneError if there are too many texels.
        """
        if (index, light) not in self._textures:
            texture = self._description.textures[index]
            row = len(self._rows)
            scale = self._append(texture, light)
            if texture.layers:
                self._transforms[row] = (*texture.transform, 1.0, scale, _max_value(light))
                scale = 1.0
            for layer in texture.layers:
                self._rows[-1][ABOVE] = len(self._rows)
                other = self._description.textures[layer.texture]
                gain = self._append(other, light)
                self._rows[-1][BLEND] = OPERATIONS[layer.blend]
                self._transforms[-1] = (*other.transform, layer.strength, gain, _max_value(light))
            self._textures[index, light] = (row, scale)
        return self._textures[index, light]

    def mean_luminance(self, row: int) -> float:
        """Returns the mean linear luminance, 0..1, of the texture in a table row.

        With layers, it is the mean over the UV square 0..1, always above 0.
        """
        if self._rows[row][ABOVE] < 0:
            key = self._block_of_row[row], self._rows[row][ENCODING]
            if key not in self._block_means:
                self._block_means[key] = _mean_luminance(self._blocks[key[0]], key[1])
            return self._block_means[key]
        if row not in self._means:
            uv, triangle = _patches()
            mean = np.zeros((len(triangle), 3), np.float32)
            mean_texels(*self._arrays_of_stack(row), 0, uv, uv, triangle, mean)
            gains = [self._transforms[r][GAIN] for r in self._rows_of_layers(row)]
            self._means[row] = max(float(luminance(mean.mean(axis=0, dtype=np.float64))), _LEAST_MEAN * sum(gains))
        return self._means[row]

    def uses_second_uv_set(self, row: int) -> bool:
        """Returns True if the texture in a table row, or a layer of it, uses the second UV set."""
        return any(self._rows[r][UV_SET] != 0 for r in self._rows_of_layers(row))

    def _append(self, texture: Texture, light: bool) -> float:
        """Adds a table row for one texture without its layers; returns the factor by which its texels must be multiplied.

        light: whether the texture is for emission.
        """
        image = self._description.images[texture.image]
        scaled = light and image.pixels.dtype == np.float32
        first, block, scale = self._place_image(texture.image, scaled)
        height, width = image.pixels.shape[:2]
        wraps = _WRAPS[texture.wrap_s], _WRAPS[texture.wrap_t]
        self._rows.append([first, width, height, *wraps, _encoding(image, scaled), texture.uv_set, -1, 0, 0])
        self._rows[-1][NEAREST] = int(texture.filter == "nearest")
        self._transforms.append((*texture.transform, 1.0, 1.0, 1.0))
        self._keys.append(texture.keys)
        self._block_of_row.append(block)
        return scale

    def _arrays_of_stack(self, row: int) -> tuple[I32, F32, np.ndarray]:
        """Returns the arrays (rows, transforms, texels) of a single texture and its layers, with rows numbered from 0.

        row: the texture's row in the table of all textures. Only the texels that this texture and its layers use are included.
        """
        chain = list(self._rows_of_layers(row))
        blocks = sorted({self._block_of_row[r] for r in chain})
        start = dict(zip(blocks, np.cumsum([0] + [len(self._blocks[b]) for b in blocks]), strict=False))
        rows = np.array([self._rows[r] for r in chain], np.int32)
        rows[:, 0] = [start[self._block_of_row[r]] for r in chain]
        rows[:, ABOVE] = [*range(1, len(chain)), -1]
        transforms = np.clip(np.array([self._transforms[r] for r in chain]), -_MOST_TRANSFORMED, _MOST_TRANSFORMED)
        return rows, transforms.astype(np.float32), np.concatenate([self._blocks[b] for b in blocks])

    def _rows_of_layers(self, row: int) -> Iterator[int]:
        while row >= 0:
            yield row
            row = self._rows[row][ABOVE]

    def arrays(self) -> tuple[I32, F32, np.ndarray]:
        """Returns the texture table's rows, their UV transforms, and the texels (N, 4) uint8, as in CompiledScene."""
        texel = np.concatenate(self._blocks) if self._blocks else np.zeros((0, 4), np.uint8)
        row = np.array(self._rows, np.int32).reshape(-1, TEXTURE_COLUMNS)
        transform = np.clip(np.array(self._transforms, np.float64), -_MOST_TRANSFORMED, _MOST_TRANSFORMED)
        return row, transform.astype(np.float32).reshape(-1, TRANSFORM_COLUMNS), texel

    def keys(self) -> F32:
        """Returns the UV transforms (F, 6) of all table rows at all keys, row by row; empty if all are constant."""
        count = max(map(len, self._keys), default=0)
        still = (transform[:6] for transform in self._transforms)
        over = [keys or (own,) * count for keys, own in zip(self._keys, still, strict=True)]
        found = np.clip(np.array(over, np.float64), -_MOST_TRANSFORMED, _MOST_TRANSFORMED)
        return found.astype(np.float32).reshape(-1, 6)

    def _place_image(self, index: int, scaled: bool) -> tuple[int, int, float]:
        if (index, scaled) not in self._images:
            image = self._description.images[index]
            pixels = image.pixels
            scale = max(float(pixels.max(initial=0)), 1e-6) if scaled else 1.0
            if pixels.dtype != np.uint8:
                pixels = _encode_16_bits(image, scale, _encoding(image, scaled))
            if self._count + pixels.size // 4 > _MAX_TEXELS:
                raise SceneError(
                    Sentence(
                        "scene-textures-too-large", "The scene's textures hold more than 2 billion texels; make them smaller"
                    )
                )
            self._images[index, scaled] = (self._count, len(self._blocks), scale)
            self._blocks.append(np.ascontiguousarray(pixels).reshape(-1, 4))
            self._count += len(self._blocks[-1])
        return self._images[index, scaled]


def _patches() -> tuple[F32, I32]:
    """Returns a triangulated grid over the UV square 0..1: vertices (V, 2) and triangles (n, 3)."""
    side = _PATCHES + 1
    steps = np.arange(side, dtype=np.float32) / np.float32(_PATCHES)
    corner = (np.arange(_PATCHES)[:, None] * side + np.arange(_PATCHES)).reshape(-1, 1)
    halves = [corner + np.array(offsets) for offsets in ((0, 1, side), (1, side + 1, side))]
    return np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2), np.concatenate(halves).astype(np.int32)


def _max_value(light: bool) -> float:
    return MAX_EMISSION if light else 1.0


def _encoding(image: Image, scaled: bool) -> int:
    """Returns the encoding of an image's texels. scaled: whether they are divided by their maximum, as for emission.

    Its precision is constant relative to the value for light and colours, and constant in absolute terms for data.
    """
    if image.pixels.dtype == np.uint8:
        return SRGB_8 if image.srgb else LINEAR_8
    return HALF_16 if image.srgb or scaled else LINEAR_16


def _encode_16_bits(image: Image, scale: float, encoding: int) -> np.ndarray:
    """Returns an image of more than 8 bits, divided by `scale`, as texels of 16 bits: (2 h w, 4) uint8."""
    height, width = image.pixels.shape[:2]
    codes = np.full((height, width, 4), 0 if encoding == HALF_16 else 65535, "<u2")
    step = max(1, _BAND // max(width, 1))
    for top in range(0, height, step):
        rows = slice(top, top + step)
        values = _linear(image.pixels[rows], image.srgb)
        values[..., :3] = np.clip(values[..., :3] / np.float32(scale), 0, 1)
        if encoding == HALF_16:
            codes[rows] = (values * np.float32(HALF_GAIN)).astype("<f2").view("<u2")
        else:
            codes[rows] = np.rint(np.clip(values, 0, 1) * 65535)
    return codes.view(np.uint8).reshape(-1, 4)


def _linear(pixels: np.ndarray, srgb: bool) -> F32:
    """Returns pixels of uint16 or float32 as linear (h, w, 4) float32."""
    values = np.ones((*pixels.shape[:2], 4), np.float32)
    if pixels.dtype == np.uint16:
        values[:] = pixels.astype(np.float32) / np.float32(65535)
        if srgb:
            values[..., :3] = decode_srgb(values[..., :3])
    else:
        values[..., : pixels.shape[2]] = pixels
        np.clip(values[..., 3], 0, 1, out=values[..., 3])
    return values


def _mean_luminance(texels: np.ndarray, encoding: int) -> float:
    if encoding in (LINEAR_16, HALF_16):
        codes = texels.view("<u2" if encoding == LINEAR_16 else "<f2").reshape(-1, 4)
        gain = 65535.0 if encoding == LINEAR_16 else HALF_GAIN
        return float(luminance(codes[:, :3].mean(axis=0, dtype=np.float64) / gain)) if len(codes) else 0.0
    counts = np.stack([np.bincount(texels[:, c], minlength=256) for c in range(3)], axis=1)
    level = np.arange(256) / 255.0
    linear = decode_srgb(level) if encoding == SRGB_8 else level
    return float(luminance((linear @ counts) / max(len(texels), 1)))
