"""Light from infinitely far: an equirectangular image, or one colour as an image of one texel, and a sun's disk before it.

Directions are chosen texel by texel in proportion to luminance times solid angle, and uniformly in solid angle within the
texel: a constant environment is sampled without any noise, and an image's density is constant over each texel. Lookups are
bilinear; where that spills light into a black texel, only BSDF sampling finds it, which MIS weighs correctly. A sun has a
disk of its own, since no image's texels are as fine: a share of the samples falls on it, and the density is that of both.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.bvh.simd import LANES, bits, less, load, lowest_bit, select, splat
from renderer.jit import device, subroutine
from renderer.kernel import vec
from renderer.kernel.polynomial import acos, atan2, floor, sincos_turns
from renderer.kernel.sampling.warp import square_to_cone, square_to_cone_pdf

__all__ = ["choose", "choose_from", "environment_light", "environment_radiance", "sample_environment"]

_END = np.uint32(1 << (LANES - 1))
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_HALF = np.float32(0.5)
_TWO = np.float32(2.0)
_QUARTER = np.float32(0.25)
_SIXTH = np.float32(1.0 / 6.0)
_TWENTIETH = np.float32(0.05)
_SMALL = np.float32(0.03)
_TWO_PI = np.float32(2.0 * math.pi)
_INV_PI = np.float32(1.0 / math.pi)
_INV_2PI = np.float32(0.5 / math.pi)


@device
def choose(cdf, u):
    """The i with cdf[i] <= u < cdf[i + 1], and u stretched from that interval to [0, 1). Skips what has probability 0."""
    low = np.uintp(0)
    count = np.uintp(len(cdf) - 1)
    while count > np.uintp(1):
        half = np.uintp(count >> np.uintp(1))
        low = select(cdf[low + half] <= u, low + half, low)
        count -= half
    return _stretched(cdf, low, u)


@device
def _stretched(cdf, i, u):
    width = cdf[i + np.uintp(1)] - cdf[i]
    rest = (u - cdf[i]) / width if width > _ZERO else _ZERO
    return np.int64(i), min(rest, np.float32(1.0 - 2.0**-24)), width


@device
def choose_from(cdf, start, u):
    """What `choose` gives, to the bit, for u in [0, 1): `start` tells where to begin (renderer/scene/cutpoints.py), and eight
    places are looked at together.

    Chen & Asau, "On Generating Random Variates from an Empirical Distribution", 1974.
    """
    last = len(cdf) - LANES
    if last < 0:
        return choose(cdf, u)
    i = np.int64(start[np.uintp(u * np.float32(len(start)))])
    while True:
        first = min(i + 1, last)
        above = bits(less(splat(u), load(cdf, np.uintp(first))))
        if above != 0 or first == last:
            break
        i += LANES
    return _stretched(cdf, np.uintp(first - 1 + np.int64(lowest_bit(above | _END))), u)


@subroutine
def _uv(frame, d):
    """The image's coordinates of a world direction, both in [0, 1]. The middle column looks along -z, the top row along +y."""
    x = d[0] * frame[0] - d[2] * frame[1]
    z = d[0] * frame[1] + d[2] * frame[0]
    return _HALF + atan2(x, -z) * _INV_2PI, acos(d[1]) * _INV_PI


@device
def _place(environment, frame, d):
    """`_uv`, which nobody needs to know in an even sky."""
    if environment.shape[0] * environment.shape[1] == 1:
        return _HALF, _HALF
    return _uv(frame, d)


@device
def _on_sun(frame, d):
    """Whether the sun's disk lies in direction d. By the chord: a cosine in float32 is off by a hundredth of the disk."""
    if frame[7] == _ZERO:
        return False
    x, y, z = d[0] - frame[4], d[1] - frame[5], d[2] - frame[6]
    return x * x + y * y + z * z < _TWO * frame[7]


@device
def environment_radiance(environment, frame, d):
    """The radiance that comes from direction d."""
    u, v = _place(environment, frame, d)
    return _with_sun(frame, _image_radiance(environment, u, v), _on_sun(frame, d))


@device
def environment_light(scene, d, judged):
    """(radiance that comes from direction d, the density with which `sample_environment` gives d; 0 unless `judged`)."""
    frame = scene.environment_frame
    u, v = _place(scene.environment, frame, d)
    on_sun = _on_sun(frame, d)
    pdf = _pdf(scene, u, v, on_sun) if judged else _ZERO
    return _with_sun(frame, _image_radiance(scene.environment, u, v), on_sun), pdf


