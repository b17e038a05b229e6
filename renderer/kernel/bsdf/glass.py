"""A smooth boundary between two dielectrics: reflection and refraction by Fresnel's equations."""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.bsdf.fresnel import fresnel_dielectric

__all__ = ["sample_glass"]

_ONE = np.float32(1.0)


@device
def sample_glass(tint, eta, wo, u):
    """(wi, weight, transmitted): reflects with Fresnel's probability, so that the weights are 1 and tint / eta**2.

    The tint colours what passes. Radiance is squeezed into a smaller cone on the denser side: the factor 1 / eta**2, which
    leaving the glass undoes (pbrt 4ed, 9.5.2).
    """
    reflectance, refracted = fresnel_dielectric(wo[2], eta)
    if u < reflectance:
        return (-wo[0], -wo[1], wo[2]), (_ONE, _ONE, _ONE), False
    inverse = _ONE / eta
    return (-wo[0] * inverse, -wo[1] * inverse, -refracted), vec.scale(tint, inverse * inverse), True
