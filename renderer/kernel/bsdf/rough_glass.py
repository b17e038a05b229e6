"""A rough boundary between two dielectrics, and a rough thin pane.

Walter et al., "Microfacet Models for Refraction through Rough Surfaces" (2007), with visible normals. eta is the index beyond
over the index on the viewer's side. What the microfacets scatter more than once is lost: of white glass at ior 1.5 seen at
45 degrees, about 1 % at alpha 0.1, 7 % at 0.5. (The pane gets it back.)
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device, subroutine
from renderer.kernel import vec
from renderer.kernel.bsdf.fresnel import fresnel_dielectric, schlick_weight
from renderer.kernel.bsdf.microfacet import ggx_density, pdf_visible_normal, sample_visible_normal, smith_lambda

__all__ = ["eval_and_pdf_pane", "eval_and_pdf_rough_glass", "sample_pane", "sample_rough_glass"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FOUR = np.float32(4.0)
_NOWHERE = (_ZERO, _ZERO, _ZERO)
_TINY = np.float32(1e-12)


@subroutine
def eval_and_pdf_rough_glass(eta, alpha_x, alpha_y, wo, wi):
    """(f |cos|, pdf) of white glass, above and below; radiance is squeezed by 1 / eta**2 on its way in."""
    if wo[2] <= _ZERO or wi[2] == _ZERO:
        return _ZERO, _ZERO
    lambda_o = smith_lambda(wo, alpha_x, alpha_y)
    lambda_i = smith_lambda(wi, alpha_x, alpha_y)
    shadowing = (_ONE + lambda_o) / (_ONE + lambda_o + lambda_i)
    if wi[2] > _ZERO:
        h = vec.normalize(vec.add(wo, wi))
        cosine = vec.dot(wo, h)
        reflectance, _ = fresnel_dielectric(cosine, eta)
        pdf = reflectance * pdf_visible_normal(wo, h, alpha_x, alpha_y) / (_FOUR * max(cosine, _TINY))
        return pdf * shadowing, pdf
    h = vec.add(wo, vec.scale(wi, eta))
    square = vec.dot(h, h)
    if not square > _TINY:
        return _ZERO, _ZERO
    h = vec.scale(h, math.copysign(_ONE, h[2]) / math.sqrt(square))
    cosine = vec.dot(wo, h)
    cosine_i = vec.dot(wi, h)
    if cosine <= _ZERO or cosine_i >= _ZERO:
        return _ZERO, _ZERO
    reflectance, _ = fresnel_dielectric(cosine, eta)
    denominator = cosine_i + cosine / eta
    jacobian = -cosine_i / max(denominator * denominator, _TINY)
    pdf = (_ONE - reflectance) * pdf_visible_normal(wo, h, alpha_x, alpha_y) * jacobian
    return pdf * shadowing / (eta * eta), pdf


@subroutine
def sample_rough_glass(eta, alpha_x, alpha_y, wo, choose, u):
    """A direction, above or below; zero where light meets the surface again."""
    h = sample_visible_normal(wo, alpha_x, alpha_y, u)
    cosine = vec.dot(wo, h)
    reflectance, refracted = fresnel_dielectric(cosine, eta)
    if choose < reflectance:
        wi = vec.sub(vec.scale(h, _TWO * cosine), wo)
        return wi if wi[2] > _ZERO else _NOWHERE
    inverse = _ONE / eta
    wi = vec.normalize(vec.sub(vec.scale(h, cosine * inverse - refracted), vec.scale(wo, inverse)))
    return wi if wi[2] < _ZERO else _NOWHERE


@device
def _pane_reflectance(f0, f90, cosine):
    return f0 + (f90 - f0) * schlick_weight(cosine)


@subroutine
def eval_and_pdf_pane(f0, f90, alpha_x, alpha_y, wo, wi):
    """(f |cos|, pdf) of a white thin pane: what its microfacets do not reflect passes, mirrored at the pane's plane."""
    if wo[2] <= _ZERO or wi[2] == _ZERO:
        return _ZERO, _ZERO
    up = (wi[0], wi[1], abs(wi[2]))
    h = vec.normalize(vec.add(wo, up))
    cosine = vec.dot(wo, h)
    reflectance = _pane_reflectance(f0, f90, cosine)
    lambda_o = smith_lambda(wo, alpha_x, alpha_y)
    lambda_i = smith_lambda(up, alpha_x, alpha_y)
    share = reflectance if wi[2] > _ZERO else _ONE - reflectance
    density = share * ggx_density(h, alpha_x, alpha_y) / (_FOUR * wo[2])
    return density / (_ONE + lambda_o + lambda_i), density / (_ONE + lambda_o)


@subroutine
def sample_pane(f0, f90, alpha_x, alpha_y, wo, choose, u):
    """A direction, above or below; zero where light meets the surface again."""
    h = sample_visible_normal(wo, alpha_x, alpha_y, u)
    cosine = vec.dot(wo, h)
    wi = vec.sub(vec.scale(h, _TWO * cosine), wo)
    if wi[2] <= _ZERO:
        return _NOWHERE
    if choose < _pane_reflectance(f0, f90, cosine):
        return wi
    return wi[0], wi[1], -wi[2]
