"""Ideal diffuse reflection (Lambert)."""

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
    """Returns f |cos| per channel, albedo / pi times the cosine of wi, for local directions."""
    return vec.scale(albedo, max(_ZERO, wi[2]) * _INV_PI)


@device
def pdf_diffuse(wo, wi):
    """Returns the pdf of `sample_diffuse`, per steradian."""
    return square_to_cosine_hemisphere_pdf(wi)


@device
def sample_diffuse(albedo, wo, u):
    """Samples a cosine-weighted local direction: (wi, weight, pdf per steradian)."""
    wi = square_to_cosine_hemisphere(u)
    return wi, albedo, square_to_cosine_hemisphere_pdf(wi)
