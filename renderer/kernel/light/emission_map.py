"""Directional emission maps of lights without a surface: IES profiles, panoramic images and projected images.

A light's intensity is multiplied by its map. The map has its own frame: f is the direction in which the light shines, r points to
the right of f, and u = r x f points up for a viewer that looks along f. A direction w from the light to the lit point is
converted to two map coordinates, depending on the kind of the map:

SPHERE: the azimuth of w about f, from r towards u, and the angle between w and f, 0 ... pi. For a photometric web (IES LM-63,
    type C) these are the horizontal angle, from the plane C0 at r, and the vertical angle.
WINDOW: the point where w intersects the plane at distance 1, to the right and up. The texel is an intensity.
SCREEN: the same point, but the texel is the irradiance on that plane; it is multiplied by 1 / cos^3 to give an intensity.

Texels are interpolated bilinearly. Outside a map's edges the result is 0.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.bvh.motion import step_at
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.fetch import columns, row
from renderer.kernel.polynomial import atan2, floor

__all__ = ["SCREEN", "SPHERE", "WINDOW", "emission_towards", "look_up_emission", "moving_emission_towards"]

SPHERE, WINDOW, SCREEN = range(3)

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_DARK = (_ZERO, _ZERO, _ZERO)
_EVEN = (_ONE, _ONE, _ONE)


@subroutine
def emission_towards(scene, number, p, w):
    """Returns the factor, rgb, by which the emission map of punctual light `number` scales its intensity at point p.

    The factor is 1 for a light without a map. p: in world space. w: unit direction from p to the sampled point of the light.
    """
    never_inline()
    frame = row(scene.emission_frame, number, 4)
    light = columns(scene.punctual, number, 12, 0, 10)
    return _emission(scene, frame, light[0:3], light[3:6], light[9], p, w)


@subroutine
def moving_emission_towards(scene, number, p, w, time):
    """Returns the factor of `emission_towards` for a light that moves, at the shutter time `time`, 0 ... 1."""
    never_inline()
    count = len(scene.key_punctual) // len(scene.punctual)
    step, share = step_at(time, count)
    key = number * count + step
    a, b = columns(scene.key_punctual, key, 12, 0, 10), columns(scene.key_punctual, key + 1, 12, 0, 10)
    own, next_ = row(scene.key_emission_frame, key, 4), row(scene.key_emission_frame, key + 1, 4)
    frame = (*_mixed(own, next_, 0, share), own[3])
    return _emission(scene, frame, _mixed(a, b, 0, share), _mixed(a, b, 3, share), a[9], p, w)


@device
def _mixed(a, b, k, share):
    return a[k] + share * (b[k] - a[k]), a[k + 1] + share * (b[k + 1] - a[k + 1]), a[k + 2] + share * (b[k + 2] - a[k + 2])


@device
def _emission(scene, frame, place, shines, extent, p, w):
    """Returns the emission map's factor, rgb, at point p, for a light given by columns of its table row; see `emission_towards`.

    frame: the map's axis r, and the map's number, which is negative for a light without a map. w: unit direction from p to the
    light.
    """
    if frame[3] < _ZERO:
        return _EVEN
    # The direction is measured from the light's centre, as for spots, so that an extent does not blur the map; for disks from the
    # sampled point.
    towards = vec.neg(w) if extent < _ZERO else vec.sub(p, place)
    square = vec.dot(shines, shines)
    if not square > _ZERO:
        return _DARK
    forward = vec.scale(shines, _ONE / math.sqrt(square))
    right = vec.sub(frame[0:3], vec.scale(forward, vec.dot(frame[0:3], forward)))  # interpolated keys are not orthogonal
    square = vec.dot(right, right)
    if not square > _ZERO:
        return _DARK
    right = vec.scale(right, _ONE / math.sqrt(square))
    up = vec.cross(right, forward)
    local = vec.dot(towards, right), vec.dot(towards, up), vec.dot(towards, forward)
    return look_up_emission(scene.emission_map, scene.emission_window, scene.emission, np.int64(frame[3]), local)


@subroutine
def look_up_emission(maps, windows, texels, number, local):
    """Returns the value, rgb, of map `number` in the direction `local`: its components along r, u and f, of any length but 0.

    maps, windows, texels: the arrays `emission_map`, `emission_window` and `emission` of CompiledScene.
    """
    first, width, height, kind = row(maps, number, 4)
    window = row(windows, number, 8)
    x, y, z = local
    gain = _ONE
    if kind == SPHERE:
        across, down = atan2(y, x), atan2(math.sqrt(x * x + y * y), z)  # an arc cosine is inaccurate near the axis
    else:
        if not z > _ZERO:
            return _DARK
        far = _ONE / z
        across, down = x * far, y * far
        if kind == SCREEN:
            from_axis = _ONE + across * across + down * down
            gain = from_axis * math.sqrt(from_axis)
    column = across * window[0] + window[1]
    line = down * window[2] + window[3]
    if not (window[4] <= column <= window[5] and window[6] <= line <= window[7]):
        return _DARK
    left, upper = floor(column), floor(line)
    s, t = column - np.float32(left), line - np.float32(upper)
    if kind == SPHERE:
        x0, x1 = left % width, (left + 1) % width
    else:
        x0, x1 = min(max(left, 0), width - 1), min(max(left + 1, 0), width - 1)
    y0 = first + width * min(max(upper, 0), height - 1)
    y1 = first + width * min(max(upper + 1, 0), height - 1)
    a, b = row(texels, y0 + x0, 3), row(texels, y0 + x1, 3)
    c, d = row(texels, y1 + x0, 3), row(texels, y1 + x1, 3)
    above, below = _mixed(a, b, 0, s), _mixed(c, d, 0, s)
    return vec.scale(_mixed(above, below, 0, t), gain)
