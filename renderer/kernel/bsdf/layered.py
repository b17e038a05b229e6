"""The whole glTF surface: clearcoat over sheen over the mixture of metal, dielectric and glass, each as its extension says.

    clearcoat        GGX of a varnish, ior 1.5, about its own normal
    sheen            Charlie
    metal            GGX, Schlick by the base colour                  share: metallic
    glass            rough or smooth boundary, or thin pane           share: (1 - metallic) transmission
    dielectric       GGX by f0 and f90 over a diffuse base,           share: the rest
                     of which diffuse_transmission goes below
    iridescence      a thin film that replaces both Fresnels

Layers take light from what is below them, both ways. The diffuse base is coupled to them exactly (metallic_roughness.py);
of what is narrow, min(T(wo), T(wi)) is left, T = 1 - albedo of the layer: reciprocal, and never too much.

A layered material comes as its row (renderer/kernel/rows.py), textures looked up, by `resolve` in kernel/layers.py.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device, subroutine
from renderer.kernel import rows, vec
from renderer.kernel.bsdf.energy import ggx_albedo, ggx_mean_albedo, multiple_scattering, schlick_mean
from renderer.kernel.bsdf.fresnel import fresnel_dielectric, schlick, schlick_weight
from renderer.kernel.bsdf.iridescence import film_reflectance
from renderer.kernel.bsdf.microfacet import MIN_ALPHA, ggx_density, sample_visible_normal, smith_lambda
from renderer.kernel.bsdf.rough_glass import eval_and_pdf_pane, eval_and_pdf_rough_glass, sample_pane, sample_rough_glass
from renderer.kernel.bsdf.sheen import eval_sheen, pdf_sheen, sample_sheen, sheen_albedo, sheen_mean_albedo
from renderer.kernel.polynomial import power
from renderer.kernel.warp import square_to_cosine_hemisphere

__all__ = [
    "ALPHA_X",
    "ALPHA_Y",
    "COAT_NORMAL",
    "FILM_MEAN",
    "IS_PANE",
    "LAYER_SLOTS",
    "SMOOTH_GLASS",
    "eval_and_pdf_layered",
    "fresnels",
    "sample_layered",
]

# What `resolve` adds to the row's columns.
COAT_NORMAL = rows.COLUMNS  # in the shading frame
ALPHA_X = rows.COLUMNS + 3
ALPHA_Y = rows.COLUMNS + 4
IS_PANE = rows.COLUMNS + 5  # 0 or 1: glass does not refract
FILM_MEAN = rows.COLUMNS + 6  # reflectance over the hemisphere with a film: metal, then dielectric
LAYER_SLOTS = rows.COLUMNS + 12

SMOOTH_GLASS = np.float32(0.03)  # roughness below which glass is taken for smooth

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FOUR = np.float32(4.0)
_BLACK = (_ZERO, _ZERO, _ZERO)
_INV_PI = np.float32(1.0 / math.pi)
_LEAST = np.float32(1e-6)
_LEAST_LOSS = np.float32(1e-3)
_MIN_CHOICE = np.float32(0.125)
_COAT_F0 = np.float32(0.04)
_FIFTH = np.float32(0.2)
_LEAST_COSINE = np.float32(0.01)
# Two layers that both take more light at grazing angles leave more together than the product of their means. For two by
# Schlick, the covariance of what they take is this times the products of (mean - facing): 21**2 (1 / 66 - 1 / 441).
_COVARIANCE = np.float32(21.0**2 * (1.0 / 66.0 - 1.0 / 441.0))


@device
def _rgb(m, column):
    return m[column], m[column + 1], m[column + 2]


@device
def _mix(a, b, t):
    return vec.add(vec.scale(a, _ONE - t), vec.scale(b, t))


@device
def _gray(a):
    return a, a, a


@device
def _dielectric_f0(m):
    return vec.scale(_rgb(m, rows.F0), m[rows.SPECULAR])


@device
def _schlick_mean_rgb(f0, f90):
    return schlick_mean(f0[0], f90), schlick_mean(f0[1], f90), schlick_mean(f0[2], f90)


@device
def _scattered_again(mean_fresnel, mean_albedo):
    return (
        multiple_scattering(mean_fresnel[0], mean_albedo),
        multiple_scattering(mean_fresnel[1], mean_albedo),
        multiple_scattering(mean_fresnel[2], mean_albedo),
    )


@subroutine
def fresnels(m, cosine):
    """Reflectance of (metal, dielectric) at a microfacet."""
    base = _rgb(m, rows.BASE)
    f0 = _dielectric_f0(m)
    metal = schlick(base, _ONE, cosine)
    dielectric = schlick(f0, m[rows.SPECULAR], cosine)
    film = m[rows.IRIDESCENCE]
    if film > _ZERO:
        metal = _mix(metal, film_reflectance(base, m[rows.IRIDESCENCE_IOR], m[rows.THICKNESS], cosine), film)
        dielectric = _mix(dielectric, film_reflectance(f0, m[rows.IRIDESCENCE_IOR], m[rows.THICKNESS], cosine), film)
    return metal, dielectric


@device
def _mean_cosine(a, b):
    """The cosine at which Schlick's term is what the microfacets show of it: those that are seen do not all lie flat."""
    return _ONE - power(b / max(a + b, _LEAST), _FIFTH)


