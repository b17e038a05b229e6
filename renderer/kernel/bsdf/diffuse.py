"""Lambert's ideal diffuse reflection."""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.sampling.warp import square_to_cosine_hemisphere, square_to_cosine_hemisphere_pdf

__all__ = ["eval_diffuse", "pdf_diffuse", "sample_diffuse"]

_ZERO = np.float32(0.0)
_INV_PI = np.float32(1.0 / math.pi)


@device
def eval_diffuse(albedo, wo, wi):
    """f |cos|: albedo / pi times the cosine."""
    return vec.scale(albedo, max(_ZERO, wi[2]) * _INV_PI)


@device
def pdf_diffuse(wo, wi):
    """Per steradian."""
    return square_to_cosine_hemisphere_pdf(wi)


@device
def sample_diffuse(albedo, wo, u):
    """(wi, weight, pdf)."""
    wi = square_to_cosine_hemisphere(u)
    return wi, albedo, square_to_cosine_hemisphere_pdf(wi)
