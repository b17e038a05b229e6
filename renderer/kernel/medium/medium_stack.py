"""The stack of nested media of a path: the numbers of up to three media in a uint32, ten bits each, the innermost lowest.

Outside all media in the stack is the world's medium, number 0. For one path or for eight lanes.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import MEDIUM_COLUMNS, MOST_MEDIA
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.fetch import row
from renderer.kernel.spectrum.upsampling import coefficients_at, reflectance_at
from renderer.wide.values import lookup, u32, where

__all__ = ["NO_MEDIUM", "beneath", "coefficients", "crossed", "entered", "holds", "innermost", "left", "medium_albedo"]

_DIGITS = np.uint32(MOST_MEDIA.bit_length() - 1)
_TWICE = np.uint32(2 * _DIGITS)
_ONE = np.uint32(MOST_MEDIA - 1)
_TWO = np.uint32(MOST_MEDIA**2 - 1)
_THREE = np.uint32(MOST_MEDIA**3 - 1)
_DEEPEST = np.uint32(3)
_LEAST = np.float32(1e-30)
NO_MEDIUM = np.uint32(0xFFFFFFFF)


@device
def entered(medium_stack, medium):
    """Returns the stack of media after entering a medium. If the stack has three already, the outermost is dropped."""
    return u32(u32(u32(medium_stack << _DIGITS) | medium) & _THREE)


@device
def _parts(medium_stack):
    return u32(medium_stack & _ONE), u32(u32(medium_stack >> _DIGITS) & _ONE), u32(medium_stack >> _TWICE)


@device
def holds(medium_stack, medium):
    """Returns True if the medium is in the stack."""
    first, second, third = _parts(medium_stack)
    return (first == medium) | (second == medium) | (third == medium)


@device
def left(medium_stack, medium):
    """Returns the stack of media after leaving a medium. Media entered later remain in the stack, since bodies may overlap."""
    first, second, third = _parts(medium_stack)
    without_third = where(third == medium, u32(medium_stack & _TWO), medium_stack)
    without_second = where(second == medium, u32(u32(third << _DIGITS) | first), without_third)
    return where(first == medium, u32(medium_stack >> _DIGITS), without_second)


@device
def beneath(medium_stack, depth, medium):
    """Returns the stack of media with `medium` written at a depth that is not in use yet, 0 to 2 from the innermost.

    For greater depths the stack is unchanged.
    """
    return u32(medium_stack | u32(medium << u32(_DIGITS * depth))) if depth < _DEEPEST else medium_stack


@device
def crossed(scene, medium_stack, material, front):
    """Returns the stack of media after crossing a surface with this material.

    front: whether the surface was hit from its front.
    """
    inside = u32(lookup(scene.material_medium, material))
    beyond = where(front, entered(medium_stack, inside), left(medium_stack, inside))
    return where(inside == NO_MEDIUM, medium_stack, beyond)


@device
def innermost(medium_stack):
    """Returns the row of the innermost medium."""
    return u32(medium_stack & _ONE)


@device
def coefficients(scene, medium_stack, wavelengths):
    """Returns the coefficients of the innermost medium: (sigma_a + sigma_s, sigma_s, g).

    The first two are rgb per unit length; g is the mean cosine of the scattering angle. wavelengths: of the path
    (kernel/spectrum), at which a colour's extinction is a smooth spectrum and its albedo a reflectance; None in RGB.
    """
    ar, ag, ab, sr, sg, sb, g, _ = row(scene.medium, u32(medium_stack & _ONE), MEDIUM_COLUMNS)
    sigma_t, sigma_s = (ar + sr, ag + sg, ab + sb), (sr, sg, sb)
    if scene.spectrum is not None:
        albedo = sr / max(sigma_t[0], _LEAST), sg / max(sigma_t[1], _LEAST), sb / max(sigma_t[2], _LEAST)
        sigma_t = coefficients_at(scene, sigma_t, wavelengths)
        sigma_s = vec.mul(sigma_t, reflectance_at(scene, albedo, wavelengths))
    return sigma_t, sigma_s, g


@device
def medium_albedo(scene, medium_stack):
    """Returns the single-scattering albedo, rgb, of the innermost medium, also where a path has wavelengths."""
    ar, ag, ab, sr, sg, sb, _, _ = row(scene.medium, u32(medium_stack & _ONE), MEDIUM_COLUMNS)
    return sr / max(ar + sr, _LEAST), sg / max(ag + sg, _LEAST), sb / max(ab + sb, _LEAST)