@device
def _with_sun(frame, radiance, on_sun):
    if on_sun:
        radiance = (radiance[0] + frame[8], radiance[1] + frame[9], radiance[2] + frame[10])
    return radiance


@device
def _image_radiance(environment, u, v):
    height, width = environment.shape[0], environment.shape[1]
    if height * width == 1:
        return environment[0, 0, 0], environment[0, 0, 1], environment[0, 0, 2]
    x = u * np.float32(width) - _HALF
    y = v * np.float32(height) - _HALF
    left = floor(x)
    upper = floor(y)
    s = x - np.float32(left)
    t = y - np.float32(upper)
    x0 = left if left >= 0 else width - 1  # so NaN, the least int64
    x1 = x0 + 1 if x0 + 1 < width else 0
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
def _sine(turns):
    """sin of 2 pi turns, 0 <= turns <= 1/4, with the relative precision that small angles need."""
    if turns > _SMALL:
        sine, _ = sincos_turns(turns)
        return sine
    x = _TWO_PI * turns
    return x - x * x * x * _SIXTH * (_ONE - x * x * _TWENTIETH)


@device
def _row_extent(row, height):
    """What cos(theta) falls by over a row of texels. As a difference of cosines, it would be lost at the poles."""
    step = _HALF / np.float32(height)
    return _TWO * _sine((np.float32(min(row, height - 1 - row)) + _HALF) * step) * _sine(_HALF * step)


@device
def sample_environment(scene, choice, u):
    """A direction in proportion to the environment's light: (unit direction, pdf per steradian).

    choice tells, if there is a sun, whether it is the sun's."""
    frame = scene.environment_frame
    sun_share = frame[11]
    if choice < sun_share:
        axis = (frame[4], frame[5], frame[6])
        s, t = vec.basis(axis)
        d = vec.to_world(s, t, axis, square_to_cone(u, frame[7]))
        pdf = sun_share * square_to_cone_pdf(frame[7])
        if sun_share < _ONE:
            pdf += (_ONE - sun_share) * _image_pdf(scene, *_place(scene.environment, frame, d))
        return d, pdf
    d, pdf = _sample_image(scene, u)
    pdf *= _ONE - sun_share
    if _on_sun(frame, d):
        pdf += sun_share * square_to_cone_pdf(frame[7])
    return d, pdf


@device
def _pdf(scene, u, v, on_sun):
    frame = scene.environment_frame
    pdf = (_ONE - frame[11]) * _image_pdf(scene, u, v)
    if on_sun:
        pdf += frame[11] * square_to_cone_pdf(frame[7])
    return pdf


@device
def _sample_image(scene, u):
    frame, conditional = scene.environment_frame, scene.environment_conditional
    height, width = conditional.shape[0], conditional.shape[1] - 1
    row, u0, row_probability = choose_from(scene.environment_marginal, scene.environment_row_start, u[0])
    column, u1, column_probability = choose_from(conditional[row], scene.environment_column_start[row], u[1])
    extent = _row_extent(row, height)
    south = 2 * row >= height
    edge = _sine(np.float32(height - 1 - row if south else row) * (_QUARTER / np.float32(height)))
    below_pole = _TWO * edge * edge + (_ONE - u0 if south else u0) * extent  # 1 - |cos(theta)|
    y = below_pole - _ONE if south else _ONE - below_pole
    radius = math.sqrt(max(_ZERO, below_pole * (_TWO - below_pole)))
    sine, cosine = sincos_turns((np.float32(column) + u1) / np.float32(width) - _HALF)
    x = radius * sine
    z = -radius * cosine
    solid_angle = _TWO_PI / np.float32(width) * extent
    pdf = row_probability * column_probability / solid_angle
    return (x * frame[0] + z * frame[1], y, z * frame[0] - x * frame[1]), pdf


@device
def _image_pdf(scene, u, v):
    marginal, conditional = scene.environment_marginal, scene.environment_conditional
    height, width = conditional.shape[0], conditional.shape[1] - 1
    row = min(max(np.int64(v * np.float32(height)), 0), height - 1)  # NaN becomes the least int64
    column = min(max(np.int64(u * np.float32(width)), 0), width - 1)
    solid_angle = _TWO_PI / np.float32(width) * _row_extent(row, height)
    return (marginal[row + 1] - marginal[row]) * (conditional[row, column + 1] - conditional[row, column]) / solid_angle
