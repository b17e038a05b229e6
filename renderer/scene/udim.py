"""Textures in UDIM tiles: numbered files, from 1001, that are combined into one image."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.image.tonemap import decode_srgb
from renderer.scene.description import UvTransform

__all__ = ["atlas_transform", "composed_transform", "is_tiled", "side_by_side", "tile_name", "tiles_of"]

MAX_ATLAS = 16384  # texels a side
_MARK = re.compile(r"(?i)<UDIM>|%\(UDIM\)d|<UVTILE>|%\(UVTILE\)d")
_FIRST, _LAST = 1001, 1100


def is_tiled(reference: str) -> bool:
    """Returns True if a file name is a tile pattern: paint.<UDIM>.png, or Mari's paint.<UVTILE>.png, for u1_v1 and so on."""
    return _MARK.search(reference) is not None


def tile_name(reference: str, number: int) -> str:
    """Returns the file name of the tile with this number, for the tile pattern `reference`."""
    column, row = (number - _FIRST) % 10 + 1, (number - _FIRST) // 10 + 1
    return _MARK.sub(lambda mark: f"u{column}_v{row}" if "uvtile" in mark[0].lower() else str(number), reference)


def tiles_of(reference: str, find: Callable[[str], str | None]) -> dict[int, str]:
    """Returns tile number (1001 ... 1100) -> file name for the existing tiles of a texture.

    find: returns the file for a name, or None.
    """
    names = ((number, find(tile_name(reference, number))) for number in range(_FIRST, _LAST + 1))
    return {number: name for number, name in names if name is not None}


def side_by_side(tiles: dict[int, npt.NDArray[Any]], srgb: bool) -> npt.NDArray[Any]:
    """Combines tiles into one image, each scaled to the size of the largest; missing tiles are black.

    tiles: tile number -> pixels as in `Image`. srgb: integer pixels are sRGB-encoded.
    """
    across, up = _extent(tiles)
    tiles = _convert_to_common_type(tiles, srgb)
    height, width = (max(pixels.shape[k] for pixels in tiles.values()) for k in (0, 1))
    height, width = min(height, MAX_ATLAS // up), min(width, MAX_ATLAS // across)
    first = next(iter(tiles.values()))
    atlas = np.zeros((up * height, across * width, first.shape[2]), first.dtype)
    for number, pixels in tiles.items():
        row, column = up - 1 - (number - _FIRST) // 10, (number - _FIRST) % 10
        rows = np.arange(height) * pixels.shape[0] // height
        columns = np.arange(width) * pixels.shape[1] // width
        atlas[row * height : (row + 1) * height, column * width : (column + 1) * width] = pixels[rows[:, None], columns]
    return atlas


def atlas_transform(numbers: dict[int, Any]) -> UvTransform:
    """Returns the UV transform from the texture's UVs to the image that `side_by_side` makes of its tiles.

    numbers: a dict whose keys are the tiles' numbers. With v = 1 - t, the transform is u' = u / columns, t' = t / rows.
    """
    across, up = _extent(numbers)
    return 1 / across, 0.0, 0.0, 0.0, 1 / up, 1 - 1 / up


def _extent(numbers: dict[int, Any]) -> tuple[int, int]:
    return max((n - _FIRST) % 10 for n in numbers) + 1, max((n - _FIRST) // 10 for n in numbers) + 1


def _convert_to_common_type(tiles: dict[int, npt.NDArray[Any]], srgb: bool) -> dict[int, npt.NDArray[Any]]:
    """Returns the tiles converted to one dtype and number of channels: the most precise among them."""
    kinds = {pixels.dtype for pixels in tiles.values()}
    if len(kinds) == 1 and len({pixels.shape[2] for pixels in tiles.values()}) == 1:
        return tiles
    if np.dtype(np.float32) in kinds:
        return {number: _linear(pixels, srgb) for number, pixels in tiles.items()}
    wide = np.uint16(257)  # factor from 8-bit to 16-bit codes
    return {number: pixels if pixels.dtype == np.uint16 else pixels.astype(np.uint16) * wide for number, pixels in tiles.items()}


def _linear(pixels: npt.NDArray[Any], srgb: bool) -> npt.NDArray[np.float32]:
    """Returns the pixels as (h, w, 4) linear colours with straight alpha."""
    found = np.ones((*pixels.shape[:2], 4), np.float32)
    found[..., : pixels.shape[2]] = pixels
    if np.issubdtype(pixels.dtype, np.integer):
        found /= np.float32(np.iinfo(pixels.dtype).max)
        if srgb:
            found[..., :3] = decode_srgb(found[..., :3])
    return found


def composed_transform(inner: UvTransform, outer: UvTransform) -> UvTransform:
    """Returns the UV transform that applies `inner` first, then `outer`."""
    a, b = (np.array([*t, 0.0, 0.0, 1.0]).reshape(3, 3) for t in (inner, outer))
    m = b @ a
    return tuple(float(v) for v in m[:2].reshape(-1))  # type: ignore[return-value]
