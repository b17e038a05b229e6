"""The environment: an equirectangular image, or a constant colour as an image of one texel, plus a sun disk.

Directions are sampled texel by texel in proportion to luminance times solid angle, and uniformly in solid angle within the texel:
a constant environment is sampled without noise, and the density of an image is constant over each texel. Lookups are bilinear.
Where interpolation spreads light into a black texel, only BSDF sampling finds it, and MIS weights it correctly. The sun is a
separate disk, since image texels are too coarse for it: a fixed fraction of the samples is taken on the disk, and the density is
that of the mixture.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.bvh.simd import LANES, bits, less, load, lowest_bit, splat
from renderer.jit import device, subroutine
from renderer.kernel import vec
from renderer.kernel.fetch import row
from renderer.kernel.polynomial import acos, atan2, floor, sincos_turns
from renderer.kernel.sampling.warp import square_to_cone, square_to_cone_pdf
from renderer.wide.lanes import each_lane
from renderer.wide.values import any_of, as_wide, lookup, not_, to_float, to_int, u32, where, where3, zero_like

__all__ = ["environment_light", "environment_radiance", "sample_cdf", "sample_cdf_row", "sample_environment"]

_END = np.uint32(1 << (LANES - 1))
_FIRST = np.uint32(0)
_NEXT = np.uint32(1)
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_BELOW_ONE = np.float32(1.0 - 2.0**-24)
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
def sample_cdf(cdf, u):
    """Returns (i, u rescaled to [0, 1), probability of i) for the i with cdf[i] <= u < cdf[i + 1], by binary search.

    Entries with probability 0 are never chosen.
    """
    low = as_wide(_FIRST, u)
    count = np.uint32(len(cdf) - 1)
    while count > _NEXT:
        half = np.uint32(count >> _NEXT)
        middle = u32(low + half)
        low = where(lookup(cdf, middle) <= u, middle, low)
        count = np.uint32(count - half)
    rest, width = _stretched(cdf, low, u)
    return low, rest, width


@device
def _stretched(cdf, i, u):
    """Returns (u's position within interval i of a cdf, rescaled to [0, 1); probability of that interval).

    cdf: flat table; i: a flat index into it.
    """
    low = lookup(cdf, i)
    width = lookup(cdf, u32(i + _NEXT)) - low
    return min(where(width > _ZERO, (u - low) / width, _ZERO), _BELOW_ONE), width


@device
def sample_cdf_row(cdf, start, row, u):
    """Samples row `row` of a table of cdfs; returns the same bits as `sample_cdf` for that row, for u in [0, 1).

    start: guide table with the position where the search begins (renderer/scene/cutpoints.py).
    """
    i = as_wide(_FIRST, u)
    if cdf.shape[-1] > 2:
        i = each_lane(_interval, as_wide(True, u), (cdf, start, row, u))
    rest, width = _stretched(cdf, u32(row * np.uint32(cdf.shape[-1]) + i), u)
    return i, rest, width


@device
def _interval(cdf, start, row, u):
    """Returns the index of the interval of a cdf row that contains u; compares eight entries at a time.

    Guide table method: Chen & Asau, "On Generating Random Variates from an Empirical Distribution", 1974.
    """
    length, parts = cdf.shape[-1], start.shape[-1]
    before = np.int64(row) * length
    i = np.int64(lookup(start, np.int64(row) * parts + to_int(u * np.float32(parts))))
    last = length - LANES
    if last < 0:
        while i < length - 2 and lookup(cdf, before + i + 1) <= u:
            i += 1
        return np.uint32(i)
    while True:
        first = min(i + 1, last)
        above = bits(less(splat(u), load(cdf, np.uintp(before + first))))
        if above != 0 or first == last:
            break
        i += LANES
    return np.uint32(first - 1 + np.int64(lowest_bit(above | _END)))


@subroutine
def _uv(frame, d):
    """Returns the image coordinates, both in [0, 1], of a unit direction in world space.

    The middle column is towards -z, the top row towards +y.
    """
    x = d[0] * frame[0] - d[2] * frame[1]
    z = d[0] * frame[1] + d[2] * frame[0]
    return _HALF + atan2(x, -z) * _INV_2PI, acos(d[1]) * _INV_PI


@device
def _place(environment, frame, d):
    """Returns the image coordinates of a world direction, from `_uv`.

    If the image has a single texel, they are not computed: the result is (1/2, 1/2).
    """
    if environment.shape[0] * environment.shape[1] == 1:
        middle = as_wide(_HALF, d[0])
        return middle, middle
    return _uv(frame, d)


@device
def _on_sun(frame, d):
    """Returns True if the unit direction d (world space) is on the sun's disk.

    Compares the squared chord, since a float32 cosine has an error of a hundredth of the disk.
    """
    on_sun = as_wide(False, d[0])
    if frame[7] > _ZERO:
        x, y, z = d[0] - frame[4], d[1] - frame[5], d[2] - frame[6]
        on_sun = x * x + y * y + z * z < _TWO * frame[7]
    return on_sun


@device
def environment_radiance(environment, frame, d):
    """Returns the radiance, rgb, from world direction d: image and sun."""
    u, v = _place(environment, frame, d)
    return _with_sun(frame, _image_radiance(environment, u, v), _on_sun(frame, d))


@device
def environment_light(scene, d, judged):
    """Returns (radiance from world direction d, pdf per steradian with which `sample_environment` samples d).

    judged: whether the pdf is needed; otherwise it is 0.
    """
    frame = scene.environment_frame
    u, v = _place(scene.environment, frame, d)
    on_sun = _on_sun(frame, d)
    pdf = zero_like(d[0])
    if any_of(judged):
        pdf = where(judged, _pdf(scene, u, v, on_sun), pdf)
    return _with_sun(frame, _image_radiance(scene.environment, u, v), on_sun), pdf


@device
def _with_sun(frame, radiance, on_sun):
    if any_of(on_sun):
        brighter = radiance[0] + frame[8], radiance[1] + frame[9], radiance[2] + frame[10]
        radiance = where3(on_sun, brighter, radiance)
    return radiance


@device
def _image_radiance(environment, u, v):
    height, width = np.uint32(environment.shape[0]), np.uint32(environment.shape[1])
    if height * width == 1:
        return as_wide(environment[0, 0, 0], u), as_wide(environment[0, 0, 1], u), as_wide(environment[0, 0, 2], u)
    x = u * np.float32(width) - _HALF
    y = v * np.float32(height) - _HALF
    left, upper = floor(x), floor(y)
    s = x - to_float(left)
    t = y - to_float(upper)
    # Unsigned comparison: -1 wraps to the largest number, and NaN converts to nearly that.
    x0, x1 = u32(left), u32(left + _NEXT)
    y0, y1 = u32(upper), u32(upper + _NEXT)
    x0 = where(x0 < width, x0, np.uint32(width - _NEXT))
    x1 = where(x1 < width, x1, _FIRST)
    y0 = where(y0 < height, y0, _FIRST)
    y1 = where(y1 < height, y1, np.uint32(height - _NEXT))
    a = (_ONE - s) * (_ONE - t)
    b = s * (_ONE - t)
    c = (_ONE - s) * t
    e = s * t
    ul, ur = row(environment, u32(y0 * width + x0), 3), row(environment, u32(y0 * width + x1), 3)
    ll, lr = row(environment, u32(y1 * width + x0), 3), row(environment, u32(y1 * width + x1), 3)
    return (
        a * ul[0] + b * ur[0] + c * ll[0] + e * lr[0],
        a * ul[1] + b * ur[1] + c * ll[1] + e * lr[1],
        a * ul[2] + b * ur[2] + c * ll[2] + e * lr[2],
    )


@device
def _sine(turns):
    """Returns sin(2 pi turns) for 0 <= turns <= 1/4, with small relative error for small angles."""
    x = _TWO_PI * turns
    small = x - x * x * x * _SIXTH * (_ONE - x * x * _TWENTIETH)
    is_large = turns > _SMALL
    if any_of(is_large):
        sine, _ = sincos_turns(turns)
        small = where(is_large, sine, small)
    return small


@device
def _row_extent(number, height):
    """Returns the difference of cos(theta) between the edges of texel row `number` in an image of that height.

    It is computed as a product: subtracting the two cosines would cancel near the poles.
    """
    step = _HALF / np.float32(height)
    return _TWO * _sine((to_float(_from_pole(number, height)) + _HALF) * step) * _sine(_HALF * step)


@device
def _from_pole(number, height):
    """Returns the number of texel rows between row `number` of the image and the nearer pole."""
    opposite = u32(np.uint32(height - 1) - number)
    return where(number < opposite, number, opposite)


@device
def sample_environment(scene, choice, u):
    """Samples a world direction in proportion to the environment's luminance: (unit direction, pdf per steradian).

    choice: in [0, 1); selects between the sun's disk and the image. u: two numbers in [0, 1).
    """
    of_sun = choice < scene.environment_frame[11]
    pdf = zero_like(choice)
    d = pdf, pdf, pdf
    if any_of(not_(of_sun)):
        d, pdf = _sample_beside_sun(scene, u)
    if any_of(of_sun):
        towards, density = _sample_sun(scene, u)
        d, pdf = where3(of_sun, towards, d), where(of_sun, density, pdf)
    return d, pdf


@device
def _sample_sun(scene, u):
    frame = scene.environment_frame
    sun_share = frame[11]
    axis = (frame[4], frame[5], frame[6])
    s, t = vec.basis(axis)
    d = vec.to_world(s, t, axis, square_to_cone(u, frame[7]))
    pdf = as_wide(sun_share * square_to_cone_pdf(frame[7]), u[0])
    if sun_share < _ONE:
        pdf = pdf + (_ONE - sun_share) * _image_pdf(scene, *_place(scene.environment, frame, d))
    return d, pdf


@device
def _sample_beside_sun(scene, u):
    """Samples a world direction in proportion to the image, leaving out the sun: (direction, pdf per steradian).

    The pdf includes the density of sun samples if the direction happens to be on the sun's disk.
    """
    frame = scene.environment_frame
    d, pdf = _sample_image(scene, u)
    pdf = pdf * (_ONE - frame[11])
    on_sun = _on_sun(frame, d)
    if any_of(on_sun):
        pdf = where(on_sun, pdf + frame[11] * square_to_cone_pdf(frame[7]), pdf)
    return d, pdf


@device
def _pdf(scene, u, v, on_sun):
    frame = scene.environment_frame
    pdf = (_ONE - frame[11]) * _image_pdf(scene, u, v)
    if any_of(on_sun):
        pdf = where(on_sun, pdf + frame[11] * square_to_cone_pdf(frame[7]), pdf)
    return pdf


@device
def _sample_image(scene, u):
    frame, conditional = scene.environment_frame, scene.environment_conditional
    height, width = conditional.shape[0], conditional.shape[1] - 1
    marginal, row_start = scene.environment_marginal, scene.environment_row_start
    number, u0, row_probability = sample_cdf_row(marginal, row_start, _FIRST, u[0])
    column, u1, column_probability = sample_cdf_row(conditional, scene.environment_column_start, number, u[1])
    extent = _row_extent(number, height)
    south = number + number >= np.uint32(height)
    from_pole = u32(np.uint32(height - 1) - number)
    edge = _sine(to_float(where(south, from_pole, number)) * (_QUARTER / np.float32(height)))
    below_pole = _TWO * edge * edge + where(south, _ONE - u0, u0) * extent  # 1 - |cos(theta)|
    y = where(south, below_pole - _ONE, _ONE - below_pole)
    radius = math.sqrt(max(_ZERO, below_pole * (_TWO - below_pole)))
    sine, cosine = sincos_turns((to_float(column) + u1) / np.float32(width) - _HALF)
    x = radius * sine
    z = -radius * cosine
    solid_angle = _TWO_PI / np.float32(width) * extent
    pdf = row_probability * column_probability / solid_angle
    return (x * frame[0] + z * frame[1], y, z * frame[0] - x * frame[1]), pdf


@device
def _image_pdf(scene, u, v):
    marginal, conditional = scene.environment_marginal, scene.environment_conditional
    height, width = conditional.shape[0], conditional.shape[1] - 1
    number, column = _texel(v, height), _texel(u, width)
    solid_angle = _TWO_PI / np.float32(width) * _row_extent(number, height)
    at = u32(number * np.uint32(width + 1) + column)
    of_row = lookup(marginal, u32(number + _NEXT)) - lookup(marginal, number)
    of_column = lookup(conditional, u32(at + _NEXT)) - lookup(conditional, at)
    return of_row * of_column / solid_angle


@device
def _texel(place, count):
    """Returns the index of the texel that contains `place`, where `count` texels divide [0, 1) equally.

    For values out of range and NaN the index is valid too.
    """
    number = u32(to_int(place * np.float32(count)))
    return where(number < np.uint32(count), number, np.uint32(count - 1))
