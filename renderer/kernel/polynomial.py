"""Approximations of sin, cos, exp, log, pow and others in float32, since the C library's results differ between hosts.

Each is a polynomial after range reduction, with coefficients from weighted least squares that approach the minimax error. They
accept one number or eight lanes (renderer/wide).
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.wide.values import as_floats, as_ints, rint, to_float, to_int, u32, where

__all__ = ["acos", "atan2", "erf", "erf_inverse", "exp", "exp2", "floor", "log", "log2", "power", "sincos_turns"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_QUARTER = np.float32(0.25)
_PI = np.float32(math.pi)
_HALF_PI = np.float32(math.pi / 2)
_LOG2_E = np.float32(math.log2(math.e))
_LN_2 = np.float32(math.log(2.0))
_SQRT_2 = np.float32(math.sqrt(2.0))
_MOST_EXPONENT = np.float32(128.0)
_MIN_EXPONENT = np.float32(-126.0)
_INF = np.float32(np.inf)
_NAN = np.float32(np.nan)
_SMALLEST = np.float32(2.0**-126)
# A float32 is 1.f * 2**(exponent - 127), its bits are those of f behind those of the exponent.
_FRACTION_BITS = np.uint32(23)
_FRACTION = np.uint32(0x7FFFFF)
_BITS_OF_ONE = np.uint32(0x3F800000)
_EXPONENT_BIAS = np.float32(127.0)
_TWICE_BIAS = np.float32(254.0)
_NO_BITS = np.uint32(0)
_LOWEST_BIT = np.uint32(1)

_S = tuple(np.float32(c) for c in (6.28318519, -41.3416607, 81.6012907, -76.5553989, 39.5743314))
_C = tuple(np.float32(c) for c in (-19.7392086, 64.9393569, -85.4539732, 60.1507137, -25.0223338))
_E = tuple(np.float32(c) for c in (6.93147206e-1, 2.40226513e-1, 5.55032791e-2, 9.61800398e-3, 1.34002353e-3, 1.54762792e-4))
_L = tuple(
    np.float32(c)
    for c in (
        1.44269500e0,
        -7.21347199e-1,
        4.80910280e-1,
        -3.60716264e-1,
        2.87939094e-1,
        -2.38675687e-1,
        2.15212268e-1,
        -2.08933778e-1,
        1.29264207e-1,
    )
)
_T = tuple(
    np.float32(c)
    for c in (
        -3.33331670e-1,
        1.99941372e-1,
        -1.42142089e-1,
        1.06789394e-1,
        -7.58057611e-2,
        4.35535150e-2,
        -1.65811688e-2,
        2.97458655e-3,
    )
)
_A = tuple(
    np.float32(c)
    for c in (
        1.57079630e0,
        -2.14598804e-1,
        8.89790497e-2,
        -5.01747138e-2,
        3.08930491e-2,
        -1.70898047e-2,
        6.67128876e-3,
        -1.26282962e-3,
    )
)

# Abramowitz & Stegun, "Handbook of Mathematical Functions", 7.1.26.
_ERF_P = np.float32(0.3275911)
_ERF = tuple(np.float32(c) for c in (0.254829592, -0.284496736, 1.421413741, -1.453152027, 1.061405429))
# Giles, "Approximating the erfinv function" (GPU Computing Gems, 2010), single precision: near the middle, and in the tails.
_NEAR_TAIL = np.float32(5.0)
_MIDDLE_SHIFT = np.float32(2.5)
_TAIL_SHIFT = np.float32(3.0)
_MIDDLE = tuple(
    np.float32(c)
    for c in (
        1.50140941, 0.246640727, -0.00417768164, -0.00125372503, 0.00021858087, -4.39150654e-6, -3.5233877e-6, 3.43273939e-7,
        2.81022636e-8,
    )
)  # fmt: skip
_TAIL = tuple(
    np.float32(c)
    for c in (
        2.83297682, 1.00167406, 0.00943887047, -0.0076224613, 0.00573950773, -0.00367342844, 0.00134934322, 0.000100950558,
        -0.000200214257,
    )
)  # fmt: skip


@device
def floor(x):
    """Returns the greatest integer not above x: int64 for |x| < 2**62; for eight lanes u32x8, the bits of int32, for |x| < 2**31.

    math.floor would call the C library.
    """
    whole = to_int(x)
    return whole - where(to_float(whole) > x, _LOWEST_BIT, _NO_BITS)


@device
def sincos_turns(turns):
    """Returns (sin, cos) of 2 pi turns, |turns| < 2**20; absolute error below 4e-7.

    Has no branches, since a random angle's quadrant is unpredictable: with y = |x| - 1/4 for the remainder x after the nearest
    whole turn, cos(2 pi x) = -sin(2 pi y) and sin(2 pi |x|) = cos(2 pi y), and y spans only half a turn.
    """
    x = turns - rint(turns)
    y = abs(x) - _QUARTER
    z = y * y
    sine = math.copysign(_ONE + z * (_C[0] + z * (_C[1] + z * (_C[2] + z * (_C[3] + z * _C[4])))), x)
    return sine, -y * (_S[0] + z * (_S[1] + z * (_S[2] + z * (_S[3] + z * _S[4]))))


@device
def atan2(y, x):
    """Returns the angle of (x, y), in [-pi, pi]; absolute error below 4e-7. 0 at the origin."""
    ax = abs(x)
    ay = abs(y)
    greater = max(ax, ay)
    q = min(ax, ay) / where(greater == _ZERO, _ONE, greater)
    z = q * q
    tail = _T[4] + z * (_T[5] + z * (_T[6] + z * _T[7]))
    angle = q + q * z * (_T[0] + z * (_T[1] + z * (_T[2] + z * (_T[3] + z * tail))))
    angle = where(ay > ax, _HALF_PI - angle, angle)
    angle = where(x < _ZERO, _PI - angle, angle)
    return math.copysign(angle, y)


@device
def acos(x):
    """Returns the arc cosine, in [0, pi], of x clamped to [-1, 1]; absolute error below 6e-7."""
    a = min(abs(x), _ONE)
    tail = _A[4] + a * (_A[5] + a * (_A[6] + a * _A[7]))
    angle = math.sqrt(_ONE - a) * (_A[0] + a * (_A[1] + a * (_A[2] + a * (_A[3] + a * tail))))
    return where(x < _ZERO, _PI - angle, angle)


@device
def exp2(x):
    """Returns 2**x; relative error below 3e-7. inf above 128, 0 below -126."""
    whole = to_float(floor(x + _HALF))
    f = x - whole
    value = _ONE + f * (_E[0] + f * (_E[1] + f * (_E[2] + f * (_E[3] + f * (_E[4] + f * _E[5])))))
    biased = u32(to_int(whole + _TWICE_BIAS))
    half = u32(biased >> _LOWEST_BIT)  # in two steps: 2**128 alone is out of range where 2**127.7 is not
    whole_and_rest = value * as_floats(u32(half << _FRACTION_BITS)) * as_floats(u32((biased - half) << _FRACTION_BITS))
    return where(x >= _MOST_EXPONENT, _INF, where(x < _MIN_EXPONENT, _ZERO, where(x != x, x, whole_and_rest)))


@device
def log2(x):
    """Returns the logarithm to base 2; error below 2e-7 (relative near 1, else absolute). -inf at 0 and for subnormals."""
    bits = as_ints(x)
    exponent = to_float(u32(bits >> _FRACTION_BITS)) - _EXPONENT_BIAS
    m = as_floats(u32((bits & _FRACTION) | _BITS_OF_ONE))
    great = m > _SQRT_2
    f = where(great, m * _HALF, m) - _ONE
    exponent = where(great, exponent + _ONE, exponent)
    tail = _L[4] + f * (_L[5] + f * (_L[6] + f * (_L[7] + f * _L[8])))
    value = exponent + f * (_L[0] + f * (_L[1] + f * (_L[2] + f * (_L[3] + f * tail))))
    return where(x == _INF, _INF, where(x >= _SMALLEST, value, where(x >= _ZERO, -_INF, _NAN)))


@device
def exp(x):
    """Returns e**x; relative error below 3e-7 + 1e-7 |x|."""
    return exp2(x * _LOG2_E)


@device
def log(x):
    """Returns the natural logarithm; see `log2`."""
    return log2(x) * _LN_2


@device
def power(x, y):
    """Returns x**y for x >= 0; relative error about 2e-7 (1 + |y log2(x)|). 0**0 is 1."""
    return where(y == _ZERO, _ONE, exp2(y * log2(x)))


@device
def erf(x):
    """Returns the error function of one number; absolute error below 4e-7."""
    t = _ONE / (_ONE + _ERF_P * abs(x))
    tail = t * (_ERF[0] + t * (_ERF[1] + t * (_ERF[2] + t * (_ERF[3] + t * _ERF[4]))))
    return math.copysign(_ONE - tail * exp(-x * x), x)


@device
def erf_inverse(x):
    """Returns the inverse of `erf` of one number, |x| < 1; relative error below 1e-6."""
    w = -log((_ONE - x) * (_ONE + x))
    if w < _NEAR_TAIL:
        w, c = w - _MIDDLE_SHIFT, _MIDDLE
    else:
        w, c = math.sqrt(w) - _TAIL_SHIFT, _TAIL
    return x * (c[0] + w * (c[1] + w * (c[2] + w * (c[3] + w * (c[4] + w * (c[5] + w * (c[6] + w * (c[7] + w * c[8]))))))))