@subroutine
def _dielectric_albedo(m, cosine, a, b, again, loss):
    """What the dielectric's microfacets take of light from one direction, all told: of the channel that they take most of."""
    film = m[rows.IRIDESCENCE]
    bare = vec.maximum(_dielectric_f0(m)) * a + m[rows.SPECULAR] * b
    if film > _ZERO:
        _, reflected = fresnels(m, _mean_cosine(a, b))  # the film's share is in there
        bare = vec.maximum(reflected) * (a + b)
    return min(bare + again * loss, _ONE)


@subroutine
def _coat_passing(m, cosine):
    """What the clearcoat leaves of light from one direction."""
    a, b = ggx_albedo(cosine, m[rows.CLEARCOAT_ROUGHNESS])
    return _ONE - m[rows.CLEARCOAT] * (_COAT_F0 * a + b)


@subroutine
def _sheen_passing(m, cosine):
    """What the sheen leaves."""
    color = vec.maximum(_rgb(m, rows.SHEEN_COLOR))
    return _ONE - color * sheen_albedo(cosine, m[rows.SHEEN_ROUGHNESS]) if color > _ZERO else _ONE


@device
def _base_view(m, cosine):
    """The base towards one direction: (a, b, loss, mean loss, scattered again by metal, by dielectric, what passes into the
    dielectric, what is left by coat, by sheen)."""
    rough = m[rows.ROUGHNESS]
    a, b = ggx_albedo(cosine, rough)
    mean_a, mean_b = ggx_mean_albedo(rough)
    mean = mean_a + mean_b
    loss = max(_ONE - a - b, _ZERO)
    base = _rgb(m, rows.BASE)
    f0 = _dielectric_f0(m)
    if m[rows.IRIDESCENCE] > _ZERO:
        metal_mean, dielectric_mean = _rgb(m, FILM_MEAN), _rgb(m, FILM_MEAN + 3)
    else:
        metal_mean, dielectric_mean = _schlick_mean_rgb(base, _ONE), _schlick_mean_rgb(f0, m[rows.SPECULAR])
    again_metal = _scattered_again(metal_mean, mean)
    again = multiple_scattering(vec.maximum(dielectric_mean), mean)
    passing = _ONE - _dielectric_albedo(m, cosine, a, b, again, loss)
    return (
        a,
        b,
        loss,
        max(_ONE - mean, _LEAST_LOSS),
        again_metal,
        again,
        passing,
        _coat_passing(m, cosine),
        _sheen_passing(m, cosine),
    )


