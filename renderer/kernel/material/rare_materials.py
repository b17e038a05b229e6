"""Scattering by the rarer kinds of materials, given their looked-up parameters, and at vertices in a medium."""

from __future__ import annotations

import numpy as np

from renderer.arrays import rows
from renderer.arrays.rows import (
    ALPHA_X,
    ALPHA_Y,
    BLINN_PHONG,
    CONDUCTOR,
    HAIR,
    HAS_BECKMANN,
    HUANG,
    LAYERED,
    MEDIUM,
    PLASTIC,
)
from renderer.jit import device, never_inline, subroutine
from renderer.kernel.bsdf.blinn_phong import eval_and_pdf_blinn_phong, eval_base_of_blinn_phong, sample_blinn_phong
from renderer.kernel.bsdf.conductor import eval_and_pdf_conductor, sample_conductor, sample_smooth_conductor
from renderer.kernel.bsdf.hair import eval_and_pdf_hair, sample_hair
from renderer.kernel.bsdf.huang import eval_and_pdf_huang, sample_huang
from renderer.kernel.bsdf.layered import eval_and_pdf_layered, eval_diffuse_layered, sample_layered
from renderer.kernel.bsdf.plastic import eval_and_pdf_plastic, eval_base_of_plastic, sample_plastic
from renderer.kernel.bsdf.rough_glass import SMOOTH_GLASS
from renderer.kernel.medium.henyey_greenstein import (
    eval_henyey_greenstein,
    pdf_henyey_greenstein,
    sample_henyey_greenstein,
)
from renderer.prune_absent_features import where_present

__all__ = ["eval_diffuse_rare", "eval_rare", "sample_rare"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_BLACK = (_ZERO, _ZERO, _ZERO)
_WHITE = (_ONE, _ONE, _ONE)


@device
def _conductor(m):
    """Returns a conductor's parameters from its row m: eta, k, mean Fresnel reflectance, roughness and both alphas."""
    return (
        (m[rows.ETA], m[rows.ETA + 1], m[rows.ETA + 2]),
        (m[rows.K], m[rows.K + 1], m[rows.K + 2]),
        (m[rows.MEAN_FRESNEL], m[rows.MEAN_FRESNEL + 1], m[rows.MEAN_FRESNEL + 2]),
        m[rows.ROUGHNESS],
        m[ALPHA_X],
        m[ALPHA_Y],
    )


@device
def _turned(m, w, sign):
    """Returns the direction w rotated about the normal by the anisotropy's angle.

    sign: 1 rotates from the local frame into the anisotropy's frame, -1 back.
    """
    c, s = m[rows.ROTATION], sign * m[rows.ROTATION + 1]
    return c * w[0] + s * w[1], c * w[1] - s * w[0], w[2]


@device
def _kd_ks(m):
    return (
        (m[rows.BASE], m[rows.BASE + 1], m[rows.BASE + 2]),
        (m[rows.SPECULAR_COLOR], m[rows.SPECULAR_COLOR + 1], m[rows.SPECULAR_COLOR + 2]),
    )


@subroutine
def eval_rare(has, kind, m, eta, wo, wi):
    """Returns (f |cos|, pdf per steradian) like `eval_material`, for the rarer kinds, from their looked-up parameters m."""
    never_inline()
    if has.layers is not None and kind == LAYERED:
        return eval_and_pdf_layered(m, eta, wo, wi)
    if kind == CONDUCTOR:
        index, k, mean, roughness, alpha_x, alpha_y = _conductor(m)
        o, i = _turned(m, wo, _ONE), _turned(m, wi, _ONE)
        beckmann = where_present(has.layers, m[HAS_BECKMANN])
        return eval_and_pdf_conductor(beckmann, index, k, mean, roughness, alpha_x, alpha_y, o, i)
    if has.media is not None and kind == MEDIUM:
        phase = eval_henyey_greenstein(m[rows.SUBSURFACE_ANISOTROPY], wi)
        return (phase, phase, phase), pdf_henyey_greenstein(m[rows.SUBSURFACE_ANISOTROPY], wi)
    if has.layers is not None and kind == BLINN_PHONG:
        kd, ks = _kd_ks(m)
        return eval_and_pdf_blinn_phong(kd, ks, m[rows.SHININESS], wo, wi)
    if has.layers is not None and kind == PLASTIC:
        return eval_and_pdf_plastic(m, wo, wi)
    if has.hair is not None and kind == HAIR:
        return eval_and_pdf_hair(m, wo, wi)
    if has.huang is not None and kind == HUANG:
        return eval_and_pdf_huang(where_present(has.layers, m[HAS_BECKMANN]), m, wo, wi)
    return _BLACK, _ZERO


@subroutine
def eval_diffuse_rare(has, kind, m, wo, wi):
    """Returns f |cos| of the diffuse lobes alone, as they are part of `eval_rare`."""
    never_inline()
    if has.layers is not None and kind == LAYERED:
        return eval_diffuse_layered(m, wo, wi)
    if has.layers is not None and kind == BLINN_PHONG:
        return eval_base_of_blinn_phong(_kd_ks(m)[0], wo, wi)
    if has.layers is not None and kind == PLASTIC:
        return eval_base_of_plastic(m, wo, wi)
    return _BLACK


@subroutine
def sample_rare(has, kind, m, eta, wo, choose, u):
    """Samples a local direction like `sample_material`, for the rarer kinds, from their looked-up parameters m.

    Returns (wi, weight, pdf per steradian, radiance scale).
    """
    never_inline()
    if has.layers is not None and kind == LAYERED:
        return sample_layered(m, eta, wo, choose, u)
    if kind == CONDUCTOR:
        index, k, mean, roughness, alpha_x, alpha_y = _conductor(m)
        if roughness <= SMOOTH_GLASS:
            wi, weight = sample_smooth_conductor(index, k, wo)
            return wi, weight, _ZERO, _ONE
        o = _turned(m, wo, _ONE)
        beckmann = where_present(has.layers, m[HAS_BECKMANN])
        i, weight, pdf = sample_conductor(beckmann, index, k, mean, roughness, alpha_x, alpha_y, o, choose, u)
        return _turned(m, i, -_ONE), weight, pdf, _ONE
    if has.media is not None and kind == MEDIUM:
        wi = sample_henyey_greenstein(m[rows.SUBSURFACE_ANISOTROPY], u)
        return wi, _WHITE, pdf_henyey_greenstein(m[rows.SUBSURFACE_ANISOTROPY], wi), _ONE
    if has.layers is not None and kind == BLINN_PHONG:
        kd, ks = _kd_ks(m)
        wi, weight, pdf = sample_blinn_phong(kd, ks, m[rows.SHININESS], wo, choose, u)
        return wi, weight, pdf, _ONE
    if has.layers is not None and kind == PLASTIC:
        wi, weight, pdf = sample_plastic(m, wo, choose, u)
        return wi, weight, pdf, _ONE
    if has.hair is not None and kind == HAIR:
        wi, weight, pdf = sample_hair(m, wo, choose, u)
        return wi, weight, pdf, _ONE
    if has.huang is not None and kind == HUANG:
        wi, weight, pdf = sample_huang(where_present(has.layers, m[HAS_BECKMANN]), m, wo, choose, u)
        return wi, weight, pdf, _ONE
    return (_ZERO, _ZERO, _ONE), _BLACK, _ZERO, _ONE
