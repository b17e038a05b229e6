"""The wavelengths of a path: how they are sampled, and how light at them becomes linear Rec.709.

Wavelengths are three numbers 0 ... 1 (renderer/arrays/spectrum.py), the hero first.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.spectrum import CELL_COLUMNS, CELLS, FIRST_NM, LAST_NM
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.fetch import columns
from renderer.kernel.sampling.sampler import draw4
from renderer.prune_absent_features import function_if
from renderer.wide.values import to_float, to_int, u32, where

__all__ = ["nanometres", "rgb_at", "sample_wavelengths", "to_rgb", "wavelengths_of"]

_ONE = np.float32(1.0)
_THIRD = np.float32(1.0 / 3.0)
_THIRDS = np.float32(2.0 / 3.0)
_CELLS = np.float32(CELLS)
_LAST = np.uint32(CELLS - 1)
_BLOCK = np.uint32((1 << 18) + 1)  # block of the hero's random number, after that of the shutter time (steps/random_blocks.py)
_FIRST_NM, _RANGE_NM = np.float32(FIRST_NM), np.float32(LAST_NM - FIRST_NM)


@device
def _place(u, rotation):
    """Returns (cell of `SpectrumTables`, place in it 0 ... 1) of the random number u, rotated by a part of its range."""
    turned = u + rotation
    turned = where(turned < _ONE, turned, turned - _ONE) * _CELLS
    number = u32(to_int(turned))
    number = where(number < _LAST, number, _LAST)
    return number, turned - to_float(number)


@device
def _wavelength(tables, u, rotation):
    number, share = _place(u, rotation)
    start, growth = columns(tables.cell, number, CELL_COLUMNS, 0, 2)
    return start + share * growth


@device
def sample_wavelengths(tables, u):
    """Returns a path's wavelengths for a random number u in [0, 1), with a density near the film's response."""
    return _wavelength(tables, u, u - u), _wavelength(tables, u, _THIRD), _wavelength(tables, u, _THIRDS)


@device
def _hero(stream):
    return draw4(stream, _BLOCK)[0]


@device
def wavelengths_of(scene, stream):
    """Returns the wavelengths of the path with this random number stream; None in kernels without spectra.

    stream: that of the camera ray, also for a path's second branch.
    """
    return function_if(scene.spectrum, _sampled, _none)(scene, stream)


@device
def _sampled(scene, stream):
    return sample_wavelengths(scene.spectrum, _hero(stream))


@device
def _none(scene, stream):
    return None


@device
def nanometres(wavelength):
    """Returns a wavelength in nanometres."""
    return _FIRST_NM + _RANGE_NM * wavelength


@device
def _response(tables, u, rotation, light):
    """Returns the linear Rec.709, three numbers, of light at one of the wavelengths for u, over its density."""
    number, share = _place(u, rotation)
    red, green, blue = columns(tables.cell, number, CELL_COLUMNS, 2, 3)
    more_red, more_green, more_blue = columns(tables.cell, number, CELL_COLUMNS, 5, 3)
    return vec.scale((red + share * more_red, green + share * more_green, blue + share * more_blue), light)


@device
def to_rgb(tables, stream, light):
    """Returns the linear Rec.709 of a sample's light at its wavelengths; components may be negative.

    The mean over all wavelengths is the colour. stream: as for `wavelengths_of`.
    """
    u = _hero(stream)
    first = _response(tables, u, u - u, light[0])
    second = _response(tables, u, _THIRD, light[1])
    third = _response(tables, u, _THIRDS, light[2])
    return vec.scale(vec.add(vec.add(first, second), third), _THIRD)


@device
def rgb_at(scene, stream, light):
    """Returns `to_rgb` of light at a path's wavelengths; the light itself in kernels without spectra."""
    found = light
    if scene.spectrum is not None:
        found = to_rgb(scene.spectrum, stream, light)
    return found
