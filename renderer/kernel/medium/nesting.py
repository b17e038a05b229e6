"""Which medium a path is in, and what lies around that: the rows of three media in one word, ten bits each, the innermost lowest.

Beyond the third is the world's medium, which has the number 0. Of one path, or of eight.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import MEDIUM_COLUMNS, MOST_MEDIA
from renderer.jit import device
from renderer.kernel.fetch import row
from renderer.wide.values import lookup, u32, where

__all__ = ["NO_MEDIUM", "beneath", "coefficients", "crossed", "entered", "holds", "left"]

_DIGITS = np.uint32(MOST_MEDIA.bit_length() - 1)
_TWICE = np.uint32(2 * _DIGITS)
_ONE = np.uint32(MOST_MEDIA - 1)
_TWO = np.uint32(MOST_MEDIA**2 - 1)
_THREE = np.uint32(MOST_MEDIA**3 - 1)
_DEEPEST = np.uint32(3)
NO_MEDIUM = np.uint32(0xFFFFFFFF)


@device
def entered(nest, medium):
    """The nest of who was in that one, and goes into the medium."""
    return u32(u32(u32(nest << _DIGITS) | medium) & _THREE)


@device
def _parts(nest):
    return u32(nest & _ONE), u32(u32(nest >> _DIGITS) & _ONE), u32(nest >> _TWICE)


@device
def holds(nest, medium):
    """Whether the medium is in the nest."""
    first, second, third = _parts(nest)
    return (first == medium) | (second == medium) | (third == medium)


@device
def left(nest, medium):
    """The nest of who comes out of the medium: what was entered last goes on, where bodies overlap."""
    first, second, third = _parts(nest)
    without_third = where(third == medium, u32(nest & _TWO), nest)
    without_second = where(second == medium, u32(u32(third << _DIGITS) | first), without_third)
    return where(first == medium, u32(nest >> _DIGITS), without_second)


@device
def beneath(nest, depth, medium):
    """The nest with the medium so far down, 0 ... 2, where it has none yet; as it is beyond that."""
    return u32(nest | u32(medium << u32(_DIGITS * depth))) if depth < _DEEPEST else nest


@device
def crossed(scene, nest, material, front):
    """The nest beyond a surface of that material, which is met from its front or from its back."""
    inside = u32(lookup(scene.material_medium, material))
    beyond = where(front, entered(nest, inside), left(nest, inside))
    return where(inside == NO_MEDIUM, nest, beyond)


@device
def coefficients(scene, nest):
    """Of the innermost medium: (sigma_a + sigma_s and sigma_s, rgb per unit length, g)."""
    ar, ag, ab, sr, sg, sb, g, _ = row(scene.medium, u32(nest & _ONE), MEDIUM_COLUMNS)
    return (ar + sr, ag + sg, ab + sb), (sr, sg, sb), g
