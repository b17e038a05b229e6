"""Conductors with a complex index of refraction eta + i k, smooth or rough."""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.bsdf.brushed_energy import brushed_albedo, brushed_mean_albedo
from renderer.kernel.bsdf.energy import multiple_scattering
from renderer.kernel.bsdf.facets import facet_density, facet_lambda, sample_visible_facet
from renderer.kernel.bsdf.fresnel import fresnel_conductor
from renderer.kernel.sampling.warp import square_to_cosine_hemisphere, square_to_cosine_hemisphere_pdf
from renderer.wide.values import any_of, not_, where, where3, zero_like

__all__ = ["eval_and_pdf_conductor", "fresnel_rgb", "sample_conductor", "sample_smooth_conductor"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FOUR = np.float32(4.0)
_INV_PI = np.float32(1.0 / math.pi)
_LEAST_LOSS = np.float32(1e-3)
_BLACK = (_ZERO, _ZERO, _ZERO)


@device
def fresnel_rgb(cosine, eta, k):
    """Returns the Fresnel reflectance, rgb, of a conductor of index eta + i k (rgb each)."""
    return (
        fresnel_conductor(cosine, eta[0], k[0]),
        fresnel_conductor(cosine, eta[1], k[1]),
        fresnel_conductor(cosine, eta[2], k[2]),
    )


@device
def _albedo(beckmann, w, roughness, alpha_x, alpha_y):
    """Returns the single-scattering albedo of perfectly reflecting microfacets for direction w.

    It is used as the probability of sampling the microfacets rather than the multiple-scattering lobe.
    """
    a, b = brushed_albedo(beckmann, w, roughness, alpha_x, alpha_y)
    return a + b


@device
def _above(beckmann, eta, k, mean_fresnel, roughness, alpha_x, alpha_y, wo, wi):
    """Returns (f |cos|, pdf per steradian) of a rough conductor, for local directions wo and wi above the horizon."""
    h = vec.normalize(vec.add(wo, wi))
    lambda_o = facet_lambda(beckmann, wo, alpha_x, alpha_y)
    lambda_i = facet_lambda(beckmann, wi, alpha_x, alpha_y)
    density = facet_density(beckmann, h, alpha_x, alpha_y) / (_FOUR * wo[2])
    f = vec.scale(fresnel_rgb(vec.dot(wo, h), eta, k), density / (_ONE + lambda_o + lambda_i))
    a, b = brushed_mean_albedo(beckmann, roughness, alpha_x, alpha_y)
    mean = a + b
    choice = _albedo(beckmann, wo, roughness, alpha_x, alpha_y)
    lost_i = max(_ONE - _albedo(beckmann, wi, roughness, alpha_x, alpha_y), _ZERO)
    lost = max(_ONE - choice, _ZERO) * lost_i / max(_ONE - mean, _LEAST_LOSS) * wi[2] * _INV_PI
    again = (
        lost * multiple_scattering(mean_fresnel[0], mean),
        lost * multiple_scattering(mean_fresnel[1], mean),
        lost * multiple_scattering(mean_fresnel[2], mean),
    )
    pdf = choice * density / (_ONE + lambda_o) + (_ONE - choice) * square_to_cosine_hemisphere_pdf(wi)
    return vec.add(f, again), pdf


@device
def eval_and_pdf_conductor(beckmann, eta, k, mean_fresnel, roughness, alpha_x, alpha_y, wo, wi):
    """Returns (f |cos| per channel, pdf per steradian) for local directions.

    beckmann: see facets.py. mean_fresnel: the cosine-weighted mean over the hemisphere. roughness: the square root of both alphas
    if they are equal.
    """
    none = zero_like(wi[2])
    f, pdf = (none, none, none), none
    below = (wi[2] <= _ZERO) | (wo[2] <= _ZERO)
    if any_of(not_(below)):
        f, pdf = _above(beckmann, eta, k, mean_fresnel, roughness, alpha_x, alpha_y, wo, wi)
        f, pdf = where3(below, _BLACK, f), where(below, _ZERO, pdf)
    return f, pdf


@device
def sample_conductor(beckmann, eta, k, mean_fresnel, roughness, alpha_x, alpha_y, wo, choose, u):
    """Samples a local direction on a rough conductor: (wi, weight, pdf per steradian)."""
    mirrored = choose < _albedo(beckmann, wo, roughness, alpha_x, alpha_y)
    wi = wo
    if any_of(mirrored):
        h = sample_visible_facet(beckmann, wo, alpha_x, alpha_y, u)
        wi = vec.sub(vec.scale(h, _TWO * vec.dot(wo, h)), wo)
    if any_of(not_(mirrored)):
        wi = where3(mirrored, wi, square_to_cosine_hemisphere(u))
    f, pdf = eval_and_pdf_conductor(beckmann, eta, k, mean_fresnel, roughness, alpha_x, alpha_y, wo, wi)
    lost = pdf <= _ZERO
    return wi, where3(lost, _BLACK, vec.scale(f, _ONE / pdf)), where(lost, _ZERO, pdf)


@device
def sample_smooth_conductor(eta, k, wo):
    """Returns (wi, weight) of a smooth conductor. wi: the local mirror direction."""
    return (-wo[0], -wo[1], wo[2]), fresnel_rgb(wo[2], eta, k)
