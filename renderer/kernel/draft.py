"""Draft of a picture: its means in 8 bits a colour, on a scale that leaves exposure and tone curve to the viewer.

A colour's code is round(255 log2(1 + 255 x) / DRAFT_STOPS), where x is its radiance times 2**exposure, up to 16. A step is 3 % of
the radiance where that is well above 1 / 255. protocol/pictures.py has the packet, and web/js/film/film-shader.js decodes it.

Before it is encoded, a draft may be smoothed by an edge-aware filter: SMOOTHING_PASSES à-trous passes over 3x3 pixels that are
1, 2, 4 ... apart (Dammertz et al. 2010), guided by normal, position and material of the first hits and by the brightness. Light
is divided by the albedo meanwhile, so that textures stay sharp. Pixels where nothing is hit are not smoothed.
"""

from __future__ import annotations

import numpy as np

from renderer.film import ALBEDO, COLOR, DEPTH, MATERIAL, NORMAL, POSITION, SAMPLES
from renderer.jit import device
from renderer.kernel.polynomial import log2
from renderer.wide.values import u32

__all__ = ["DRAFT_STOPS", "GUIDE_VALUES", "LIGHT_VALUES", "SMOOTHING_PASSES", "draft_word", "prepare_pixel", "smooth_pixel"]

DRAFT_STOPS = 12
SMOOTHING_PASSES = 5
LIGHT_VALUES = 4  # of a pixel: red, green and blue over albedo, times 2**exposure, and their brightness as a logarithm
GUIDE_VALUES = 8  # of a pixel: normal, position, distance (0: nothing is hit) and material of its first hit
_ZERO, _QUARTER, _HALF, _ONE, _MOST = (np.float32(value) for value in (0.0, 0.25, 0.5, 1.0, 255.0))
_CODES_A_STOP = np.float32(255 / DRAFT_STOPS)
_COLOR, _ALBEDO, _SAMPLES, _MATERIAL = (np.uintp(plane) for plane in (COLOR.start, ALBEDO.start, SAMPLES, MATERIAL))
_NORMAL, _POSITION, _DISTANCE = (np.uintp(plane) for plane in (NORMAL.start, POSITION.start, DEPTH))
_LEAST_ALBEDO = np.float32(0.05)
_MIDDLE, _BESIDE = np.float32(0.375), np.float32(0.25)  # the filter's kernel along an axis
_BENT = np.float32(2.0)  # 1 / the squared difference of two normals from which pixels are not mixed
_APART = np.float32(0.004)  # distance from the tangent plane at which pixels are not mixed, of the hit's distance, a pixel's step
_CONTRAST = np.float32(0.2)  # 1 / the stops of brightness that halve a weight in the first pass; twice that in each further one


@device
def _level(x):
    """Returns log2(1 + 255 x) of radiance x times 2**exposure; 0 if it is negative."""
    return log2(_ONE + _MOST * max(x, _ZERO))


@device
def _code(x):
    """Returns the code of radiance x times 2**exposure, uint32 in [0, 255]; that of negative radiance is 0."""
    return u32(min(_level(x) * _CODES_A_STOP + _HALF, _MOST))


@device
def _brightness(red, green, blue):
    return _level(_QUARTER * red + _HALF * green + _QUARTER * blue)


@device
def _albedo(film, channel, y, x, unit):
    return max(np.float32(film[_ALBEDO + channel, y, x]) * unit, _LEAST_ALBEDO)


@device
def _unit(film, y, x, scale):
    return scale / max(np.float32(film[_SAMPLES, y, x]), _ONE)


