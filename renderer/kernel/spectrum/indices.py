"""Indices of refraction at a path's wavelengths: dispersive glass, and conductors."""

from __future__ import annotations

import numpy as np

from renderer.arrays.spectrum import CONDUCTOR_NODES
from renderer.jit import device
from renderer.kernel.fetch import row
from renderer.kernel.spectrum.wavelengths import nanometres
from renderer.wide.values import lookup, to_float, to_int, u32, where

__all__ = ["conductor_at", "dispersed_index"]

_ONE = np.float32(1.0)
_LINE_D, _LINE_F, _LINE_C = 587.56, 486.13, 656.27  # nm, of the Abbe number
_AT_D = np.float32(1.0 / _LINE_D**2)
# Of n = A + B / wavelength^2: B (F - C) = (n - 1) / Abbe, where the Abbe number is 20 / dispersion (KHR_materials_dispersion).
_SLOPE = np.float32(1.0 / (20.0 * (1.0 / _LINE_F**2 - 1.0 / _LINE_C**2)))
_STEPS = np.float32(CONDUCTOR_NODES - 1)
_LAST = np.uint32(CONDUCTOR_NODES - 2)
_NEXT = np.uint32(1)


@device
def dispersed_index(ior, dispersion, wavelength):
    """Returns the index of refraction at a wavelength, by Cauchy's equation.

    ior: at the line d, 587.56 nm. dispersion: 20 over the Abbe number.
    """
    nm = nanometres(wavelength)
    return ior + (ior - _ONE) * dispersion * _SLOPE * (_ONE / (nm * nm) - _AT_D)


@device
def _one(tables, first, wavelength):
    place = wavelength * _STEPS
    number = u32(to_int(place))
    number = where(number < _LAST, number, _LAST)
    share = place - to_float(number)
    at = u32(first + number)
    a, b = row(tables.conductor, at, 3), row(tables.conductor, u32(at + _NEXT), 3)
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])


@device
def conductor_at(tables, material, wavelengths):
    """Returns (eta, k, mean reflectance over the hemisphere) of a conductor, three wavelengths each. material: its number."""
    first = u32(lookup(tables.material_conductor, material))
    x, y, z = _one(tables, first, wavelengths[0]), _one(tables, first, wavelengths[1]), _one(tables, first, wavelengths[2])
    return (x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2])
