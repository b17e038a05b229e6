"""Sines, cosines and angles with the same bits on every host.

The results of the C library and numpy depend on the CPU in the last bit, while many machines prepare cameras, environments and
motion. Here sines are computed in integers, and angles by sums, products and roots of floats, each rounded as IEEE 754 defines.
"""

from __future__ import annotations

import math

__all__ = ["angle_between", "sin_cos"]

_BITS = 160  # fraction bits; enough for correct rounding near multiples of pi
_ONE = 1 << _BITS
_PI = (314159265358979323846264338327950288419716939937510582097494459230781640 << _BITS) // 10**71
_MAX_ANGLE = 1e6
_SMALL = 2.0**-28  # below it sin(x) = x and cos(x) = 1

_ARCTANGENT = tuple((-1.0) ** k / (2 * k + 1) for k in range(12))


def sin_cos(angle: float) -> tuple[float, float]:
    """Returns the floats nearest to the sine and the cosine of an angle in radians, at most 1e6 in size."""
    if not abs(angle) <= _MAX_ANGLE:
        raise ValueError(f"{angle:g} radians are too many turns to tell where they end")
    if abs(angle) < _SMALL:
        return angle, 1.0
    numerator, denominator = angle.as_integer_ratio()
    exact = (numerator << _BITS) // denominator
    quarters = (2 * exact + _PI // 2) // _PI  # the nearest number of right angles
    rest = exact - quarters * _PI // 2
    square = rest * rest >> _BITS
    sine, cosine = _series(rest, square, 1) / _ONE, _series(_ONE, square, 0) / _ONE
    turned = ((sine, cosine), (cosine, -sine), (-sine, -cosine), (-cosine, sine))
    return turned[quarters % 4]


def _series(term: int, square: int, n: int) -> int:
    """Returns the series x^n / n! - x^(n + 2) / (n + 2)! + ... in fixed point. term: its first term; square: x^2."""
    total = 0
    while term not in (0, -1):
        total += term
        term = -(term * square >> _BITS) // ((n + 1) * (n + 2))
        n += 2
    return total


def angle_between(across: float, along: float) -> float:
    """Returns the angle in [0, pi / 2] whose tangent is across / along, both at least 0, with an error of at most 5e-16 rad."""
    if across > along:
        return math.pi / 2 - angle_between(along, across)
    if across == 0:
        return 0.0
    tangent = across / along
    for _ in range(2):  # halving twice brings it below pi / 16, where the series converges fast
        tangent = tangent / (1.0 + math.sqrt(1.0 + tangent * tangent))
    square, total = tangent * tangent, 0.0
    for coefficient in reversed(_ARCTANGENT):
        total = total * square + coefficient
    return 4.0 * tangent * total
