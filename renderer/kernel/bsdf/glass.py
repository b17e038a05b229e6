"""A smooth boundary between two dielectrics: reflection and refraction by Fresnel's equations."""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.bsdf.fresnel import fresnel_dielectric
from renderer.wide.values import not_, where3

__all__ = ["sample_glass"]

_ONE = np.float32(1.0)


@device
def sample_glass(tint, eta, wo, u):
    """Chooses reflection or refraction by the Fresnel reflectance, and returns (local wi, weight, whether transmitted).

    The weight is 1 for reflection and tint / eta**2 for refraction. The factor 1 / eta**2 is the compression of radiance into a
    smaller cone on the denser side, which is reversed when the path leaves the glass (pbrt 4ed, 9.5.2).
    """
    reflectance, refracted = fresnel_dielectric(wo[2], eta)
    reflected = u < reflectance
    inverse = _ONE / eta
    wi = where3(reflected, (-wo[0], -wo[1], wo[2]), (-wo[0] * inverse, -wo[1] * inverse, -refracted))
    weight = where3(reflected, (_ONE, _ONE, _ONE), vec.scale(tint, inverse * inverse))
    return wi, weight, not_(reflected)
