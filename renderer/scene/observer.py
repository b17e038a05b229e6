"""The CIE 1931 standard observer, and the daylight illuminant D65.

Source: CIE 018:2019, tables of the 2 degree observer and of illuminant D65, every 10 nm.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["D65", "DAYLIGHT_WEIGHTS", "MATCHING", "REC709", "WAVELENGTHS", "at_wavelengths", "planck"]

F64 = npt.NDArray[np.float64]

WAVELENGTHS = np.arange(380.0, 781.0, 5.0)

_TENS = np.arange(380.0, 781.0, 10.0)
_X = """.0014 .0042 .0143 .0435 .1344 .2839 .3483 .3362 .2908 .1954 .0956 .0320 .0049 .0093 .0633 .1655 .2904 .4334 .5945
.7621 .9163 1.0263 1.0622 1.0026 .8544 .6424 .4479 .2835 .1649 .0874 .0468 .0227 .0114 .0058 .0029 .0014 .0007 .0003
.0002 .0001 0"""
_Y = """.0000 .0001 .0004 .0012 .0040 .0116 .0230 .0380 .0600 .0910 .1390 .2080 .3230 .5030 .7100 .8620 .9540 .9950 .9950
.9520 .8700 .7570 .6310 .5030 .3810 .2650 .1750 .1070 .0610 .0320 .0170 .0082 .0041 .0021 .0010 .0005 .0002 .0001
.0001 .0000 0"""
_Z = """.0065 .0201 .0679 .2074 .6456 1.3856 1.7471 1.7721 1.6692 1.2876 .8130 .4652 .2720 .1582 .0782 .0422 .0203 .0087
.0039 .0021 .0017 .0011 .0008 .0003 .0002 .0000 .0000 0 0 0 0 0 0 0 0 0 0 0 0 0 0"""
_DAYLIGHT = """49.98 54.65 82.75 91.49 93.43 86.68 104.86 117.01 117.81 114.86 115.92 108.81 109.35 107.80 104.79 107.69 104.41
104.05 100.00 96.33 95.79 88.69 90.01 89.60 87.70 83.29 83.70 80.03 80.21 82.28 78.28 69.72 71.61 74.35 61.60 69.89
75.09 63.59 46.42 66.81 63.38"""


def _at_5_nm(rows: str) -> F64:
    """Returns a table with 10 nm steps interpolated to 5 nm, cubically through four points."""
    tens = np.array(rows.split(), float)
    wide = np.r_[2 * tens[0] - tens[1], tens, 2 * tens[-1] - tens[-2]]
    middle = np.maximum((9 * (wide[1:-2] + wide[2:-1]) - wide[:-3] - wide[3:]) / 16, 0)
    found = np.empty(2 * len(tens) - 1)
    found[::2], found[1::2] = tens, middle
    return found


MATCHING = np.stack([_at_5_nm(_X), _at_5_nm(_Y), _at_5_nm(_Z)])  # (3, W)
D65 = np.interp(WAVELENGTHS, _TENS, np.array(_DAYLIGHT.split(), float))  # linear between 10 nm steps, as CIE specifies

# Source: ITU-R BT.709-6, chromaticities of the primaries and white. (3, 3), from XYZ to linear Rec.709.
_PRIMARIES = np.array([(0.64, 0.33), (0.30, 0.60), (0.15, 0.06), (0.3127, 0.3290)])
_XYZ = np.stack([_PRIMARIES[:, 0], _PRIMARIES[:, 1], 1 - _PRIMARIES.sum(axis=1)]) / _PRIMARIES[:, 1]
REC709 = np.linalg.inv(_XYZ[:, :3] * np.linalg.solve(_XYZ[:, :3], _XYZ[:, 3]))
DAYLIGHT_WEIGHTS = REC709 @ (MATCHING * D65)
DAYLIGHT_WEIGHTS = DAYLIGHT_WEIGHTS / DAYLIGHT_WEIGHTS.sum(axis=1, keepdims=True)  # (3, W) of wavelengths; each row sums to 1

_COLDEST = 30.0
_H, _C, _K = 6.62606957e-34, 299792458.0, 1.3806488e-23


def planck(kelvin: float) -> F64:
    """Returns (W,) the relative spectral radiance of a black body at WAVELENGTHS.

    Below _COLDEST kelvins, where it is as red as it can be, that of _COLDEST, since it would be smaller than any number.
    """
    kelvin = max(kelvin, _COLDEST)
    metres = WAVELENGTHS * 1e-9
    exponent = np.minimum(_H * _C / (metres * _K * kelvin), 700.0)
    return np.asarray(1e-30 / (metres**5 * np.expm1(exponent)))


def at_wavelengths(wavelengths: F64, values: F64) -> F64:
    """Returns (W,) the values of a spectrum at WAVELENGTHS: interpolated linearly between its samples, and 0 outside them."""
    order = np.argsort(wavelengths, kind="stable")
    return np.asarray(np.interp(WAVELENGTHS, wavelengths[order], values[order], left=0.0, right=0.0))
