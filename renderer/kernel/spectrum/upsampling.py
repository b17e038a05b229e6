"""Reflectances, light and coefficients at a path's wavelengths from linear Rec.709.

Jakob and Hanika, "A Low-Dimensional Function Space for Efficient Spectral Upsampling" (Eurographics 2019), with a table of
coefficients that renderer/scene/spectrum_tables.py generates. Greys have the same value at every wavelength.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.arrays.spectrum import (
    CONDUCTOR_NODES,
    FIRST_SHADE,
    GIVEN_LIGHT,
    GIVEN_REFLECTANCE,
    LAST_SHADE,
    SHADES,
    SIDES,
)
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.fetch import row
from renderer.wide.values import any_of, lookup, not_, to_float, to_int, u32, where, where3, zero_like

__all__ = ["coefficients_at", "light", "light_at", "reflectance", "reflectance_at", "unbounded"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_LEAST = np.float32(1e-30)
_FIRST, _LAST = np.float32(FIRST_SHADE), np.float32(LAST_SHADE)
_DARKEST = np.float32(FIRST_SHADE**2 / (FIRST_SHADE**2 + (1 - FIRST_SHADE) ** 2))
_BRIGHTEST = np.float32(LAST_SHADE**2 / (LAST_SHADE**2 + (1 - LAST_SHADE) ** 2))
_SHADE_STEPS = np.float32((SHADES - 1) / (LAST_SHADE - FIRST_SHADE))
_SIDE_STEPS = np.float32(SIDES - 1)
_MOST_SHADE, _MOST_SIDE = np.uint32(SHADES - 2), np.uint32(SIDES - 2)
_SHADES, _SIDES = np.uint32(SHADES), np.uint32(SIDES)
_SHEET = np.uint32(SIDES * SIDES)
_RED, _GREEN, _BLUE = np.uint32(0), np.uint32(1), np.uint32(2)
_NEXT = np.uint32(1)
_LIGHT, _SURFACE = np.float32(GIVEN_LIGHT), np.float32(GIVEN_REFLECTANCE)
_STEPS, _LAST_STEP, _NODES = np.float32(CONDUCTOR_NODES - 1), np.uint32(CONDUCTOR_NODES - 2), np.uint32(CONDUCTOR_NODES)
_TOLERANCE = np.float32(1e-5)  # of colours, by which given spectra are recognised


@device
def _root_of_odds(value):
    """Returns t of value = t^2 / (t^2 + (1 - t)^2), 0 to 1: in it, the table's nodes are even."""
    a, b = math.sqrt(value), math.sqrt(max(_ONE - value, zero_like(value)))
    return a / (a + b)


@device
def _node(place, most):
    """Returns (number of the node before `place`, at most `most` and valid for NaN; distance beyond it)."""
    number = u32(to_int(place))
    number = where(number < most, number, most)
    return number, place - to_float(number)


@device
def _mixed(a, b, share):
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])


@device
def _on_sheet(table, first, s, t):
    """Returns the coefficients interpolated bilinearly on one sheet of the table. first: the row of the lower node."""
    low = _mixed(row(table, first, 3), row(table, u32(first + _NEXT), 3), s)
    above = u32(first + _SIDES)
    return _mixed(low, _mixed(row(table, above, 3), row(table, u32(above + _NEXT), 3), s), t)


@device
def _coefficients(table, rgb, most):
    """Returns (coefficients of the sigmoid with the colour of rgb, factor by which to scale it). most: the largest channel."""
    red, green, blue = rgb
    is_red = (red >= green) & (red >= blue)
    is_green = not_(is_red) & (green >= blue)
    least = max(most, _LEAST)
    s, side_s = _node(_root_of_odds(where(is_red, green, where(is_green, blue, red)) / least) * _SIDE_STEPS, _MOST_SIDE)
    t, side_t = _node(_root_of_odds(where(is_red, blue, where(is_green, red, green)) / least) * _SIDE_STEPS, _MOST_SIDE)
    shade = min(max(most, _DARKEST), _BRIGHTEST)
    z, depth = _node(max(_root_of_odds(shade) - _FIRST, zero_like(shade)) * _SHADE_STEPS, _MOST_SHADE)
    channel = where(is_red, _RED, where(is_green, _GREEN, _BLUE))
    first = u32(u32(channel * _SHADES + z) * _SHEET + u32(t * _SIDES + s))
    below = _on_sheet(table, first, side_s, side_t)
    above = _on_sheet(table, u32(first + _SHEET), side_s, side_t)
    return _mixed(below, above, depth), most / shade


