"""Animation curves: keys and interpolation.

Computed in Python floats, one operation at a time: curves decide vertex positions, which must have the same bits on every host.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from renderer.trigonometry import angle_between, sin_cos

__all__ = ["Curve", "Easing", "eased", "slerp", "smooth"]

F64 = npt.NDArray[np.float64]
Easing = tuple[float, float, float, float]  # x1, y1, x2, y2 of a cubic Bezier from (0, 0) to (1, 1), as in CSS


@dataclass(frozen=True)
class Curve:
    """An animation curve: keys in order of time. It is constant before the first and after the last key.

    Between two keys, the value is the earlier key's if `is_step`; a cubic if there are slopes (glTF 2.0, appendix C.5); else
    linear, with time remapped by the Bezier curve `easing` if given. is_rotation: the values are quaternions x y z w,
    interpolated by slerp.
    """

    times: F64  # (K,) seconds, not decreasing
    values: F64  # (K, W)
    is_step: bool = False
    slopes: F64 | None = None  # (K, 2, W) per second: the cubics' slopes before and after each key
    easing: Easing | None = None
    is_rotation: bool = False

    @property
    def is_constant(self) -> bool:
        """True if the curve has the same value at all times."""
        return bool((self.values == self.values[0]).all() and (self.slopes is None or not self.slopes.any()))

    def values_at(self, time: float) -> list[float]:
        """Returns the W values of the curve at a time in seconds.

        At a key, these are exactly the key's values; of several keys at the same time, the last one's.
        """
        k = int(np.searchsorted(self.times, time, "right")) - 1
        if k < 0 or k == len(self.times) - 1 or self.is_step:
            return self._row(self.values[max(k, 0)])
        start, end = float(self.times[k]), float(self.times[k + 1])
        u = (time - start) / (end - start)
        begin, finish = self._row(self.values[k]), self._row(self.values[k + 1])
        if u == 0:
            return begin
        if self.slopes is not None:
            return _cubic(begin, finish, self._row(self.slopes[k, 1]), self._row(self.slopes[k + 1, 0]), u, end - start)
        share = u if self.easing is None else eased(self.easing, u)
        if self.is_rotation:
            return slerp(begin, finish, share)
        return [a * (1.0 - share) + b * share for a, b in zip(begin, finish, strict=True)]

    @staticmethod
    def _row(row: F64) -> list[float]:
        return [float(value) for value in row]


def smooth(times: F64, values: F64) -> Curve:
    """Returns a smooth curve through the keys without overshoot, with slope 0 at the first and the last.

    Slopes of Fritsch & Butland 1984, "A Method for Constructing Local Monotone Piecewise Cubic Interpolants".
    """
    slopes = np.stack([_slopes(times.tolist(), column) for column in values.T.tolist()], axis=1)
    return Curve(times, values, slopes=np.repeat(slopes[:, None], 2, axis=1))


def _slopes(times: list[float], column: list[float]) -> F64:
    found = np.zeros(len(times))
    for k in range(1, len(times) - 1):
        before, after = times[k] - times[k - 1], times[k + 1] - times[k]
        rise, fall = (column[k] - column[k - 1]) / before, (column[k + 1] - column[k]) / after
        if rise * fall > 0:
            first, second = 2.0 * after + before, after + 2.0 * before
            found[k] = (first + second) / (first / rise + second / fall)
    return found


def _cubic(
    begin: list[float], end: list[float], leaving: list[float], arriving: list[float], u: float, span: float
) -> list[float]:
    square = u * u
    third = square * u
    towards = 3.0 * square - 2.0 * third
    out, into = span * (third - 2.0 * square + u), span * (third - square)
    return [
        a * (1.0 - towards) + b * towards + m * out + n * into for a, b, m, n in zip(begin, end, leaving, arriving, strict=True)
    ]


def slerp(begin: Sequence[float], end: Sequence[float], share: float) -> list[float]:
    """Interpolates between two unit quaternions along the shorter arc (glTF 2.0, appendix C.4).

    share: the fraction of the way, 0 at `begin` to 1 at `end`.
    """
    begin, end = _unit(begin), _unit(end)
    if _dot(begin, end) < 0:
        end = [-b for b in end]
    across, along = [b - a for a, b in zip(begin, end, strict=True)], [b + a for a, b in zip(begin, end, strict=True)]
    # By both chords (Kahan 2006), as an arc cosine has no digits for small angles.
    far, near = math.sqrt(_dot(across, across)), math.sqrt(_dot(along, along))
    angle = 2.0 * angle_between(far, near)
    first, second = 1.0 - share, share
    if angle > 1e-9:
        sine, cosine = sin_cos(angle * share)
        square = far * far + near * near
        whole, level = 2.0 * far * near / square, (near * near - far * far) / square  # sine and cosine of the angle
        first, second = (whole * cosine - level * sine) / whole, sine / whole
    return [a * first + b * second for a, b in zip(begin, end, strict=True)]


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    # Not by sum(), which compensates its rounding from Python 3.12 on.
    return ((a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]) + a[3] * b[3]


def _unit(quaternion: Sequence[float]) -> list[float]:
    length = math.sqrt(_dot(quaternion, quaternion))
    return [q / length for q in quaternion] if length > 1e-12 else [0.0, 0.0, 0.0, 1.0]


def eased(easing: Easing, u: float) -> float:
    """Returns the remapped time within an interval between two keys: the height of the easing's cubic Bezier curve at u.

    u and the result are fractions of the interval, 0 to 1.
    """
    x1, y1, x2, y2 = easing
    low, high = 0.0, 1.0
    for _ in range(60):  # x increases with the parameter, since x1 and x2 are within 0 ... 1
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _bezier(x1, x2, middle) < u else (low, middle)
    return _bezier(y1, y2, 0.5 * (low + high))


def _bezier(first: float, second: float, s: float) -> float:
    rest = 1.0 - s
    return 3.0 * rest * rest * s * first + 3.0 * rest * s * s * second + s * s * s
