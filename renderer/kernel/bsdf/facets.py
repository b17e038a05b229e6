"""Either distribution of microfacets: GGX (microfacet.py) or Beckmann's (beckmann.py).

`beckmann` is 0 or 1, of a single path; or None, where every path's is GGX and Beckmann's is not compiled. The question for None
stands alone, since Numba leaves out what such a question excludes.
"""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.bsdf.beckmann import beckmann_density, beckmann_lambda, sample_visible_beckmann
from renderer.kernel.bsdf.microfacet import ggx_density, sample_visible_normal, smith_lambda

__all__ = ["facet_density", "facet_lambda", "pdf_visible_facet", "sample_visible_facet"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)


@device
def facet_density(beckmann, h, alpha_x, alpha_y):
    """D(h)."""
    if beckmann is not None:  # noqa: SIM102
        if beckmann != _ZERO:
            return beckmann_density(h, alpha_x, alpha_y)
    return ggx_density(h, alpha_x, alpha_y)


@device
def facet_lambda(beckmann, w, alpha_x, alpha_y):
    """Smith's Lambda."""
    if beckmann is not None:  # noqa: SIM102
        if beckmann != _ZERO:
            return beckmann_lambda(w, alpha_x, alpha_y)
    return smith_lambda(w, alpha_x, alpha_y)


@device
def sample_visible_facet(beckmann, wo, alpha_x, alpha_y, u):
    """A microfacet normal by the area that wo sees of it."""
    if beckmann is not None:  # noqa: SIM102
        if beckmann != _ZERO:
            return sample_visible_beckmann(wo, alpha_x, alpha_y, u)
    return sample_visible_normal(wo, alpha_x, alpha_y, u)


@device
def pdf_visible_facet(beckmann, wo, h, alpha_x, alpha_y):
    """The density of `sample_visible_facet`, per steradian of h. A reflected direction's is this over 4 wo.h."""
    masking = _ONE + facet_lambda(beckmann, wo, alpha_x, alpha_y)
    return max(vec.dot(wo, h), _ZERO) * facet_density(beckmann, h, alpha_x, alpha_y) / (masking * wo[2])
