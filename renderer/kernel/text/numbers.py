"""Parses one decimal number in a byte array."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.jit import device

__all__ = ["read_number"]

Bytes = npt.NDArray[np.uint8]

_PLUS, _MINUS, _DOT = 43, 45, 46
_DIGITS = 18  # that fit an int64; further digits are below float64's precision
_POWERS = np.array([*(float(f"1e{k}") for k in range(309)), np.inf])  # of ten; the C library's differ between hosts
_LAST_POWER = len(_POWERS) - 1


@device
def read_number(text: Bytes, i: int) -> tuple[float, int]:
    """Parses a decimal number at index i: (value, index after it); (0.0, i) if there is none."""
    n, begin = len(text), i
    negative = i < n and text[i] == _MINUS
    if i < n and (negative or text[i] == _PLUS):
        i += 1
    mantissa, digits, exponent, seen = 0, 0, 0, False
    fraction = 0
    while i < n:
        c = text[i]
        if c == _DOT and fraction == 0:
            fraction = 1
        elif ord("0") <= c <= ord("9"):
            seen = True
            if digits < _DIGITS:
                mantissa = mantissa * 10 + (c - ord("0"))
                digits += mantissa > 0
                exponent -= fraction
            else:
                exponent += 1 - fraction
        else:
            break
        i += 1
    if not seen:
        return 0.0, begin
    if i + 1 < n and (text[i] == ord("e") or text[i] == ord("E")):
        at = i + 1
        down = text[at] == _MINUS
        if down or text[at] == _PLUS:
            at += 1
        if at < n and ord("0") <= text[at] <= ord("9"):
            power = 0
            while at < n and ord("0") <= text[at] <= ord("9"):
                power = min(power * 10 + (text[at] - ord("0")), 9999)
                at += 1
            exponent += -power if down else power
            i = at
    value = np.float64(mantissa)
    if exponent < -300:  # in two steps, since 10^-exponent would overflow
        value = value / 1e300 / _POWERS[min(-exponent - 300, _LAST_POWER)]
    elif exponent < 0:
        value /= _POWERS[-exponent]
    elif mantissa > 0:
        value *= _POWERS[min(exponent, _LAST_POWER)]
    return (-value if negative else value), i
