"""Sines, cosines and angles from additions, products and roots alone, so that every host gets the same bits.

The C library's and numpy's depend on which processor they run on, in the last bit; what moves is prepared by many machines.
Each operation here is rounded by itself (IEEE 754), as Python's floats are: within 2e-16 of the true value.
"""

from __future__ import annotations

import math

__all__ = ["angle_between", "sin_cos"]

# pi / 2 in three parts, the first two of 33 bits each: a multiple of them by up to 2^20 is exact (Cody and Waite 1980).
_HALF_PI = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
_MOST = 1e6

_SINE = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(9))
_COSINE = tuple((-1.0) ** k / math.factorial(2 * k) for k in range(9))
_ARCTANGENT = tuple((-1.0) ** k / (2 * k + 1) for k in range(12))


def sin_cos(angle: float) -> tuple[float, float]:
    """The sine and the cosine of an angle in radians, at most 1e6 from 0."""
    if not abs(angle) <= _MOST:
        raise ValueError(f"{angle:g} radians are too many turns to tell where they end")
    quarters = round(angle / (math.pi / 2))
    part = angle - quarters * _HALF_PI[0]
    low = quarters * _HALF_PI[1]
    rest = part - low
    tail = ((part - rest) - low) - quarters * _HALF_PI[2]
    square = rest * rest
    # sin(x + e) = sin x + e cos x, and so the cosine: e is below the last bit of x.
    sine = rest + (rest * square * _polynomial(_SINE[1:], square) + tail * (1.0 - 0.5 * square))
    half = 0.5 * square
    cosine = 1.0 - half
    cosine += ((1.0 - cosine) - half) + (square * square * _polynomial(_COSINE[2:], square) - rest * tail)
    turned = ((sine, cosine), (cosine, -sine), (-sine, -cosine), (-cosine, sine))
    return turned[quarters % 4]


def angle_between(across: float, along: float) -> float:
    """The angle in [0, pi / 2] whose tangent is across / along, both of them at least 0."""
    if across > along:
        return math.pi / 2 - angle_between(along, across)
    if across == 0:
        return 0.0
    tangent = across / along
    for _ in range(2):  # twice halved it is below pi / 16, where the series is short
        tangent = tangent / (1.0 + math.sqrt(1.0 + tangent * tangent))
    return 4.0 * tangent * _polynomial(_ARCTANGENT, tangent * tangent)


def _polynomial(coefficients: tuple[float, ...], x: float) -> float:
    value = 0.0
    for coefficient in reversed(coefficients):
        value = value * x + coefficient
    return value
