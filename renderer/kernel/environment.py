"""Light from infinitely far: an equirectangular image, or one colour as an image of one texel.

Directions are chosen texel by texel in proportion to luminance times solid angle, and uniformly in solid angle within the
texel: a constant environment is sampled without any noise, and an image's density is constant over each texel. Lookups are
bilinear; where that spills light into a black texel, only BSDF sampling finds it, which MIS weighs correctly.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device, subroutine
from renderer.kernel.polynomial import acos, atan2, floor, sincos_turns

__all__ = ["choose", "environment_pdf", "environment_radiance", "sample_environment"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_HALF = np.float32(0.5)
_TWO_PI = np.float32(2.0 * math.pi)
_INV_PI = np.float32(1.0 / math.pi)
_INV_2PI = np.float32(0.5 / math.pi)


@device
def choose(cdf, u):
    """The i with cdf[i] <= u < cdf[i + 1], and u stretched from that interval to [0, 1). Skips what has probability 0."""
    low = 0
    high = len(cdf) - 1
    while high - low > 1:
        middle = (low + high) >> 1
        if cdf[middle] <= u:
            low = middle
        else:
            high = middle
    width = cdf[low + 1] - cdf[low]
    rest = (u - cdf[low]) / width if width > _ZERO else _ZERO
    return low, min(rest, np.float32(1.0 - 2.0**-24)), width


@subroutine
def _uv(frame, d):
    """The image's coordinates of a world direction, both in [0, 1]. The middle column looks along -z, the top row along +y."""
    x = d[0] * frame[0] - d[2] * frame[1]
    z = d[0] * frame[1] + d[2] * frame[0]
    return _HALF + atan2(x, -z) * _INV_2PI, acos(d[1]) * _INV_PI


@device
def environment_radiance(environment, frame, d):
    """The radiance that comes from direction d."""
    height, width = environment.shape[0], environment.shape[1]
    if height * width == 1:
        return environment[0, 0, 0], environment[0, 0, 1], environment[0, 0, 2]
    u, v = _uv(frame, d)
    x = u * np.float32(width) - _HALF
    y = v * np.float32(height) - _HALF
    left = floor(x)
    upper = floor(y)
    s = x - np.float32(left)
    t = y - np.float32(upper)
    x0 = left % width
    x1 = (left + 1) % width
    y0 = min(max(upper, 0), height - 1)
    y1 = min(max(upper + 1, 0), height - 1)
    a = (_ONE - s) * (_ONE - t)
    b = s * (_ONE - t)
    c = (_ONE - s) * t
    e = s * t
    return (
        a * environment[y0, x0, 0] + b * environment[y0, x1, 0] + c * environment[y1, x0, 0] + e * environment[y1, x1, 0],
        a * environment[y0, x0, 1] + b * environment[y0, x1, 1] + c * environment[y1, x0, 1] + e * environment[y1, x1, 1],
        a * environment[y0, x0, 2] + b * environment[y0, x1, 2] + c * environment[y1, x0, 2] + e * environment[y1, x1, 2],
    )


@device
def _row_cosines(row, height):
    """cos(theta) at the upper and lower edge of a row of texels."""
    step = _HALF / np.float32(height)
    _, upper = sincos_turns(np.float32(row) * step)
    _, lower = sincos_turns(np.float32(row + 1) * step)
    return upper, lower


@device
def sample_environment(marginal, conditional, frame, u):
    """A direction in proportion to the environment's light: (unit direction, pdf per steradian)."""
    height, width = conditional.shape[0], conditional.shape[1] - 1
    row, u0, row_probability = choose(marginal, u[0])
    column, u1, column_probability = choose(conditional[row], u[1])
    upper, lower = _row_cosines(row, height)
    y = upper + u0 * (lower - upper)
    radius = math.sqrt(max(_ZERO, _ONE - y * y))
    sine, cosine = sincos_turns((np.float32(column) + u1) / np.float32(width) - _HALF)
    x = radius * sine
    z = -radius * cosine
    solid_angle = _TWO_PI / np.float32(width) * (upper - lower)
    pdf = row_probability * column_probability / solid_angle
    return (x * frame[0] + z * frame[1], y, z * frame[0] - x * frame[1]), pdf


@device
def environment_pdf(marginal, conditional, frame, d):
    """The density with which `sample_environment` gives d, per steradian."""
    height, width = conditional.shape[0], conditional.shape[1] - 1
    u, v = _uv(frame, d)
    row = min(max(np.int64(v * np.float32(height)), 0), height - 1)  # NaN becomes the least int64
    column = min(max(np.int64(u * np.float32(width)), 0), width - 1)
    upper, lower = _row_cosines(row, height)
    solid_angle = _TWO_PI / np.float32(width) * (upper - lower)
    return (marginal[row + 1] - marginal[row]) * (conditional[row, column + 1] - conditional[row, column]) / solid_angle