@subroutine
def _mean_passing(m):
    """What all layers together leave of light from all directions, for the diffuse base: their means, and covariances."""
    rough = m[rows.ROUGHNESS]
    mean_a, mean_b = ggx_mean_albedo(rough)
    mean = mean_a + mean_b
    a, b = ggx_albedo(_ONE, rough)
    if m[rows.IRIDESCENCE] > _ZERO:
        again = multiple_scattering(vec.maximum(_rgb(m, FILM_MEAN + 3)), mean)
        taken = vec.maximum(_rgb(m, FILM_MEAN + 3)) * mean + again * (_ONE - mean)
        _, reflected = fresnels(m, _mean_cosine(a, b))
        facing = vec.maximum(reflected) * (a + b) + again * (_ONE - a - b)
    else:
        f0 = vec.maximum(_dielectric_f0(m))
        again = multiple_scattering(schlick_mean(f0, m[rows.SPECULAR]), mean)
        taken = f0 * mean_a + m[rows.SPECULAR] * mean_b + again * (_ONE - mean)
        facing = f0 * a + m[rows.SPECULAR] * b + again * (_ONE - a - b)
    mean_a, mean_b = ggx_mean_albedo(m[rows.CLEARCOAT_ROUGHNESS])
    coat = _ONE - m[rows.CLEARCOAT] * (_COAT_F0 * mean_a + mean_b)
    color = vec.maximum(_rgb(m, rows.SHEEN_COLOR))
    sheen = _ONE - color * sheen_mean_albedo(m[rows.SHEEN_ROUGHNESS])
    rise = max(taken - facing, _ZERO)
    coat_rise = max(_coat_passing(m, _ONE) - coat, _ZERO)
    sheen_rise = max(_sheen_passing(m, _ONE) - sheen, _ZERO)
    base = _ONE - taken
    together = rise * coat_rise * sheen + rise * sheen_rise * coat + coat_rise * sheen_rise * base
    return max(base * coat * sheen + _COVARIANCE * together, _LEAST)


@device
def _coat_frame(m, wo):
    """The clearcoat's frame in the base's, and whether wo sees it from above; else it lies as the base does."""
    n = _rgb(m, COAT_NORMAL)
    if vec.dot(n, wo) < _LEAST_COSINE:
        n = (_ZERO, _ZERO, _ONE)
    s, t = vec.basis(n)
    return s, t, n


@subroutine
def _coat(m, wo, wi):
    """(f |cos|, pdf) of the clearcoat alone, of strength 1."""
    s, t, n = _coat_frame(m, wo)
    o = vec.to_local(s, t, n, wo)
    i = vec.to_local(s, t, n, wi)
    if i[2] <= _ZERO or o[2] <= _ZERO:
        return _ZERO, _ZERO
    alpha = max(m[rows.CLEARCOAT_ROUGHNESS] * m[rows.CLEARCOAT_ROUGHNESS], MIN_ALPHA)
    h = vec.normalize(vec.add(o, i))
    lambda_o = smith_lambda(o, alpha, alpha)
    lambda_i = smith_lambda(i, alpha, alpha)
    density = ggx_density(h, alpha, alpha) / (_FOUR * o[2])
    reflectance = _COAT_F0 + (_ONE - _COAT_F0) * schlick_weight(vec.dot(o, h))
    return reflectance * density / (_ONE + lambda_o + lambda_i), density / (_ONE + lambda_o)


@subroutine
def _sample_coat(m, wo, u):
    s, t, n = _coat_frame(m, wo)
    o = vec.to_local(s, t, n, wo)
    alpha = max(m[rows.CLEARCOAT_ROUGHNESS] * m[rows.CLEARCOAT_ROUGHNESS], MIN_ALPHA)
    h = sample_visible_normal(o, alpha, alpha, u)
    return vec.to_world(s, t, n, vec.sub(vec.scale(h, _TWO * vec.dot(o, h)), o))


@device
def _turned(m, w):
    """w in the frame of the anisotropy, whose x axis is the direction that highlights are drawn out along."""
    c, s = m[rows.ROTATION], m[rows.ROTATION + 1]
    return c * w[0] + s * w[1], c * w[1] - s * w[0], w[2]


@device
def _turned_back(m, w):
    c, s = m[rows.ROTATION], m[rows.ROTATION + 1]
    return c * w[0] - s * w[1], s * w[0] + c * w[1], w[2]


@device
def _glass_is_smooth(m):
    return m[rows.ROUGHNESS] <= SMOOTH_GLASS


