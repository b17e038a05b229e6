"""What lights without a body send into each direction: IES profiles, pictures of all directions, pictures that are thrown.

A light's intensity is multiplied by its map. The map's own frame is f, in which the light shines, r, to the right of that, and
u = r x f, which is up for whoever looks along f. Of a direction w to what is lit, a map is looked up by two coordinates:

SPHERE: the angles of w about f, from r towards u, and with f, 0 ... pi. Of a photometric web (IES LM-63, type C) that is the
    horizontal angle, from the plane C0 at r, and the vertical one.
WINDOW: where w meets the plane at the distance 1, to the right and up. What is looked up is an intensity.
SCREEN: likewise, but what is looked up is the irradiance that it gives that plane: an intensity of that over cos^3.

Between texels it is bilinear; beyond a map's edges there is no light.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.bvh.motion import step_at
from renderer.jit import device, out_of_line, subroutine
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
    """(3,) what the map of punctual light `number` multiplies its light by at p; 1 of a light without one.

    w: the unit direction from p to the point of the light that shines on it.
    """
    out_of_line()
    frame = row(scene.emission_frame, number, 4)
    light = columns(scene.punctual, number, 12, 0, 10)
    return _emission(scene, frame, light[0:3], light[3:6], light[9], p, w)


@subroutine
def moving_emission_towards(scene, number, p, w, time):
    """`emission_towards` at a time of the shutter."""
    out_of_line()
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
    """As `emission_towards`, of a light by its rows. frame: r, and the number of the map, below 0 for none."""
    if frame[3] < _ZERO:
        return _EVEN
    # As spots do: by the direction from the centre, so that an extent does not blur the map; disks by each direction's own.
    towards = vec.neg(w) if extent < _ZERO else vec.sub(p, place)
    square = vec.dot(shines, shines)
    if not square > _ZERO:
        return _DARK
    forward = vec.scale(shines, _ONE / math.sqrt(square))
    right = vec.sub(frame[0:3], vec.scale(forward, vec.dot(frame[0:3], forward)))  # between two keys it leans
    square = vec.dot(right, right)
    if not square > _ZERO:
        return _DARK
    right = vec.scale(right, _ONE / math.sqrt(square))
    up = vec.cross(right, forward)
    local = vec.dot(towards, right), vec.dot(towards, up), vec.dot(towards, forward)
    return look_up_emission(scene.emission_map, scene.emission_window, scene.emission, np.int64(frame[3]), local)


@subroutine
def look_up_emission(maps, windows, texels, number, local):
    """(3,) what map `number` has in the direction `local`: its components along r, u and f, of any length but 0.

    maps, windows, texels: as CompiledScene has `emission_map`, `emission_window` and `emission`.
    """
    first, width, height, kind = row(maps, number, 4)
    window = row(windows, number, 8)
    x, y, z = local
    gain = _ONE
    if kind == SPHERE:
        across, down = atan2(y, x), atan2(math.sqrt(x * x + y * y), z)  # an arc cosine is inexact about the axis
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
