"""Three-dimensional vectors as tuples of three float32 or three f32x8, which stay in registers."""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device

__all__ = [
    "add",
    "basis",
    "cross",
    "dot",
    "is_finite",
    "length",
    "luminance",
    "magnitude",
    "maximum",
    "mul",
    "neg",
    "normalize",
    "scale",
    "sub",
    "to_local",
    "to_world",
]

_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)
_RED = np.float32(0.2126)
_GREEN = np.float32(0.7152)
_BLUE = np.float32(0.0722)


@device
def add(a, b):
    """Returns a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@device
def sub(a, b):
    """Returns a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@device
def mul(a, b):
    """Returns the componentwise product."""
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@device
def scale(a, s):
    """Returns a times the scalar s."""
    return a[0] * s, a[1] * s, a[2] * s


@device
def neg(a):
    """Returns -a."""
    return -a[0], -a[1], -a[2]


@device
def dot(a, b):
    """Returns the dot product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@device
def cross(a, b):
    """Returns the cross product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@device
def normalize(a):
    """Returns a scaled to length 1; NaN if a is zero."""
    return scale(a, _ONE / math.sqrt(dot(a, a)))


@device
def length(a):
    """Returns the Euclidean length."""
    return math.sqrt(dot(a, a))


@device
def magnitude(a):
    """Returns the largest absolute value of a component."""
    return max(abs(a[0]), max(abs(a[1]), abs(a[2])))


@device
def maximum(a):
    """Returns the largest component."""
    return max(a[0], max(a[1], a[2]))


@device
def luminance(c):
    """Returns the luminance of a linear Rec.709 colour."""
    return _RED * c[0] + _GREEN * c[1] + _BLUE * c[2]


@device
def is_finite(a):
    """Returns True if no component is NaN or infinite."""
    s = a[0] * _ZERO + a[1] * _ZERO + a[2] * _ZERO
    return s == _ZERO


@device
def basis(n):
    """Returns two unit vectors that form a right-handed frame with the unit vector n (Duff et al., JCGT 6(1), 2017)."""
    sign = math.copysign(_ONE, n[2])
    a = -_ONE / (sign + n[2])
    b = n[0] * n[1] * a
    return (_ONE + sign * n[0] * n[0] * a, sign * b, -sign * n[0]), (b, sign + n[1] * n[1] * a, -n[1])


@device
def to_world(s, t, n, v):
    """Returns the vector with coordinates v in the frame (s, t, n)."""
    return (
        s[0] * v[0] + t[0] * v[1] + n[0] * v[2],
        s[1] * v[0] + t[1] * v[1] + n[1] * v[2],
        s[2] * v[0] + t[2] * v[1] + n[2] * v[2],
    )


@device
def to_local(s, t, n, v):
    """Returns the coordinates of v in the frame (s, t, n)."""
    return dot(s, v), dot(t, v), dot(n, v)
