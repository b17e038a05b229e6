"""glTF's metallic-roughness surface: GGX over a diffuse base, Schlick's Fresnel, energy-compensated and reciprocal.

The metal's reflectance is its base colour; the dielectric's is f0 (three channels) to f90, from KHR_materials_ior and
KHR_materials_specular. Light that the dielectric's microfacets transmit is scattered diffusely: the base receives the fraction
(1 - E(wo)) (1 - E(wi)) / (1 - mean) of it, where E is the microfacets' total albedo, so that a white base reflects exactly what
they transmit (Kelemen & Szirmay-Kalos 2001). alpha is roughness squared. Source: the glTF 2.0 specification, appendix B.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.bsdf.energy import ggx_albedo, ggx_mean_albedo, multiple_scattering, schlick_mean
from renderer.kernel.bsdf.fresnel import schlick
from renderer.kernel.bsdf.microfacet import MIN_ALPHA, ggx_density, sample_visible_normal, smith_lambda
from renderer.kernel.sampling.warp import square_to_cosine_hemisphere, square_to_cosine_hemisphere_pdf
from renderer.wide.values import any_of, not_, where, where3, zero_like

__all__ = ["eval_and_pdf_metallic_roughness", "eval_base_of_metallic_roughness", "sample_metallic_roughness"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FOUR = np.float32(4.0)
_INV_PI = np.float32(1.0 / math.pi)
_LEAST_LOSS = np.float32(1e-3)  # lower bound for mirrors that lose energy only at grazing angles
_LEAST = np.float32(1e-6)
_MIN_CHOICE = np.float32(0.125)  # a highlight may be far brighter than its share of the surface's albedo
_BLACK = (_ZERO, _ZERO, _ZERO)


@device
def _view(base, metallic, roughness, f0, f90, wo):
    """Returns the terms of the model that do not depend on the light's direction.

    The terms: (f0 of the mixture, its f90, energy lost by single scattering for wo, the mean of that loss, factor of multiple
    scattering, transmission into the dielectric from wo divided by its mean, probability of sampling the microfacets).
    """
    a, b = ggx_albedo(wo[2], roughness)
    mean_a, mean_b = ggx_mean_albedo(roughness)
    mean = mean_a + mean_b
    dielectric = _ONE - metallic
    mixed = vec.add(vec.scale(base, metallic), vec.scale(f0, dielectric))
    mixed_90 = metallic + f90 * dielectric
    loss = max(_ONE - a - b, _ZERO)
    mean_loss = max(_ONE - mean, _LEAST_LOSS)
    # For the dielectric the largest channel is used for all, so the base below keeps its colour.
    brightest = vec.maximum(f0)
    again = multiple_scattering(schlick_mean(brightest, f90), mean)
    later = dielectric * again
    multiple = (
        later + metallic * multiple_scattering(schlick_mean(base[0], _ONE), mean),
        later + metallic * multiple_scattering(schlick_mean(base[1], _ONE), mean),
        later + metallic * multiple_scattering(schlick_mean(base[2], _ONE), mean),
    )
    passing = _ONE - brightest * a - f90 * b - again * loss
    mean_passing = _ONE - brightest * mean_a - f90 * mean_b - again * mean_loss
    specular = vec.luminance(mixed) * a + mixed_90 * b
    rest = vec.luminance(base) * dielectric * passing + vec.luminance(multiple) * loss
    choice = max(specular / max(specular + rest, _LEAST), _MIN_CHOICE)
    return mixed, mixed_90, loss / mean_loss, multiple, again, passing / max(mean_passing, _LEAST), choice


@device
def _through_base(metallic, f0, f90, again, passing_o, a, b, loss, cosine):
    """Returns f |cos| of the diffuse base if its colour is white. a, b, loss: the microfacets' albedo and its rest for wi."""
    return (_ONE - metallic) * passing_o * (_ONE - vec.maximum(f0) * a - f90 * b - again * loss) * cosine


