"""All textures of a scene as one list of texels."""

from __future__ import annotations

import numpy as np

from renderer.errors import SceneError
from renderer.image.tonemap import encode_srgb
from renderer.kernel.texture import CLAMP, MIRROR, REPEAT
from renderer.scene.description import F32, I32, SceneDescription
from renderer.scene.lights import luminance

__all__ = ["Texels"]

_WRAPS = {"repeat": REPEAT, "mirror": MIRROR, "clamp": CLAMP}
_MAX_TEXELS = (1 << 31) - 1


class Texels:
    """Collects texels; an image used by several textures is kept once."""

    def __init__(self, description: SceneDescription) -> None:
        self._description = description
        self._rows: list[list[int]] = []
        self._transforms: list[tuple[float, ...]] = []
        self._blocks: list[np.ndarray] = []
        self._count = 0
        self._images: dict[tuple[int, bool], tuple[int, int, float]] = {}  # to first texel, block, scale
        self._textures: dict[tuple[int, bool], tuple[int, float]] = {}  # to row, scale
        self._block_of_row: list[int] = []

    def add(self, index: int, bright: bool = False) -> tuple[int, float]:
        """The row of a texture, and what its texels are to be multiplied by.

        Texels have 8 bits. An HDR image shines through `bright` textures undimmed: it is divided by its maximum, which is
        returned. In others it is clipped at 1, for no surface reflects more. Raises SceneError where texels are too many.
        """
        if (index, bright) not in self._textures:
            texture = self._description.textures[index]
            image = self._description.images[texture.image]
            floats = image.pixels.dtype != np.uint8
            first, block, scale = self._place(texture.image, bright and floats)
            height, width = image.pixels.shape[:2]
            wraps = _WRAPS[texture.wrap_s], _WRAPS[texture.wrap_t]
            self._rows.append([first, width, height, *wraps, int(image.srgb or floats), texture.uv_set])
            self._transforms.append(texture.transform)
            self._block_of_row.append(block)
            self._textures[index, bright] = (len(self._rows) - 1, scale)
        return self._textures[index, bright]

    def mean_luminance(self, row: int) -> float:
        """The mean linear luminance of a row's texels, 0..1."""
        return _mean_luminance(self._blocks[self._block_of_row[row]], srgb=bool(self._rows[row][5]))

    def looks_at_second_uvs(self, row: int) -> bool:
        """Whether the row's texture is placed by the second set of coordinates."""
        return self._rows[row][6] != 0

    def arrays(self) -> tuple[I32, F32, np.ndarray]:
        """The texture rows, their transforms, and the texels (N, 4) uint8, as in CompiledScene."""
        texel = np.concatenate(self._blocks) if self._blocks else np.zeros((0, 4), np.uint8)
        return np.array(self._rows, np.int32).reshape(-1, 7), np.array(self._transforms, np.float32).reshape(-1, 6), texel

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


def _to_rgba8(rgb: np.ndarray) -> np.ndarray:
    encoded = (encode_srgb(np.clip(rgb, 0, 1)) * 255 + 0.5).astype(np.uint8)
    return np.concatenate([encoded, np.full((*encoded.shape[:2], 1), 255, np.uint8)], axis=2)


def _mean_luminance(texels: np.ndarray, srgb: bool) -> float:
    counts = np.stack([np.bincount(texels[:, c], minlength=256) for c in range(3)], axis=1)
    level = np.arange(256) / 255.0
    linear = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4) if srgb else level
    return float(luminance((linear @ counts) / max(len(texels), 1)))
