"""A rough boundary between two dielectrics, and a rough thin pane.

Walter et al., "Microfacet Models for Refraction through Rough Surfaces" (2007), with visible normals. eta is the index beyond
the surface over the index on the viewer's side. Multiple scattering between microfacets is compensated by a diffuse-like lobe on
both sides (glass_energy.py).
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device, subroutine
from renderer.kernel import vec
from renderer.kernel.bsdf.facets import facet_density, facet_lambda, pdf_visible_facet, sample_visible_facet
from renderer.kernel.bsdf.fresnel import fresnel_dielectric, mean_fresnel_dielectric, schlick_weight
from renderer.kernel.bsdf.glass_energy import glass_albedo, glass_mean_albedo
from renderer.kernel.sampling.warp import square_to_cosine_hemisphere

__all__ = ["SMOOTH_GLASS", "eval_and_pdf_pane", "eval_and_pdf_rough_glass", "sample_pane", "sample_rough_glass"]

SMOOTH_GLASS = np.float32(0.03)  # roughness below which glass and metal are treated as smooth

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FOUR = np.float32(4.0)
_NOWHERE = (_ZERO, _ZERO, _ZERO)
_INV_PI = np.float32(1.0 / math.pi)
_LEAST_LOSS = np.float32(1e-3)
_TINY = np.float32(1e-12)


@subroutine
def eval_and_pdf_rough_glass(beckmann, eta, roughness, alpha_x, alpha_y, wo, wi):
    """Returns (f |cos|, pdf per steradian) of white glass, for wi above or below the surface.

    Refracted radiance has the factor 1 / eta**2. beckmann: see facets.py. roughness: of the isotropic surface with the same
    energy loss.
    """
    if wo[2] <= _ZERO or wi[2] == _ZERO:
        return _ZERO, _ZERO
    once, density = _scattered_once(beckmann, eta, alpha_x, alpha_y, wo, wi)
    albedo = glass_albedo(beckmann, wo[2], roughness, eta)
    lost, back = _lost(beckmann, eta, roughness)
    cosine = abs(wi[2]) * _INV_PI
    if wi[2] > _ZERO:
        again = back * (_ONE - albedo) * (_ONE - glass_albedo(beckmann, wi[2], roughness, eta)) / lost * cosine
        return once + again, albedo * density + (_ONE - albedo) * back * cosine
    inside = _ONE / eta
    lost_inside, _ = _lost(beckmann, inside, roughness)
    again = (_ONE - back) * (_ONE - albedo) * (_ONE - glass_albedo(beckmann, -wi[2], roughness, inside)) / lost_inside * cosine
    return once + again * inside * inside, albedo * density + (_ONE - albedo) * (_ONE - back) * cosine


@device
def _lost(beckmann, eta, roughness):
    """Returns (fraction of light lost by single scattering, fraction of the lost light that is finally reflected).

    The first is the mean over the hemisphere.
    """
    lost = max(_ONE - glass_mean_albedo(beckmann, roughness, eta), _LEAST_LOSS)
    beyond = max(_ONE - glass_mean_albedo(beckmann, roughness, _ONE / eta), _LEAST_LOSS)
    # Reciprocal for any two sides, since (1 - mean Fresnel) over eta**2 is the same from both.
    return lost, _ONE - (_ONE - mean_fresnel_dielectric(eta)) * min(beyond / lost, _ONE)


@device
def _scattered_once(beckmann, eta, alpha_x, alpha_y, wo, wi):
    lambda_o = facet_lambda(beckmann, wo, alpha_x, alpha_y)
    lambda_i = facet_lambda(beckmann, wi, alpha_x, alpha_y)
    shadowing = (_ONE + lambda_o) / (_ONE + lambda_o + lambda_i)
    if wi[2] > _ZERO:
        h = vec.normalize(vec.add(wo, wi))
        cosine = vec.dot(wo, h)
        reflectance, _ = fresnel_dielectric(cosine, eta)
        pdf = reflectance * pdf_visible_facet(beckmann, wo, h, alpha_x, alpha_y) / (_FOUR * max(cosine, _TINY))
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
    pdf = (_ONE - reflectance) * pdf_visible_facet(beckmann, wo, h, alpha_x, alpha_y) * jacobian
    return pdf * shadowing / (eta * eta), pdf


@subroutine
def sample_rough_glass(beckmann, eta, roughness, alpha_x, alpha_y, wo, choose, u):
    """Samples a local direction above or below the surface; returns (wi, weight, pdf).

    The weight is 0 if the sampled direction is on the wrong side: below for a reflection, above for a refraction.
    """
    albedo = glass_albedo(beckmann, wo[2], roughness, eta)
    if choose >= albedo:
        w = square_to_cosine_hemisphere(u)
        _, back = _lost(beckmann, eta, roughness)
        return w if choose - albedo < (_ONE - albedo) * back else (w[0], w[1], -w[2])
    choose /= albedo
    h = sample_visible_facet(beckmann, wo, alpha_x, alpha_y, u)
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
def eval_and_pdf_pane(beckmann, f0, f90, alpha_x, alpha_y, wo, wi):
    """Returns (f |cos|, pdf per steradian) of a white thin pane.

    Light that a microfacet does not reflect is transmitted, in the reflected direction mirrored at the pane's plane.
    """
    if wo[2] <= _ZERO or wi[2] == _ZERO:
        return _ZERO, _ZERO
    up = (wi[0], wi[1], abs(wi[2]))
    h = vec.normalize(vec.add(wo, up))
    cosine = vec.dot(wo, h)
    reflectance = _pane_reflectance(f0, f90, cosine)
    lambda_o = facet_lambda(beckmann, wo, alpha_x, alpha_y)
    lambda_i = facet_lambda(beckmann, up, alpha_x, alpha_y)
    share = reflectance if wi[2] > _ZERO else _ONE - reflectance
    density = share * facet_density(beckmann, h, alpha_x, alpha_y) / (_FOUR * wo[2])
    return density / (_ONE + lambda_o + lambda_i), density / (_ONE + lambda_o)


@subroutine
def sample_pane(beckmann, f0, f90, alpha_x, alpha_y, wo, choose, u):
    """Samples a local direction above or below the pane; returns (wi, weight, pdf).

    The weight is 0 if the sampled direction is on the wrong side: below for a reflection, above for a transmission.
    """
    h = sample_visible_facet(beckmann, wo, alpha_x, alpha_y, u)
    cosine = vec.dot(wo, h)
    wi = vec.sub(vec.scale(h, _TWO * cosine), wo)
    if wi[2] <= _ZERO:
        return _NOWHERE
    if choose < _pane_reflectance(f0, f90, cosine):
        return wi
    return wi[0], wi[1], -wi[2]