@device
def _sigmoid(coefficients, wavelength):
    a, b, c = coefficients
    y = (a * wavelength + b) * wavelength + c
    return _HALF + _HALF * (y / math.sqrt(_ONE + y * y))


@device
def _given_value(tables, first, wavelength):
    number, share = _node(wavelength * _STEPS, _LAST_STEP)
    at = u32(first + number)
    a, b = lookup(tables.given_value, at), lookup(tables.given_value, u32(at + _NEXT))
    return a + share * (b - a)


@device
def _where_given(tables, kind, rgb, scale, wavelengths, found):
    """Returns `found`, and where rgb is `scale` times the colour of a given spectrum of this kind, that spectrum's values."""
    tolerance = _TOLERANCE * scale
    for k in range(len(tables.given_color)):
        red, green, blue, which = (
            tables.given_color[k, 0],
            tables.given_color[k, 1],
            tables.given_color[k, 2],
            tables.given_color[k, 3],
        )
        if which == kind:
            is_it = (
                (abs(rgb[0] - scale * red) <= tolerance)
                & (abs(rgb[1] - scale * green) <= tolerance)
                & (abs(rgb[2] - scale * blue) <= tolerance)
            )
            if any_of(is_it):
                first = u32(np.uint32(k) * _NODES)
                x, y, z = wavelengths
                values = _given_value(tables, first, x), _given_value(tables, first, y), _given_value(tables, first, z)
                found = where3(is_it, vec.scale(values, scale), found)
    return found


@device
def _smooth(tables, rgb, wavelengths):
    """Returns the values at three wavelengths of the smooth reflectance whose colour in daylight is rgb, 0 ... 1."""
    most = vec.maximum(rgb)
    is_grey = (rgb[0] == rgb[1]) & (rgb[1] == rgb[2])
    found = rgb
    if any_of(not_(is_grey)):
        coefficients, scale = _coefficients(tables.sigmoid, rgb, most)
        first = scale * _sigmoid(coefficients, wavelengths[0])
        second = scale * _sigmoid(coefficients, wavelengths[1])
        third = scale * _sigmoid(coefficients, wavelengths[2])
        found = where3(is_grey, rgb, (first, second, third))
    return found


@device
def unbounded(tables, rgb, wavelengths):
    """Returns the values at three wavelengths of a smooth spectrum of colour rgb, not negative, relative to daylight."""
    scale = _TWO * vec.maximum(rgb)
    safe = _ONE / max(scale, _LEAST)
    return vec.scale(_smooth(tables, vec.scale(rgb, safe), wavelengths), scale)


@device
def reflectance(tables, rgb, wavelengths):
    """Returns the reflectances at three wavelengths of a surface whose colour in daylight is rgb, 0 ... 1.

    They are those of a given spectrum with that colour, else smooth.
    """
    found = _smooth(tables, rgb, wavelengths)
    return _where_given(tables, _SURFACE, rgb, _ONE, wavelengths, found)


@device
def light(tables, rgb, wavelengths):
    """Returns light of colour rgb at three wavelengths, relative to daylight.

    It is that of a given spectrum with the light's chromaticity, else `unbounded`.
    """
    found = unbounded(tables, rgb, wavelengths)
    return _where_given(tables, _LIGHT, rgb, vec.maximum(rgb), wavelengths, found)


@device
def reflectance_at(scene, rgb, wavelengths):
    """Returns `reflectance` of a colour at a path's wavelengths; the colour itself in kernels without spectra."""
    found = rgb
    if scene.spectrum is not None:
        found = reflectance(scene.spectrum, rgb, wavelengths)
    return found


@device
def light_at(scene, rgb, wavelengths):
    """Returns `light` of a colour at a path's wavelengths; the colour itself in kernels without spectra."""
    found = rgb
    if scene.spectrum is not None:
        found = light(scene.spectrum, rgb, wavelengths)
    return found


@device
def coefficients_at(scene, rgb, wavelengths):
    """Returns coefficients, `unbounded`, at a path's wavelengths; the colour's own in kernels without spectra."""
    found = rgb
    if scene.spectrum is not None:
        found = unbounded(scene.spectrum, rgb, wavelengths)
    return found