@subroutine
def _choices(m, wo):
    """The chances of (clearcoat, sheen, microfacets, diffuse above, diffuse below, glass), by what each scatters towards wo."""
    a, b, loss, _, again_metal, again, passing, coat, sheen = _base_view(m, wo[2])
    metallic = m[rows.METALLIC]
    glass = (_ONE - metallic) * m[rows.TRANSMISSION]
    dielectric = _ONE - metallic - glass
    base = _rgb(m, rows.BASE)
    metal_f, dielectric_f = fresnels(m, _mean_cosine(a, b))
    left = coat * sheen
    specular = (metallic * vec.luminance(metal_f) + dielectric * vec.luminance(dielectric_f)) * (a + b)
    below = m[rows.DIFFUSE_TRANSMISSION]
    diffuse = dielectric * passing * (_ONE - below) * vec.luminance(base)
    diffuse += loss * (metallic * vec.luminance(again_metal) + dielectric * again)
    through = dielectric * passing * below * vec.luminance(_rgb(m, rows.DIFFUSE_TRANSMISSION_COLOR))
    total = specular + diffuse + through + glass
    specular = max(specular, _MIN_CHOICE * (total - glass)) * left
    varnish = m[rows.CLEARCOAT]
    varnish = max(_ONE - coat, _MIN_CHOICE * varnish) if varnish > _ZERO else _ZERO
    fibres = coat * max(_ONE - sheen, _MIN_CHOICE * vec.maximum(_rgb(m, rows.SHEEN_COLOR)))
    diffuse, through, glass = diffuse * left, through * left, glass * left
    scale = _ONE / max(varnish + fibres + specular + diffuse + through + glass, _LEAST)
    return varnish * scale, fibres * scale, specular * scale, diffuse * scale, through * scale, glass * scale


@device
def _glass(m, eta, wo, wi):
    """(f |cos|, pdf) of rough white glass."""
    o = _turned(m, wo)
    i = _turned(m, wi)
    if m[IS_PANE] != _ZERO:
        f0 = vec.maximum(_dielectric_f0(m))
        return eval_and_pdf_pane(f0, m[rows.SPECULAR], m[ALPHA_X], m[ALPHA_Y], o, i)
    return eval_and_pdf_rough_glass(eta, m[ALPHA_X], m[ALPHA_Y], o, i)


@subroutine
def eval_and_pdf_layered(m, eta, wo, wi):
    """(f |cos|, pdf per steradian), smooth glass left out. m: (LAYER_SLOTS,), resolved; eta: beyond over here."""
    if wo[2] <= _ZERO or wi[2] == _ZERO:
        return _BLACK, _ZERO
    choose_coat, choose_sheen, choose_specular, choose_diffuse, choose_through, choose_glass = _choices(m, wo)
    _, _, loss_o, mean_loss, again_metal, again, passing_o, coat_o, sheen_o = _base_view(m, wo[2])
    height = abs(wi[2])
    _, _, loss_i, _, _, _, passing_i, coat_i, sheen_i = _base_view(m, height)
    left = min(coat_o * sheen_o, coat_i * sheen_i)
    metallic = m[rows.METALLIC]
    glass = (_ONE - metallic) * m[rows.TRANSMISSION]
    dielectric = _ONE - metallic - glass
    base = _rgb(m, rows.BASE)
    cosine = height * _INV_PI
    below = m[rows.DIFFUSE_TRANSMISSION]
    diffuse = dielectric * passing_o * coat_o * sheen_o * passing_i * coat_i * sheen_i / _mean_passing(m) * cosine
    f = _BLACK
    pdf = _ZERO
    if glass > _ZERO and not _glass_is_smooth(m):
        white, density = _glass(m, eta, wo, wi)
        again_glass = _ZERO
        if m[IS_PANE] != _ZERO:  # a pane's lost light leaves on both sides
            again_glass = loss_o * loss_i / mean_loss * cosine
            reflectance = schlick_mean(vec.maximum(_dielectric_f0(m)), m[rows.SPECULAR])
            again_glass *= reflectance if wi[2] > _ZERO else _ONE - reflectance
        tint = base if wi[2] < _ZERO else (_ONE, _ONE, _ONE)
        f = vec.add(f, vec.scale(tint, glass * left * (white + again_glass)))
        pdf += choose_glass * density
    if wi[2] < _ZERO:
        f = vec.add(f, vec.scale(_rgb(m, rows.DIFFUSE_TRANSMISSION_COLOR), below * diffuse))
        return f, pdf + choose_through * cosine

    f = vec.add(f, vec.scale(base, (_ONE - below) * diffuse))
    many = vec.add(vec.scale(again_metal, metallic), _gray(dielectric * again))
    f = vec.add(f, vec.scale(many, left * loss_o * loss_i / mean_loss * cosine))
    pdf += choose_diffuse * cosine

    o = _turned(m, wo)
    i = _turned(m, wi)
    h = vec.normalize(vec.add(o, i))
    metal_f, dielectric_f = fresnels(m, vec.dot(o, h))
    lambda_o = smith_lambda(o, m[ALPHA_X], m[ALPHA_Y])
    lambda_i = smith_lambda(i, m[ALPHA_X], m[ALPHA_Y])
    density = ggx_density(h, m[ALPHA_X], m[ALPHA_Y]) / (_FOUR * wo[2])
    fresnel = vec.add(vec.scale(metal_f, metallic), vec.scale(dielectric_f, dielectric))
    f = vec.add(f, vec.scale(fresnel, left * density / (_ONE + lambda_o + lambda_i)))
    pdf += choose_specular * density / (_ONE + lambda_o)

    if vec.maximum(_rgb(m, rows.SHEEN_COLOR)) > _ZERO:
        under_coat = min(coat_o, coat_i)
        f = vec.add(f, vec.scale(_rgb(m, rows.SHEEN_COLOR), under_coat * eval_sheen(m[rows.SHEEN_ROUGHNESS], wo, wi)))
        pdf += choose_sheen * pdf_sheen(wi)
    if m[rows.CLEARCOAT] > _ZERO:
        varnish, density = _coat(m, wo, wi)
        f = vec.add(f, _gray(m[rows.CLEARCOAT] * varnish))
        pdf += choose_coat * density
    return f, pdf


