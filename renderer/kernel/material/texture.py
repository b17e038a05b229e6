"""Texture lookups: bilinear or nearest filtering, three wrap modes, sRGB decoding before filtering, and layered textures."""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import ABOVE, BLEND, ENCODING, GAIN, HALF_GAIN, LINEAR_16, MOST, NEAREST, SRGB_8, STRENGTH, UV_SET
from renderer.bvh.motion import step_at
from renderer.jit import device, never_inline, subroutine
from renderer.kernel.material.blend import blended
from renderer.kernel.polynomial import floor

__all__ = ["CLAMP", "DECODED", "LARGE", "MIRROR", "REPEAT", "lookup", "sample_texture"]

REPEAT, MIRROR, CLAMP = 0, 1, 2

_CODES = np.arange(256) / 255.0
_LINEAR = _CODES.astype(np.float32)  # decoded value of each code
_SRGB = np.where(_CODES <= 0.04045, _CODES / 12.92, ((_CODES + 0.055) / 1.055) ** 2.4).astype(np.float32)  # IEC 61966-2-1
DECODED = np.concatenate([_LINEAR, _SRGB])  # both
_HALF = np.float32(0.5)
_CODES_16 = np.float32(1 / 65535)
# A half's bits, shifted to float32's positions, give its value times 2**(15 - 127).
_HALVES = np.float32(2.0**112 / HALF_GAIN)
_UNSIGNED, _TO_MANTISSA = np.int32(0x7FFF), np.int32(13)
LARGE = np.float32(1e6)  # in texels; beyond it float32 has no fraction bits left for filtering


@device
def _wrap(i, size, mode):
    """Returns the texel index in 0 ... size - 1 for position i, wrapped as `mode` determines."""
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


@device
def _code(texel, row, column):
    return np.int32(texel[row, column]) | (np.int32(texel[row, column + 1]) << np.int32(8))


@device
def _decoded_16(texel, first, place, encoding):
    """Returns the linear RGBA of a texel with 16 bits per channel, which occupies two rows of the texel table.

    first: the texture's first row. place: the row at which the texel would be if each texel occupied one row.
    """
    row = first + np.int64(2) * (place - first)
    r, g, b, a = _code(texel, row, 0), _code(texel, row, 2), _code(texel, row + 1, 0), _code(texel, row + 1, 2)
    if encoding == LINEAR_16:
        return np.float32(r) * _CODES_16, np.float32(g) * _CODES_16, np.float32(b) * _CODES_16, np.float32(a) * _CODES_16
    return _from_half(r), _from_half(g), _from_half(b), _from_half(a)


@device
def _from_half(code):
    return np.int32((code & _UNSIGNED) << _TO_MANTISSA).view(np.float32) * _HALVES


@subroutine
def _mixed_16(texel, first, a, b, c, d, s, t, encoding):
    """Returns the bilinear interpolation of four texels with 16 bits per channel.

    Called out of line, since such textures are rare. first: the texture's first row. a, b, c, d: the texels' rows, as `place` of
    `_decoded_16`. s, t: weights of the right and of the lower texels.
    """
    never_inline()
    above = _mix(_decoded_16(texel, first, a, encoding), _decoded_16(texel, first, b, encoding), s)
    below = _mix(_decoded_16(texel, first, c, encoding), _decoded_16(texel, first, d, encoding), s)
    return _mix(above, below, t)


@device
def _placed(transform, keys, number, u, v, time):
    """Returns the image coordinates of (u, v) under the texture's transform at a shutter time; the image spans 0 to 1.

    keys: the transforms at keys while the shutter is open, which are interpolated; None for a scene without motion.
    """
    if keys is not None and time is not None and len(keys) > 0:
        count = len(keys) // len(transform)
        step, share = step_at(time, count)
        k = number * count + step
        return _between(keys, k, 0, share, u, v), _between(keys, k, 3, share, u, v)
    return (
        transform[number, 0] * u + transform[number, 1] * v + transform[number, 2],
        transform[number, 3] * u + transform[number, 4] * v + transform[number, 5],
    )


