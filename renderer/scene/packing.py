"""Materials as rows of numbers, and all textures as one list of texels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.errors import SceneError
from renderer.image.tonemap import encode_srgb
from renderer.kernel.material import DIFFUSE, GLASS, METALLIC_ROUGHNESS, MIRROR
from renderer.kernel.texture import CLAMP, REPEAT
from renderer.kernel.texture import MIRROR as MIRRORED
from renderer.scene.description import F32, I32, SceneDescription
from renderer.scene.lights import luminance

__all__ = ["Packed", "pack"]

_KINDS = {"diffuse": DIFFUSE, "mirror": MIRROR, "glass": GLASS, "metallic_roughness": METALLIC_ROUGHNESS}
_WRAPS = {"repeat": REPEAT, "mirror": MIRRORED, "clamp": CLAMP}
_MAX_TEXELS = (1 << 31) - 1
_MAX_EMISSION = 1e9


class Packed(NamedTuple):
    """As in CompiledScene, and each material's mean emitted luminance, texture included, of both sides where both shine."""

    material_kind: I32
    material: F32
    material_texture: I32
    texture: I32
    texel: np.ndarray
    emitted: np.ndarray  # (M,) float64


class _Texels:
    """Collects texels; an image used by several textures is kept once."""

    def __init__(self, description: SceneDescription) -> None:
        self._description = description
        self.rows: list[list[int]] = []
        self.blocks: list[np.ndarray] = []
        self._count = 0
        self._images: dict[tuple[int, bool], tuple[int, int, float]] = {}  # to first texel, block, scale
        self._textures: dict[tuple[int, bool], tuple[int, float]] = {}  # to row, scale
        self._block_of_row: list[int] = []

    def add(self, index: int, bright: bool = False) -> tuple[int, float]:
        """The row of a texture, and what its texels are to be multiplied by.

        Texels have 8 bits. An HDR image shines through `bright` textures undimmed: it is divided by its maximum, which is
        returned. In others it is clipped at 1, for no surface reflects more.
        """
        if (index, bright) not in self._textures:
            texture = self._description.textures[index]
            image = self._description.images[texture.image]
            floats = image.pixels.dtype != np.uint8
            first, block, scale = self._place(texture.image, bright and floats)
            height, width = image.pixels.shape[:2]
            srgb = image.srgb or floats
            self.rows.append([first, width, height, _WRAPS[texture.wrap_s], _WRAPS[texture.wrap_t], int(srgb)])
            self._block_of_row.append(block)
            self._textures[index, bright] = (len(self.rows) - 1, scale)
        return self._textures[index, bright]

    def mean_luminance(self, row: int) -> float:
        """The mean linear luminance of a row's texels, 0..1."""
        return _mean_luminance(self.blocks[self._block_of_row[row]], srgb=bool(self.rows[row][5]))

    def _place(self, index: int, scaled: bool) -> tuple[int, int, float]:
        if (index, scaled) not in self._images:
            pixels = self._description.images[index].pixels
            scale = max(float(pixels.max(initial=0)), 1e-6) if scaled else 1.0
            if pixels.dtype != np.uint8:
                pixels = _to_rgba8(pixels / np.float32(scale))
            if self._count + pixels.shape[0] * pixels.shape[1] > _MAX_TEXELS:
                raise SceneError("The scene's textures hold more than 2 billion texels; make them smaller")
            self._images[index, scaled] = (self._count, len(self.blocks), scale)
            self.blocks.append(np.ascontiguousarray(pixels).reshape(-1, 4))
            self._count += len(self.blocks[-1])
        return self._images[index, scaled]


def pack(description: SceneDescription) -> Packed:
    """The materials and the textures that they use. Raises SceneError where the texels are too many."""
    texels = _Texels(description)
    count = len(description.materials)
    kinds = np.zeros(count, np.int32)
    rows = np.zeros((count, 10), np.float32)
    textures = np.full((count, 3), -1, np.int32)
    emitted = np.zeros(count)
    for i, m in enumerate(description.materials):
        kinds[i] = _KINDS[m.kind]
        emission = np.array(m.emission, np.float64)
        emitted[i] = luminance(emission)
        if m.base_color_texture is not None:
            textures[i, 0] = texels.add(m.base_color_texture)[0]
        if m.emission_texture is not None and emitted[i] > 0:
            row, scale = texels.add(m.emission_texture, bright=True)
            textures[i, 1] = row
            emission = np.minimum(emission * scale, _MAX_EMISSION)
            emitted[i] *= scale * texels.mean_luminance(row)
        if m.metallic_roughness_texture is not None:
            textures[i, 2] = texels.add(m.metallic_roughness_texture)[0]
        if m.double_sided:
            emitted[i] *= 2
        rows[i] = (*m.base_color, *emission, m.metallic, m.roughness, m.ior, float(m.double_sided))
    texel = np.concatenate(texels.blocks) if texels.blocks else np.zeros((0, 4), np.uint8)
    return Packed(kinds, rows, textures, np.array(texels.rows, np.int32).reshape(-1, 6), texel, emitted)


def _to_rgba8(rgb: np.ndarray) -> np.ndarray:
    encoded = (encode_srgb(np.clip(rgb, 0, 1)) * 255 + 0.5).astype(np.uint8)
    return np.concatenate([encoded, np.full((*encoded.shape[:2], 1), 255, np.uint8)], axis=2)


def _mean_luminance(texels: np.ndarray, srgb: bool) -> float:
    counts = np.stack([np.bincount(texels[:, c], minlength=256) for c in range(3)], axis=1)
    level = np.arange(256) / 255.0
    linear = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4) if srgb else level
    return float(luminance((linear @ counts) / max(len(texels), 1)))