@subroutine
def _sample_smooth_glass(m, eta, wo, chance, choose):
    """(wi, weight, radiance scale) of one of the two directions that smooth glass has."""
    if m[IS_PANE] != _ZERO:
        f0 = vec.maximum(_dielectric_f0(m))
        reflectance = f0 + (m[rows.SPECULAR] - f0) * schlick_weight(wo[2])
        down = (-wo[0], -wo[1], -wo[2])
        squeeze = _ONE
    else:
        reflectance, refracted = fresnel_dielectric(wo[2], eta)
        inverse = _ONE / eta
        down = (-wo[0] * inverse, -wo[1] * inverse, -refracted)
        squeeze = eta * eta
    share = (_ONE - m[rows.METALLIC]) * m[rows.TRANSMISSION] / chance
    left = _coat_passing(m, wo[2]) * _sheen_passing(m, wo[2])
    if choose < reflectance:
        return (-wo[0], -wo[1], wo[2]), _gray(share * left), _ONE
    left = min(left, _coat_passing(m, -down[2]) * _sheen_passing(m, -down[2]))
    return down, vec.scale(_rgb(m, rows.BASE), share * left / squeeze), squeeze


@subroutine
def sample_layered(m, eta, wo, choose, u):
    """(wi, weight, pdf, radiance scale); pdf is 0 where smooth glass was chosen."""
    coat, sheen, specular, diffuse, through, glass = _choices(m, wo)
    scale = _ONE
    above = True
    at = coat
    if choose < at:
        wi = _sample_coat(m, wo, u)
    elif choose < at + sheen:
        wi = sample_sheen(u)
    elif choose < at + sheen + specular:
        o = _turned(m, wo)
        h = sample_visible_normal(o, m[ALPHA_X], m[ALPHA_Y], u)
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
        o = _turned(m, wo)
        if m[IS_PANE] != _ZERO:
            i = sample_pane(vec.maximum(_dielectric_f0(m)), m[rows.SPECULAR], m[ALPHA_X], m[ALPHA_Y], o, rest, u)
        else:
            i = sample_rough_glass(eta, m[ALPHA_X], m[ALPHA_Y], o, rest, u)
            scale = eta * eta if i[2] < _ZERO else _ONE
        wi = _turned_back(m, i)
        above = wi[2] > _ZERO
    if (wi[2] > _ZERO) != above:  # light that meets the surface again
        return wi, _BLACK, _ZERO, _ONE
    f, pdf = eval_and_pdf_layered(m, eta, wo, wi)
    if pdf <= _ZERO:
        return wi, _BLACK, _ZERO, _ONE
    return wi, vec.scale(f, _ONE / pdf), pdf, scale
