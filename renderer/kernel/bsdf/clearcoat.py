"""A clearcoat of index 1.5 over a material: KHR_materials_clearcoat. GGX around the coat's normal, given in the base's frame."""

from __future__ import annotations

import numpy as np

from renderer.jit import device, subroutine
from renderer.kernel import vec
from renderer.kernel.bsdf.energy import ggx_albedo, ggx_mean_albedo
from renderer.kernel.bsdf.fresnel import schlick_weight
from renderer.kernel.bsdf.microfacet import MIN_ALPHA, ggx_density, sample_visible_normal, smith_lambda

__all__ = ["clearcoat_albedo", "clearcoat_mean_albedo", "eval_and_pdf_clearcoat", "sample_clearcoat"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FOUR = np.float32(4.0)
_F0 = np.float32(0.04)
_LEAST_COSINE = np.float32(0.01)


@subroutine
def clearcoat_albedo(roughness, cosine):
    """Returns the clearcoat's albedo, 0 to 1, for one direction.

    cosine: of the angle between the direction and the coat's normal.
    """
    a, b = ggx_albedo(cosine, roughness)
    return _F0 * a + b


@subroutine
def clearcoat_mean_albedo(roughness):
    """Returns the clearcoat's mean albedo over the cosine-weighted hemisphere."""
    a, b = ggx_mean_albedo(roughness)
    return _F0 * a + b


@device
def _frame(n, wo):
    """Returns the local frame around the coat's normal n, or around the base's normal if wo is below the coat's horizon."""
    if vec.dot(n, wo) < _LEAST_COSINE:
        n = (_ZERO, _ZERO, _ONE)
    s, t = vec.basis(n)
    return s, t, n


@subroutine
def eval_and_pdf_clearcoat(roughness, normal, wo, wi):
    """Returns (f |cos|, equal for all channels; pdf per steradian) of the clearcoat. wo, wi, normal: in the base's frame."""
    s, t, n = _frame(normal, wo)
    o = vec.to_local(s, t, n, wo)
    i = vec.to_local(s, t, n, wi)
    if i[2] <= _ZERO or o[2] <= _ZERO:
        return _ZERO, _ZERO
    alpha = max(roughness * roughness, MIN_ALPHA)
    h = vec.normalize(vec.add(o, i))
    lambda_o = smith_lambda(o, alpha, alpha)
    lambda_i = smith_lambda(i, alpha, alpha)
    density = ggx_density(h, alpha, alpha) / (_FOUR * o[2])
    reflectance = _F0 + (_ONE - _F0) * schlick_weight(vec.dot(o, h))
    return reflectance * density / (_ONE + lambda_o + lambda_i), density / (_ONE + lambda_o)


@subroutine
def sample_clearcoat(roughness, normal, wo, u):
    """Samples a direction reflected by the clearcoat, in the base's frame; it may be below the base's horizon."""
    s, t, n = _frame(normal, wo)
    o = vec.to_local(s, t, n, wo)
    alpha = max(roughness * roughness, MIN_ALPHA)
    h = sample_visible_normal(o, alpha, alpha, u)
    return vec.to_world(s, t, n, vec.sub(vec.scale(h, _TWO * vec.dot(o, h)), o))