@device
def prepare_pixel(film, light, guides, y, x, scale, gain):
    """Writes light and guides of a pixel, which `smooth_pixel` and `draft_word` read. y, x: uintp.

    film: (planes, h, w) int64. light: (2, h, w, LIGHT_VALUES) float32, of which the first half is written. guides: (h, w,
    GUIDE_VALUES) float32. scale: 2**-film_exponent, float32. gain: 2**exposure, float32. Without samples all values are 0.
    """
    unit = _unit(film, y, x, scale)
    for channel in range(3):
        at = np.uintp(channel)
        light[0, y, x, at] = np.float32(film[_COLOR + at, y, x]) * unit * gain / _albedo(film, at, y, x, unit)
        guides[y, x, at] = np.float32(film[_NORMAL + at, y, x]) * unit
        guides[y, x, np.uintp(3) + at] = np.float32(film[_POSITION + at, y, x]) * unit
    light[0, y, x, 3] = _brightness(light[0, y, x, 0], light[0, y, x, 1], light[0, y, x, 2])
    guides[y, x, 6] = np.float32(film[_DISTANCE, y, x]) * unit
    guides[y, x, 7] = np.float32(film[_MATERIAL, y, x])


@device
def _guide_weight(guides, y, x, other_y, other_x, reach):
    """Returns in [0, 1] how much the surface at another pixel resembles that at (y, x).

    reach: distance from the tangent plane from which the weight is 0.
    """
    bend, apart = _ZERO, _ZERO
    for axis in range(3):
        normal = guides[y, x, np.uintp(axis)]
        difference = normal - guides[other_y, other_x, np.uintp(axis)]
        bend += difference * difference
        apart += normal * (guides[other_y, other_x, np.uintp(3 + axis)] - guides[y, x, np.uintp(3 + axis)])
    alike = max(_ZERO, _ONE - _BENT * bend)
    is_same = guides[other_y, other_x, 7] == guides[y, x, 7] and guides[other_y, other_x, 6] > _ZERO
    return alike * alike * max(_ZERO, _ONE - abs(apart) / reach) if is_same else _ZERO


@device
def smooth_pixel(light, guides, y, x, number):
    """Writes a pixel of a pass of the filter from one half of `light` to the other: from the first in pass 0.

    light, guides: as for `prepare_pixel`. y, x: int64. number: of the pass, int64.
    """
    source, target, step = number & 1, ~number & 1, 1 << number
    distance = guides[y, x, 6]
    for value in range(LIGHT_VALUES):
        light[target, y, x, value] = light[source, y, x, value]
    if distance > _ZERO:
        reach, contrast = _APART * np.float32(step) * distance, _CONTRAST * np.float32(step)
        total, red, green, blue = _ZERO, _ZERO, _ZERO, _ZERO
        for down in range(-1, 2):
            for right in range(-1, 2):
                other_y, other_x = y + down * step, x + right * step
                if 0 <= other_y < guides.shape[0] and 0 <= other_x < guides.shape[1]:
                    weight = (_BESIDE if down else _MIDDLE) * (_BESIDE if right else _MIDDLE)
                    weight *= _guide_weight(guides, y, x, other_y, other_x, reach)
                    stops = contrast * (light[source, other_y, other_x, 3] - light[source, y, x, 3])
                    weight /= _ONE + stops * stops
                    total += weight
                    red += weight * light[source, other_y, other_x, 0]
                    green += weight * light[source, other_y, other_x, 1]
                    blue += weight * light[source, other_y, other_x, 2]
        red, green, blue = red / total, green / total, blue / total  # its own weight is not 0
        light[target, y, x, 0], light[target, y, x, 1], light[target, y, x, 2] = red, green, blue
        light[target, y, x, 3] = _brightness(red, green, blue)


@device
def draft_word(film, light, half, y, x, scale):
    """Returns the codes of a pixel, uint32, red in the lowest byte; 0 without samples.

    film, light, y, x, scale: as for `prepare_pixel`. half: of `light`, which has the pixel.
    """
    unit, word = _unit(film, y, x, scale), np.uint32(0)
    for channel in range(3):
        at = np.uintp(channel)
        word |= _code(light[half, y, x, at] * _albedo(film, at, y, x, unit)) << np.uint32(8 * channel)
    return word
