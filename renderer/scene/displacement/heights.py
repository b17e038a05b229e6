"""Looks heights up in a texture, as the kernel looks colours up: bilinearly or by the nearest texel, in float32."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, Image, Texture
from renderer.scene.readers.linear_images import linear

__all__ = ["height_lookup"]

I64 = npt.NDArray[np.int64]

_CHUNK = 1 << 19
_LARGEST = 1e6  # in texels, as the kernel's


def height_lookup(texture: Texture, image: Image) -> Callable[[F32], F32]:
    """Returns a function that returns the values (N,) of the texture's red channel at UVs (N, 2). Layers are not looked up."""
    values = np.ascontiguousarray(linear(image)[..., 0])

    def look_up(uv: F32) -> F32:
        found = np.empty(len(uv), np.float32)
        for at in range(0, len(uv), _CHUNK):
            found[at : at + _CHUNK] = _values(values, texture, uv[at : at + _CHUNK])
        return found

    return look_up


def _values(values: F32, texture: Texture, uv: F32) -> F32:
    height, width = values.shape
    m = np.array(texture.transform, np.float32)
    x = (m[0] * uv[:, 0] + m[1] * uv[:, 1] + m[2]) * np.float32(width)
    y = (m[3] * uv[:, 0] + m[4] * uv[:, 1] + m[5]) * np.float32(height)
    is_far = ~((np.abs(x) < _LARGEST) & (np.abs(y) < _LARGEST))
    x, y = (np.where(is_far, np.float32(0.5), each) for each in (x, y))
    x, y = (np.floor(each) if texture.filter == "nearest" else each - np.float32(0.5) for each in (x, y))
    left, upper = np.floor(x), np.floor(y)
    s, t = x - left, y - upper
    x0, x1 = (_wrapped(left.astype(np.int64) + k, width, texture.wrap_s) for k in (0, 1))
    y0, y1 = (_wrapped(upper.astype(np.int64) + k, height, texture.wrap_t) for k in (0, 1))
    above = values[y0, x0] + s * (values[y0, x1] - values[y0, x0])
    below = values[y1, x0] + s * (values[y1, x1] - values[y1, x0])
    return np.asarray(above + t * (below - above), np.float32)


def _wrapped(i: I64, size: int, wrap: str) -> I64:
    if wrap == "clamp":
        return np.clip(i, 0, size - 1)
    if wrap == "repeat":
        return i % size
    i = i % (2 * size)
    return np.where(i < size, i, 2 * size - 1 - i)
