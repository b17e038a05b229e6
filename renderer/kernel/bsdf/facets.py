"""Dispatch between the two distributions of microfacets: GGX (microfacet.py) and Beckmann (beckmann.py).

`beckmann` is 0 or 1 for a single path; it is None if all paths use GGX, and then Beckmann is not compiled. The test for None is a
separate statement, so that Numba prunes the branch.
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
    """Returns D(h), microfacet area per steradian of h and unit area of the surface."""
    if beckmann is not None:  # noqa: SIM102
        if beckmann != _ZERO:
            return beckmann_density(h, alpha_x, alpha_y)
    return ggx_density(h, alpha_x, alpha_y)


@device
def facet_lambda(beckmann, w, alpha_x, alpha_y):
    """Returns Smith's Lambda for the local direction w."""
    if beckmann is not None:  # noqa: SIM102
        if beckmann != _ZERO:
            return beckmann_lambda(w, alpha_x, alpha_y)
    return smith_lambda(w, alpha_x, alpha_y)


@device
def sample_visible_facet(beckmann, wo, alpha_x, alpha_y, u):
    """Samples a local microfacet normal from the distribution of normals visible from wo; u: two numbers in [0, 1)."""
    if beckmann is not None:  # noqa: SIM102
        if beckmann != _ZERO:
            return sample_visible_beckmann(wo, alpha_x, alpha_y, u)
    return sample_visible_normal(wo, alpha_x, alpha_y, u)


@device
def pdf_visible_facet(beckmann, wo, h, alpha_x, alpha_y):
    """Returns the pdf of `sample_visible_facet`, per steradian of h.

    The pdf of the reflected direction is this divided by 4 wo.h.
    """
    masking = _ONE + facet_lambda(beckmann, wo, alpha_x, alpha_y)
    return max(vec.dot(wo, h), _ZERO) * facet_density(beckmann, h, alpha_x, alpha_y) / (masking * wo[2])
