"""Texture lookups: bilinear between texels, three ways to repeat, sRGB decoded before it is mixed."""

from __future__ import annotations

import numpy as np

from renderer.jit import device, subroutine
from renderer.kernel.polynomial import floor

__all__ = ["CLAMP", "MIRROR", "REPEAT", "lookup", "sample_texture"]

REPEAT, MIRROR, CLAMP = 0, 1, 2

_CODES = np.arange(256) / 255.0
_LINEAR = _CODES.astype(np.float32)  # decoded value of each code
_SRGB = np.where(_CODES <= 0.04045, _CODES / 12.92, ((_CODES + 0.055) / 1.055) ** 2.4).astype(np.float32)  # IEC 61966-2-1
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_HALF = np.float32(0.5)
_LARGE = np.float32(1e6)


@device
def _wrap(i, size, mode):
    """The texel that stands at place i of an endless row."""
    if 0 <= i < size:
        return i
    if mode == CLAMP:
        return min(max(i, 0), size - 1)
    if mode == REPEAT:
        return i % size
    i = i % (2 * size)
    return i if i < size else 2 * size - 1 - i


@device
def _decoded(texel, place, srgb):
    r, g, b, a = texel[place, 0], texel[place, 1], texel[place, 2], texel[place, 3]
    if srgb:
        return _SRGB[r], _SRGB[g], _SRGB[b], _LINEAR[a]
    return _LINEAR[r], _LINEAR[g], _LINEAR[b], _LINEAR[a]


@device
def _mix(a, b, t):
    return a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2]), a[3] + t * (b[3] - a[3])


@subroutine
def lookup(texture, transform, texel, number, u, v):
    """Linear RGBA, 0 ... 1, of texture `number` at (u, v); after its transform, (0, 0) is the image's upper left corner."""
    first = np.int64(texture[number, 0])
    width = np.int64(texture[number, 1])
    height = np.int64(texture[number, 2])
    srgb = texture[number, 5] != 0
    x = (transform[number, 0] * u + transform[number, 1] * v + transform[number, 2]) * np.float32(width) - _HALF
    y = (transform[number, 3] * u + transform[number, 4] * v + transform[number, 5]) * np.float32(height) - _HALF
    if not (abs(x) < _LARGE and abs(y) < _LARGE):  # beyond, float32 has no texels left to mix; also NaN
        x = y = _ZERO
    left = floor(x)
    upper = floor(y)
    s = x - np.float32(left)
    t = y - np.float32(upper)
    x0 = _wrap(left, width, texture[number, 3])
    x1 = _wrap(left + 1, width, texture[number, 3])
    y0 = first + width * _wrap(upper, height, texture[number, 4])
    y1 = first + width * _wrap(upper + 1, height, texture[number, 4])
    above = _mix(_decoded(texel, y0 + x0, srgb), _decoded(texel, y0 + x1, srgb), s)
    below = _mix(_decoded(texel, y1 + x0, srgb), _decoded(texel, y1 + x1, srgb), s)
    return _mix(above, below, t)


@device
def sample_texture(scene, number, uv, uv1):
    """Linear RGBA of texture `number`, which knows whether it looks at the first or at the second coordinates."""
    second = scene.texture[number, 6] != 0
    u = uv1[0] if second else uv[0]
    v = uv1[1] if second else uv[1]
    return lookup(scene.texture, scene.texture_transform, scene.texel, number, u, v)