@device
def _between(keys, k, column, share, u, v):
    """Returns (u, v, 1) times one row (from `column` on) of a texture transform interpolated between keys k and k + 1.

    share: weight of key k + 1.
    """
    a, b, c = keys[k, column], keys[k, column + 1], keys[k, column + 2]
    a += share * (keys[k + 1, column] - a)
    b += share * (keys[k + 1, column + 1] - b)
    c += share * (keys[k + 1, column + 2] - c)
    return a * u + b * v + c


@device
def _look_up_image(texture, transform, texel, number, uv, uv1, keys, time):
    """Returns the linear RGBA, 0 ... 1, of the image of texture `number`, without the layers above it."""
    first = np.int64(texture[number, 0])
    width = np.int64(texture[number, 1])
    height = np.int64(texture[number, 2])
    encoding = texture[number, ENCODING]
    srgb = encoding == SRGB_8
    second = texture[number, UV_SET] != 0
    u = uv1[0] if second else uv[0]
    v = uv1[1] if second else uv[1]
    x, y = _placed(transform, keys, number, u, v, time)
    x *= np.float32(width)
    y *= np.float32(height)
    if not (abs(x) < LARGE and abs(y) < LARGE):  # also NaN
        x = y = _HALF
    if texture[number, NEAREST] != 0:  # the interpolation below then uses one texel
        x = np.float32(floor(x))
        y = np.float32(floor(y))
    else:
        x -= _HALF
        y -= _HALF
    left = floor(x)
    upper = floor(y)
    s = x - np.float32(left)
    t = y - np.float32(upper)
    x0 = _wrap(left, width, texture[number, 3])
    x1 = _wrap(left + 1, width, texture[number, 3])
    y0 = first + width * _wrap(upper, height, texture[number, 4])
    y1 = first + width * _wrap(upper + 1, height, texture[number, 4])
    if encoding >= LINEAR_16:
        return _mixed_16(texel, first, y0 + x0, y0 + x1, y1 + x0, y1 + x1, s, t, encoding)
    above = _mix(_decoded(texel, y0 + x0, srgb), _decoded(texel, y0 + x1, srgb), s)
    below = _mix(_decoded(texel, y1 + x0, srgb), _decoded(texel, y1 + x1, srgb), s)
    return _mix(above, below, t)


@subroutine
def _stacked(texture, transform, texel, number, uv, uv1, keys, time, color):
    """Returns `color`, the texture's own, with the layers above texture `number` blended onto it in order.

    The alpha of the result is that of `color`.
    """
    never_inline()
    gain = transform[number, GAIN]
    r, g, b, alpha = color[0] * gain, color[1] * gain, color[2] * gain, color[3]
    number = np.int64(texture[number, ABOVE])
    while number >= 0:
        layer = _look_up_image(texture, transform, texel, number, uv, uv1, keys, time)
        operation = texture[number, BLEND]
        weight = transform[number, STRENGTH] * layer[3]
        gain, most = transform[number, GAIN], transform[number, MOST]
        r = blended(operation, r, layer[0] * gain, weight, most)
        g = blended(operation, g, layer[1] * gain, weight, most)
        b = blended(operation, b, layer[2] * gain, weight, most)
        number = np.int64(texture[number, ABOVE])
    return r, g, b, alpha


@subroutine
def lookup(texture, transform, texel, number, uv, uv1, keys, time):
    """Returns the linear RGBA of texture `number` with its layers: 0 ... 1, except for emission, whose layers may sum to more.

    The texture selects the coordinates, uv or uv1; (0, 0) is the image's upper left corner. keys, time: transforms while the
    shutter is open, as in CompiledScene, and the shutter time, 0 ... 1; None for a scene without motion.
    """
    color = _look_up_image(texture, transform, texel, np.int64(number), uv, uv1, keys, time)  # one type: compiled once
    if texture[number, ABOVE] >= 0:
        return _stacked(texture, transform, texel, number, uv, uv1, keys, time, color)
    return color


@device
def sample_texture(scene, number, uv, uv1, time):
    """Returns the linear RGBA of texture `number` of the scene, with its layers; see `lookup`."""
    return lookup(scene.texture, scene.texture_transform, scene.texel, number, uv, uv1, scene.key_texture, time)
