"""Texture lookups for eight lanes: the vector form of texture.py for static textures without layers.

A lookup takes some two hundred instructions, most of them for addressing and decoding; only texels are read lane by lane.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import ENCODING, LINEAR_16, NEAREST, TEXTURE_COLUMNS, TRANSFORM_COLUMNS
from renderer.jit import device
from renderer.kernel.fetch import columns
from renderer.kernel.material.texture import CLAMP, DECODED, LARGE, MIRROR
from renderer.kernel.polynomial import floor
from renderer.wide.rows import gather_words
from renderer.wide.values import any_of, as_wide, lookup, not_, to_float, to_int, where

__all__ = ["image_colors", "is_rare"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_NO = np.uint32(0)
_NEXT = np.uint32(1)
_CLAMP, _MIRROR = np.uint32(CLAMP), np.uint32(MIRROR)
_NO_LAYER = np.uint32(2**32 - 1)
_CODE = np.uint32(255)
_SIXTEEN_BITS = np.uint32(LINEAR_16)
_BYTE, _TWO_BYTES = np.uint32(8), np.uint32(16)
_CODES = np.uint32(256)


@device
def is_rare(scene, number):
    """Returns a mask of the textures that `image_colors` does not support: those with layers or with 16 bits per channel.

    number: the textures' indices in the scene, u32x8.
    """
    encoding, _, above = columns(scene.texture, number, TEXTURE_COLUMNS, ENCODING, 3)
    return not_((above == _NO_LAYER) & (encoding < _SIXTEEN_BITS))


@device
def _wrapped(i, size, mode):
    """Returns the texel indices, 0 to size - 1, for the integer positions i (int32x8) along one axis of an image.

    mode: the wrap mode for positions outside the image.
    """
    outside = i >= size
    if any_of(outside):
        at, width = to_float(i), to_float(size)  # below 2**24, so only the quotient is rounded
        period = where(mode == _MIRROR, width + width, width)
        rest = at - to_float(floor(at / period)) * period
        rest = where(rest < _ZERO, rest + period, where(rest >= period, rest - period, rest))
        rest = where((mode == _MIRROR) & (rest >= width), period - _ONE - rest, rest)
        rest = where(mode == _CLAMP, min(max(at, _ZERO), width - _ONE), rest)
        i = where(outside, to_int(rest), i)
    return i


@device
def _decoded(texel, place, decoding):
    codes = gather_words(texel, place)
    r, g, b = codes & _CODE, (codes >> _BYTE) & _CODE, (codes >> _TWO_BYTES) & _CODE
    return lookup(DECODED, r + decoding), lookup(DECODED, g + decoding), lookup(DECODED, b + decoding)


@device
def _mix(a, b, t):
    return a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])


@device
def image_colors(scene, number, uv, uv1):
    """Returns the linear RGB, 0 to 1, of eight textures, each at its own coordinates.

    number: u32x8. Each texture uses either uv or uv1 (two f32x8 each), as its table row specifies.
    """
    first, width, height, by_x, by_y, srgb, second = columns(scene.texture, number, TEXTURE_COLUMNS, 0, 7)
    nearest = columns(scene.texture, number, TEXTURE_COLUMNS, NEAREST, 1)[0] != _NO
    m = columns(scene.texture_transform, number, TRANSFORM_COLUMNS, 0, 6)
    u, v = where(second != _NO, uv1[0], uv[0]), where(second != _NO, uv1[1], uv[1])
    x = (m[0] * u + m[1] * v + m[2]) * to_float(width)
    y = (m[3] * u + m[4] * v + m[5]) * to_float(height)
    near = (abs(x) < LARGE) & (abs(y) < LARGE)
    x, y = where(near, x, _HALF), where(near, y, _HALF)
    x, y = where(nearest, to_float(floor(x)), x - _HALF), where(nearest, to_float(floor(y)), y - _HALF)
    left, upper = floor(x), floor(y)
    s, t = x - to_float(left), y - to_float(upper)
    x0, x1 = _wrapped(left, width, by_x), _wrapped(left + _NEXT, width, by_x)
    y0 = first + width * _wrapped(upper, height, by_y)
    y1 = first + width * _wrapped(upper + _NEXT, height, by_y)
    decoding = where(srgb != _NO, as_wide(_CODES, x), _NO)
    texel = scene.texel
    above = _mix(_decoded(texel, y0 + x0, decoding), _decoded(texel, y0 + x1, decoding), s)
    below = _mix(_decoded(texel, y1 + x0, decoding), _decoded(texel, y1 + x1, decoding), s)
    return _mix(above, below, t)
