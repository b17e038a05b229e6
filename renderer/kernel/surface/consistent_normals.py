"""Consistent shading normals: those for which the mirror direction of the viewer is above the geometric surface.

A vertex normal or mapped normal may deviate so far from the facet that the mirror direction points below it, where the ray would
hit its own facet. Keller et al., "The Iray Light Transport Simulation and Rendering System" (2017), and Cycles rotate such
normals back; Schuessler et al., "Microfacet-based Normal Mapping" (2017), discuss the black spots.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.polynomial import acos, atan2, sincos_turns
from renderer.wide.values import any_of, not_, where3

__all__ = ["consistent_normal", "is_consistent", "least_height"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_INV_2PI = np.float32(0.5 / math.pi)
_LEAST_HEIGHT = np.float32(0.01)  # sine of the least angle between reflected ray and facet, or
_VIEWER_FRACTION = np.float32(0.9)  # this fraction of the sine of the viewer's angle, if that is less


@device
def least_height(height):
    """Returns the smallest allowed sine of the angle between a reflected ray and the facet.

    height: the sine of the angle between the direction to the viewer and the facet.
    """
    return min(_VIEWER_FRACTION * height, _LEAST_HEIGHT)


@device
def is_consistent(n, geometric, wo):
    """Returns True if the mirror direction of wo at the normal n leaves the surface. All three are unit."""
    height = vec.dot(geometric, wo)
    mirrored = _TWO * vec.dot(n, wo) * vec.dot(n, geometric) - height
    return mirrored >= least_height(height)


@subroutine
def consistent_normal(n, geometric, wo):
    """Returns n, rotated towards the geometric normal by the least angle for which the mirror direction of wo leaves the surface.

    With n = sin a x + cos a g in the plane of n and the geometric normal g, and wo's coordinates (p, q) there, the mirror
    direction has the height p sin 2a + q cos 2a = r cos(2a - phi). All three are unit. wo is on the geometric normal's side.
    """
    never_inline()
    height = vec.dot(geometric, wo)
    least = least_height(height)
    good = is_consistent(n, geometric, wo) & (vec.dot(n, wo) > _ZERO)
    if any_of(not_(good)):
        x = vec.sub(n, vec.scale(geometric, vec.dot(n, geometric)))
        square = vec.dot(x, x)
        x = vec.scale(x, _ONE / math.sqrt(square))
        along = vec.dot(x, wo)
        reach = math.sqrt(along * along + height * height)
        double = atan2(along, height) + acos(least / reach)
        sine, cosine = sincos_turns(_HALF * double * _INV_2PI)
        turned = vec.normalize(vec.add(vec.scale(x, sine), vec.scale(geometric, cosine)))
        turned = where3((square > _ZERO) & (reach > least), turned, geometric)
        n = where3(good, n, turned)
    return n
