"""All textures of a scene as one list of texels."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from renderer.arrays.rows import ABOVE, BLEND, GAIN, NEAREST, SRGB, TEXTURE_COLUMNS, TRANSFORM_COLUMNS, UV_SET
from renderer.errors import SceneError
from renderer.image.tonemap import decode_srgb, encode_srgb
from renderer.kernel.light.mean_emission import mean_texels
from renderer.kernel.material.blend import OPERATIONS
from renderer.kernel.material.texture import CLAMP, MIRROR, REPEAT
from renderer.luminance import luminance
from renderer.scene.description import F32, I32, SceneDescription, Texture, UvTransform

__all__ = ["MAX_EMISSION", "Texels"]

MAX_EMISSION = 1e9
_PATCHES = 32  # a side of the square over which a stack's mean is taken
_LEAST_MEAN = 1e-4  # so that a bright spot between the points that are looked at does not go unsampled
_WRAPS = {"repeat": REPEAT, "mirror": MIRROR, "clamp": CLAMP}
_MAX_TEXELS = (1 << 31) - 1
_MOST_TRANSFORMED = 1e30  # beyond, float32 ends; nobody can tell such textures from one another


class Texels:
    """Collects texels; an image used by several textures is kept once. A stack of textures is a chain of rows."""

    def __init__(self, description: SceneDescription) -> None:
        self._description = description
        self._rows: list[list[int]] = []
        self._transforms: list[tuple[float, ...]] = []
        self._keys: list[tuple[UvTransform, ...]] = []  # of each row
        self._blocks: list[np.ndarray] = []
        self._count = 0
        self._images: dict[tuple[int, bool], tuple[int, int, float]] = {}  # to first texel, block, scale
        self._textures: dict[tuple[int, bool], tuple[int, float]] = {}  # to row, scale
        self._block_of_row: list[int] = []
        self._means: dict[int, float] = {}  # of stacks by their first rows
        self._block_means: dict[tuple[int, bool], float] = {}

    def add(self, index: int, light: bool = False) -> tuple[int, float]:
        """The row of a texture, its layers behind it, and what its texels are to be multiplied by.

        Texels have 8 bits. An HDR image of `light` shines undimmed: it is divided by its maximum, which is returned; of a
        stack each row multiplies its own, and 1 is returned. In others it is clipped at 1, for no surface reflects more.
        Raises SceneError where texels are too many.
        """
        if (index, light) not in self._textures:
            texture = self._description.textures[index]
            row = len(self._rows)
            scale = self._append(texture, light)
            if texture.layers:
                self._transforms[row] = (*texture.transform, 1.0, scale, _most(light))
                scale = 1.0
            for layer in texture.layers:
                self._rows[-1][ABOVE] = len(self._rows)
                other = self._description.textures[layer.texture]
                gain = self._append(other, light)
                self._rows[-1][BLEND] = OPERATIONS[layer.blend]
                self._transforms[-1] = (*other.transform, layer.strength, gain, _most(light))
            self._textures[index, light] = (row, scale)
        return self._textures[index, light]

    def mean_luminance(self, row: int) -> float:
        """The mean linear luminance of a row's texels, 0..1; of a stack, over the square 0..1 of UVs and never quite 0."""
        if self._rows[row][ABOVE] < 0:
            key = self._block_of_row[row], bool(self._rows[row][SRGB])
            if key not in self._block_means:
                self._block_means[key] = _mean_luminance(self._blocks[key[0]], srgb=key[1])
            return self._block_means[key]
        if row not in self._means:
            uv, triangle = _patches()
            mean = np.zeros((len(triangle), 3), np.float32)
            mean_texels(*self._alone(row), 0, uv, uv, triangle, mean)
            gains = [self._transforms[r][GAIN] for r in self._chain(row)]
            self._means[row] = max(float(luminance(mean.mean(axis=0, dtype=np.float64))), _LEAST_MEAN * sum(gains))
        return self._means[row]

    def looks_at_second_uvs(self, row: int) -> bool:
        """Whether the row's texture, or a layer of it, is placed by the second set of coordinates."""
        return any(self._rows[r][UV_SET] != 0 for r in self._chain(row))

    def _append(self, texture: Texture, light: bool) -> float:
        """Adds a row for one texture; its texels' scale."""
        image = self._description.images[texture.image]
        floats = image.pixels.dtype != np.uint8
        first, block, scale = self._place(texture.image, light and floats)
        height, width = image.pixels.shape[:2]
        wraps = _WRAPS[texture.wrap_s], _WRAPS[texture.wrap_t]
        self._rows.append([first, width, height, *wraps, int(image.srgb or floats), texture.uv_set, -1, 0, 0])
        self._rows[-1][NEAREST] = int(texture.filter == "nearest")
        self._transforms.append((*texture.transform, 1.0, 1.0, 1.0))
        self._keys.append(texture.keys)
        self._block_of_row.append(block)
        return scale

    def _alone(self, row: int) -> tuple[I32, F32, np.ndarray]:
        """What `arrays` gives, of one stack alone: its rows from 0 on, and no texels but its own."""
        chain = list(self._chain(row))
        blocks = sorted({self._block_of_row[r] for r in chain})
        start = dict(zip(blocks, np.cumsum([0] + [len(self._blocks[b]) for b in blocks]), strict=False))
        rows = np.array([self._rows[r] for r in chain], np.int32)
        rows[:, 0] = [start[self._block_of_row[r]] for r in chain]
        rows[:, ABOVE] = [*range(1, len(chain)), -1]
        transforms = np.clip(np.array([self._transforms[r] for r in chain]), -_MOST_TRANSFORMED, _MOST_TRANSFORMED)
        return rows, transforms.astype(np.float32), np.concatenate([self._blocks[b] for b in blocks])

    def _chain(self, row: int) -> Iterator[int]:
        while row >= 0:
            yield row
            row = self._rows[row][ABOVE]

    def arrays(self) -> tuple[I32, F32, np.ndarray]:
        """The texture rows, their transforms, and the texels (N, 4) uint8, as in CompiledScene."""
        texel = np.concatenate(self._blocks) if self._blocks else np.zeros((0, 4), np.uint8)
        row = np.array(self._rows, np.int32).reshape(-1, TEXTURE_COLUMNS)
        transform = np.clip(np.array(self._transforms, np.float64), -_MOST_TRANSFORMED, _MOST_TRANSFORMED)
        return row, transform.astype(np.float32).reshape(-1, TRANSFORM_COLUMNS), texel

    def keys(self) -> F32:
        """(F, 6) the matrices of the rows, those of each at all keys one behind the other; none where all stay."""
        count = max(map(len, self._keys), default=0)
        still = (transform[:6] for transform in self._transforms)
        over = [keys or (own,) * count for keys, own in zip(self._keys, still, strict=True)]
        found = np.clip(np.array(over, np.float64), -_MOST_TRANSFORMED, _MOST_TRANSFORMED)
        return found.astype(np.float32).reshape(-1, 6)

    def _place(self, index: int, scaled: bool) -> tuple[int, int, float]:
        if (index, scaled) not in self._images:
            pixels = self._description.images[index].pixels
            scale = max(float(pixels.max(initial=0)), 1e-6) if scaled else 1.0
            if pixels.dtype != np.uint8:
                pixels = _to_rgba8(pixels / np.float32(scale))
            if self._count + pixels.shape[0] * pixels.shape[1] > _MAX_TEXELS:
                raise SceneError("The scene's textures hold more than 2 billion texels; make them smaller")
            self._images[index, scaled] = (self._count, len(self._blocks), scale)
            self._blocks.append(np.ascontiguousarray(pixels).reshape(-1, 4))
            self._count += len(self._blocks[-1])
        return self._images[index, scaled]


def _patches() -> tuple[F32, I32]:
    """The square 0..1 of UVs (V, 2) in triangles (n, 3)."""
    side = _PATCHES + 1
    steps = np.arange(side, dtype=np.float32) / np.float32(_PATCHES)
    corner = (np.arange(_PATCHES)[:, None] * side + np.arange(_PATCHES)).reshape(-1, 1)
    halves = [corner + np.array(offsets) for offsets in ((0, 1, side), (1, side + 1, side))]
    return np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2), np.concatenate(halves).astype(np.int32)


def _most(light: bool) -> float:
    return MAX_EMISSION if light else 1.0


def _to_rgba8(rgb: np.ndarray) -> np.ndarray:
    encoded = (encode_srgb(np.clip(rgb, 0, 1)) * 255 + 0.5).astype(np.uint8)
    return np.concatenate([encoded, np.full((*encoded.shape[:2], 1), 255, np.uint8)], axis=2)


def _mean_luminance(texels: np.ndarray, srgb: bool) -> float:
    counts = np.stack([np.bincount(texels[:, c], minlength=256) for c in range(3)], axis=1)
    level = np.arange(256) / 255.0
    linear = decode_srgb(level) if srgb else level
    return float(luminance((linear @ counts) / max(len(texels), 1)))