@device
def eval_base_of_metallic_roughness(base, metallic, roughness, f0, f90, wo, wi):
    """Returns f |cos| of the diffuse base alone, as it is part of `eval_and_pdf_metallic_roughness`."""
    _, _, _, _, again, passing_o, _ = _view(base, metallic, roughness, f0, f90, wo)
    a, b = ggx_albedo(wi[2], roughness)
    diffuse = _through_base(metallic, f0, f90, again, passing_o, a, b, max(_ONE - a - b, _ZERO), wi[2] * _INV_PI)
    return where3((wi[2] <= _ZERO) | (wo[2] <= _ZERO), _BLACK, vec.scale(base, diffuse))


@device
def _above(base, metallic, roughness, f0, f90, view, wo, wi):
    """Returns (f |cos|, pdf per steradian) for local directions wo and wi above the horizon. view: terms from `_view`."""
    mixed, mixed_90, loss_o, multiple, again, passing_o, choice = view
    alpha = max(roughness * roughness, MIN_ALPHA)
    h = vec.normalize(vec.add(wo, wi))
    fresnel = schlick(mixed, mixed_90, vec.dot(wo, h))
    lambda_o = smith_lambda(wo, alpha, alpha)
    lambda_i = smith_lambda(wi, alpha, alpha)
    density = ggx_density(h, alpha, alpha) / (_FOUR * wo[2])
    a, b = ggx_albedo(wi[2], roughness)
    loss = max(_ONE - a - b, _ZERO)
    cosine = wi[2] * _INV_PI
    diffuse = _through_base(metallic, f0, f90, again, passing_o, a, b, loss, cosine)
    f = vec.add(vec.scale(fresnel, density / (_ONE + lambda_o + lambda_i)), vec.scale(base, diffuse))
    f = vec.add(f, vec.scale(multiple, loss_o * loss * cosine))
    pdf = choice * density / (_ONE + lambda_o) + (_ONE - choice) * square_to_cosine_hemisphere_pdf(wi)
    return f, pdf


@device
def _scatter(base, metallic, roughness, f0, f90, view, wo, wi):
    """Returns (f |cos|, pdf per steradian); 0 for wi below the horizon. view: terms from `_view`."""
    none = zero_like(wi[2])
    f, pdf = (none, none, none), none
    below = (wi[2] <= _ZERO) | (wo[2] <= _ZERO)
    if any_of(not_(below)):
        f, pdf = _above(base, metallic, roughness, f0, f90, view, wo, wi)
        f, pdf = where3(below, _BLACK, f), where(below, _ZERO, pdf)
    return f, pdf


@device
def eval_and_pdf_metallic_roughness(base, metallic, roughness, f0, f90, wo, wi):
    """Returns (f |cos| per channel, pdf per steradian) for local directions.

    The two are computed together, since they share most terms.
    """
    view = _view(base, metallic, roughness, f0, f90, wo)
    return _scatter(base, metallic, roughness, f0, f90, view, wo, wi)


@device
def sample_metallic_roughness(base, metallic, roughness, f0, f90, wo, choose, u):
    """Samples a local direction; returns (wi, weight, pdf per steradian).

    choose: selects the microfacets or the diffuse base. u: selects the direction.
    """
    view = _view(base, metallic, roughness, f0, f90, wo)
    mirrored = choose < view[6]
    wi = wo
    if any_of(mirrored):
        alpha = max(roughness * roughness, MIN_ALPHA)
        h = sample_visible_normal(wo, alpha, alpha, u)
        wi = vec.sub(vec.scale(h, _TWO * vec.dot(wo, h)), wo)
    if any_of(not_(mirrored)):
        wi = where3(mirrored, wi, square_to_cosine_hemisphere(u))
    f, pdf = _scatter(base, metallic, roughness, f0, f90, view, wo, wi)
    lost = pdf <= _ZERO
    return wi, where3(lost, _BLACK, vec.scale(f, _ONE / pdf)), where(lost, _ZERO, pdf)
