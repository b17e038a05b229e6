"""The complete glTF surface: clearcoat over sheen over a mixture of metal, dielectric and glass, as defined by the extensions.

    clearcoat        GGX of index 1.5 around its own normal
    sheen            Charlie
    metal            microfacets, Schlick by the base colour                  fraction: metallic
    glass            rough or smooth boundary, or thin pane                   fraction: (1 - metallic) transmission
    dielectric       microfacets by f0 and f90 over a diffuse base,           fraction: the remainder
                     of which diffuse_transmission is scattered below
    iridescence      a thin film that replaces both Fresnel terms

Layers attenuate the light of those below in both directions. The diffuse base is coupled to them exactly (metallic_roughness.py);
narrow lobes are attenuated by min(T(wo), T(wi)), T = 1 - albedo of the layer, which is reciprocal and conserves energy.

A layered material is given as its parameter row (renderer/arrays/rows.py) with textures looked up by `resolve` in
kernel/material/layers.py.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.arrays import rows
from renderer.arrays.rows import ALPHA_X, ALPHA_Y, COAT_NORMAL, HAS_BECKMANN, IS_PANE
from renderer.jit import device, subroutine
from renderer.kernel import vec
from renderer.kernel.bsdf.clearcoat import eval_and_pdf_clearcoat, sample_clearcoat
from renderer.kernel.bsdf.energy import schlick_mean
from renderer.kernel.bsdf.facets import facet_density, facet_lambda, sample_visible_facet
from renderer.kernel.bsdf.fresnel import fresnel_dielectric, schlick_weight
from renderer.kernel.bsdf.layer_balance import (
    base_view,
    coat_passing,
    dielectric_f0,
    fresnels,
    mean_cosine,
    mean_passing,
    rgb,
    sheen_passing,
    to_anisotropy_frame,
)
from renderer.kernel.bsdf.rough_glass import (
    SMOOTH_GLASS,
    eval_and_pdf_pane,
    eval_and_pdf_rough_glass,
    sample_pane,
    sample_rough_glass,
)
from renderer.kernel.bsdf.sheen import eval_sheen, pdf_sheen, sample_sheen
from renderer.kernel.sampling.warp import square_to_cosine_hemisphere

__all__ = ["eval_and_pdf_layered", "eval_diffuse_layered", "sample_layered"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FOUR = np.float32(4.0)
_BLACK = (_ZERO, _ZERO, _ZERO)
_INV_PI = np.float32(1.0 / math.pi)
_LEAST = np.float32(1e-6)
_MIN_CHOICE = np.float32(0.125)


@device
def _gray(a):
    return a, a, a


@device
def _turned_back(m, w):
    c, s = m[rows.ROTATION], m[rows.ROTATION + 1]
    return c * w[0] - s * w[1], s * w[0] + c * w[1], w[2]


@device
def _glass_is_smooth(m):
    return m[rows.ROUGHNESS] <= SMOOTH_GLASS


@subroutine
def _choices(m, wo):
    """Returns the probabilities of sampling each lobe, in proportion to the lobe's albedo for direction wo.

    The lobes: (clearcoat, sheen, microfacets, diffuse above, diffuse below, glass). m: the material's parameter row.
    """
    a, b, loss, _, again_metal, again, passing, coat, sheen = base_view(m, wo)
    metallic = m[rows.METALLIC]
    glass = (_ONE - metallic) * m[rows.TRANSMISSION]
    dielectric = _ONE - metallic - glass
    base = rgb(m, rows.BASE)
    metal_f, dielectric_f = fresnels(m, mean_cosine(a, b))
    left = coat * sheen
    specular = (metallic * vec.luminance(metal_f) + dielectric * vec.luminance(dielectric_f)) * (a + b)
    below = m[rows.DIFFUSE_TRANSMISSION]
    diffuse = dielectric * passing * (_ONE - below) * vec.luminance(base)
    diffuse += loss * (metallic * vec.luminance(again_metal) + dielectric * again)
    through = dielectric * passing * below * vec.luminance(rgb(m, rows.DIFFUSE_TRANSMISSION_COLOR))
    total = specular + diffuse + through + glass
    specular = max(specular, _MIN_CHOICE * (total - glass)) * left
    varnish = m[rows.CLEARCOAT]
    varnish = max(_ONE - coat, _MIN_CHOICE * varnish) if varnish > _ZERO else _ZERO
    fibres = coat * max(_ONE - sheen, _MIN_CHOICE * vec.maximum(rgb(m, rows.SHEEN_COLOR)))
    diffuse, through, glass = diffuse * left, through * left, glass * left
    scale = _ONE / max(varnish + fibres + specular + diffuse + through + glass, _LEAST)
    return varnish * scale, fibres * scale, specular * scale, diffuse * scale, through * scale, glass * scale


@device
def _glass(m, eta, wo, wi):
    """Returns (f |cos|, pdf per steradian) of the rough glass lobe, untinted, for local directions. m: the parameter row."""
    o = to_anisotropy_frame(m, wo)
    i = to_anisotropy_frame(m, wi)
    if m[IS_PANE] != _ZERO:
        f0 = vec.maximum(dielectric_f0(m))
        return eval_and_pdf_pane(m[HAS_BECKMANN], f0, m[rows.SPECULAR], m[ALPHA_X], m[ALPHA_Y], o, i)
    return eval_and_pdf_rough_glass(m[HAS_BECKMANN], eta, m[rows.ROUGHNESS], m[ALPHA_X], m[ALPHA_Y], o, i)


@device
def _through_base(m, passing_o, left_o, passing_i, coat_i, sheen_i, cosine):
    """Returns f |cos| of a white diffuse base. left_o: what the coat and the sheen let pass for wo."""
    metallic = m[rows.METALLIC]
    dielectric = _ONE - metallic - (_ONE - metallic) * m[rows.TRANSMISSION]
    return dielectric * passing_o * left_o[0] * left_o[1] * passing_i * coat_i * sheen_i / mean_passing(m) * cosine


@device
def _sheen_lobe(m, under_coat, wo, wi):
    return vec.scale(rgb(m, rows.SHEEN_COLOR), under_coat * eval_sheen(m[rows.SHEEN_ROUGHNESS], wo, wi))


@device
def _base_lobe(m, diffuse, wi):
    """Returns f |cos| of the diffuse base, above or below. diffuse: from `_through_base`."""
    below = m[rows.DIFFUSE_TRANSMISSION]
    if wi[2] < _ZERO:
        return vec.scale(rgb(m, rows.DIFFUSE_TRANSMISSION_COLOR), below * diffuse)
    return vec.scale(rgb(m, rows.BASE), (_ONE - below) * diffuse)


@subroutine
def eval_diffuse_layered(m, wo, wi):
    """Returns f |cos| of the diffuse base and the sheen alone, as they are part of `eval_and_pdf_layered`."""
    if wo[2] <= _ZERO or wi[2] == _ZERO:
        return _BLACK
    height = abs(wi[2])
    _, _, _, _, _, _, passing_o, coat_o, sheen_o = base_view(m, wo)
    _, _, _, _, _, _, passing_i, coat_i, sheen_i = base_view(m, (wi[0], wi[1], height))
    f = _base_lobe(m, _through_base(m, passing_o, (coat_o, sheen_o), passing_i, coat_i, sheen_i, height * _INV_PI), wi)
    if wi[2] > _ZERO and vec.maximum(rgb(m, rows.SHEEN_COLOR)) > _ZERO:
        f = vec.add(f, _sheen_lobe(m, min(coat_o, coat_i), wo, wi))
    return f


@subroutine
def eval_and_pdf_layered(m, eta, wo, wi):
    """Returns (f |cos|, pdf per steradian) of all lobes except smooth glass.

    m: (LAYER_SLOTS,), from `resolve`. eta: index beyond the surface over index on this side.
    """
    if wo[2] <= _ZERO or wi[2] == _ZERO:
        return _BLACK, _ZERO
    choose_coat, choose_sheen, choose_specular, choose_diffuse, choose_through, choose_glass = _choices(m, wo)
    _, _, loss_o, mean_loss, again_metal, again, passing_o, coat_o, sheen_o = base_view(m, wo)
    height = abs(wi[2])
    _, _, loss_i, _, _, _, passing_i, coat_i, sheen_i = base_view(m, (wi[0], wi[1], height))
    left = min(coat_o * sheen_o, coat_i * sheen_i)
    metallic = m[rows.METALLIC]
    glass = (_ONE - metallic) * m[rows.TRANSMISSION]
    dielectric = _ONE - metallic - glass
    base = rgb(m, rows.BASE)
    cosine = height * _INV_PI
    diffuse = _through_base(m, passing_o, (coat_o, sheen_o), passing_i, coat_i, sheen_i, cosine)
    f = _BLACK
    pdf = _ZERO
    if glass > _ZERO and not _glass_is_smooth(m):
        white, density = _glass(m, eta, wo, wi)
        again_glass = _ZERO
        if m[IS_PANE] != _ZERO:  # a pane's lost light leaves on both sides
            again_glass = loss_o * loss_i / mean_loss * cosine
            reflectance = schlick_mean(vec.maximum(dielectric_f0(m)), m[rows.SPECULAR])
            again_glass *= reflectance if wi[2] > _ZERO else _ONE - reflectance
        tint = base if wi[2] < _ZERO else (_ONE, _ONE, _ONE)
        f = vec.add(f, vec.scale(tint, glass * left * (white + again_glass)))
        pdf += choose_glass * density
    if wi[2] < _ZERO:
        return vec.add(f, _base_lobe(m, diffuse, wi)), pdf + choose_through * cosine

    f = vec.add(f, _base_lobe(m, diffuse, wi))
    many = vec.add(vec.scale(again_metal, metallic), _gray(dielectric * again))
    f = vec.add(f, vec.scale(many, left * loss_o * loss_i / mean_loss * cosine))
    pdf += choose_diffuse * cosine

    o = to_anisotropy_frame(m, wo)
    i = to_anisotropy_frame(m, wi)
    h = vec.normalize(vec.add(o, i))
    metal_f, dielectric_f = fresnels(m, vec.dot(o, h))
    lambda_o = facet_lambda(m[HAS_BECKMANN], o, m[ALPHA_X], m[ALPHA_Y])
    lambda_i = facet_lambda(m[HAS_BECKMANN], i, m[ALPHA_X], m[ALPHA_Y])
    density = facet_density(m[HAS_BECKMANN], h, m[ALPHA_X], m[ALPHA_Y]) / (_FOUR * wo[2])
    fresnel = vec.add(vec.scale(metal_f, metallic), vec.scale(dielectric_f, dielectric))
    f = vec.add(f, vec.scale(fresnel, left * density / (_ONE + lambda_o + lambda_i)))
    pdf += choose_specular * density / (_ONE + lambda_o)

    if vec.maximum(rgb(m, rows.SHEEN_COLOR)) > _ZERO:
        f = vec.add(f, _sheen_lobe(m, min(coat_o, coat_i), wo, wi))
        pdf += choose_sheen * pdf_sheen(wi)
    if m[rows.CLEARCOAT] > _ZERO:
        varnish, density = eval_and_pdf_clearcoat(m[rows.CLEARCOAT_ROUGHNESS], rgb(m, COAT_NORMAL), wo, wi)
        f = vec.add(f, _gray(m[rows.CLEARCOAT] * varnish))
        pdf += choose_coat * density
    return f, pdf


@subroutine
def _sample_smooth_glass(m, eta, wo, chance, choose):
    """Samples reflection or refraction at the smooth glass lobe: (local wi, weight, radiance scale).

    chance: the probability with which this lobe was chosen. The radiance scale is eta**2 for a refraction, else 1.
    """
    if m[IS_PANE] != _ZERO:
        f0 = vec.maximum(dielectric_f0(m))
        reflectance = f0 + (m[rows.SPECULAR] - f0) * schlick_weight(wo[2])
        down = (-wo[0], -wo[1], -wo[2])
        squeeze = _ONE
    else:
        reflectance, refracted = fresnel_dielectric(wo[2], eta)
        inverse = _ONE / eta
        down = (-wo[0] * inverse, -wo[1] * inverse, -refracted)
        squeeze = eta * eta
    share = (_ONE - m[rows.METALLIC]) * m[rows.TRANSMISSION] / chance
    left = coat_passing(m, wo[2]) * sheen_passing(m, wo[2])
    if choose < reflectance:
        return (-wo[0], -wo[1], wo[2]), _gray(share * left), _ONE
    left = min(left, coat_passing(m, -down[2]) * sheen_passing(m, -down[2]))
    return down, vec.scale(rgb(m, rows.BASE), share * left / squeeze), squeeze


@subroutine
def sample_layered(m, eta, wo, choose, u):
    """Samples a local direction of a layered material: (wi, weight, pdf per steradian, radiance scale).

    The pdf is 0 if smooth glass was chosen.
    """
    coat, sheen, specular, diffuse, through, glass = _choices(m, wo)
    scale = _ONE
    above = True
    at = coat
    if choose < at:
        wi = sample_clearcoat(m[rows.CLEARCOAT_ROUGHNESS], rgb(m, COAT_NORMAL), wo, u)
    elif choose < at + sheen:
        wi = sample_sheen(u)
    elif choose < at + sheen + specular:
        o = to_anisotropy_frame(m, wo)
        h = sample_visible_facet(m[HAS_BECKMANN], o, m[ALPHA_X], m[ALPHA_Y], u)
        wi = _turned_back(m, vec.sub(vec.scale(h, _TWO * vec.dot(o, h)), o))
    elif choose < at + sheen + specular + diffuse:
        wi = square_to_cosine_hemisphere(u)
    elif choose < at + sheen + specular + diffuse + through:
        wi = square_to_cosine_hemisphere(u)
        wi = (wi[0], wi[1], -wi[2])
        above = False
    else:
        rest = min(max((choose - at - sheen - specular - diffuse - through) / max(glass, _LEAST), _ZERO), _ONE)
        if _glass_is_smooth(m):
            wi, weight, scale = _sample_smooth_glass(m, eta, wo, max(glass, _LEAST), rest)
            return wi, weight, _ZERO, scale
        o = to_anisotropy_frame(m, wo)
        if m[IS_PANE] != _ZERO:
            i = sample_pane(m[HAS_BECKMANN], vec.maximum(dielectric_f0(m)), m[rows.SPECULAR], m[ALPHA_X], m[ALPHA_Y], o, rest, u)
        else:
            i = sample_rough_glass(m[HAS_BECKMANN], eta, m[rows.ROUGHNESS], m[ALPHA_X], m[ALPHA_Y], o, rest, u)
            scale = eta * eta if i[2] < _ZERO else _ONE
        wi = _turned_back(m, i)
        above = wi[2] > _ZERO
    if (wi[2] > _ZERO) != above:  # light that hits the surface again
        return wi, _BLACK, _ZERO, _ONE
    f, pdf = eval_and_pdf_layered(m, eta, wo, wi)
    if pdf <= _ZERO:
        return wi, _BLACK, _ZERO, _ONE
    return wi, vec.scale(f, _ONE / pdf), pdf, scale
