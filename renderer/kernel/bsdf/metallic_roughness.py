"""glTF's metallic-roughness material: a GGX layer over a diffuse base, after the glTF 2.0 specification, appendix B.

F0 is 0.04 mixed with the base colour by `metallic`; alpha is roughness squared. Single scattering: what rough metal would
scatter twice is lost, as in the specification. The base gets what the layer leaves on the way in and on the way out
(Shirley et al., "A practitioners' assessment of light reflection models", 1997), where a rough layer takes less at grazing
angles: the specification's plain 1 - F of the half vector would reflect up to 1.2 times the light that comes in.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.polynomial import sincos_turns
from renderer.kernel.warp import square_to_cosine_hemisphere, square_to_cosine_hemisphere_pdf

__all__ = ["eval_and_pdf_metallic_roughness", "eval_metallic_roughness", "pdf_metallic_roughness", "sample_metallic_roughness"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FOUR = np.float32(4.0)
_PI = np.float32(math.pi)
_INV_PI = np.float32(1.0 / math.pi)
_DIELECTRIC_F0 = np.float32(0.04)
_MEAN_SCHLICK_TERM = np.float32(1.0 / 21.0)  # over the cosine-weighted hemisphere
_LOSS_1, _LOSS_2 = np.float32(0.45), np.float32(0.5)
_MIN_ALPHA = np.float32(1e-3)  # smoother is a mirror to the eye, and float32 keeps the lobe's density
_MIN_CHOICE = np.float32(0.05)


@device
def _alpha(roughness):
    return max(roughness * roughness, _MIN_ALPHA)


@device
def _f0(base, metallic):
    """Reflectance at normal incidence."""
    keep = _DIELECTRIC_F0 * (_ONE - metallic)
    return base[0] * metallic + keep, base[1] * metallic + keep, base[2] * metallic + keep


@device
def _schlick_term(cosine):
    m = max(_ZERO, _ONE - cosine)
    return (m * m) * (m * m) * m


@device
def _glancing(roughness):
    """How much of Schlick's rise towards grazing angles the whole layer shows: fitted so that white stays below 1."""
    rough = min(roughness, _ONE)
    return _ONE - rough * (_LOSS_1 + _LOSS_2 * rough)


@device
def _schlick(f0, cosine):
    m5 = _schlick_term(cosine)
    return f0[0] + (_ONE - f0[0]) * m5, f0[1] + (_ONE - f0[1]) * m5, f0[2] + (_ONE - f0[2]) * m5


@device
def _ggx_density(h, alpha):
    """D(h): microfacet normals per steradian of h."""
    x = h[0] / alpha
    y = h[1] / alpha
    s = x * x + y * y + h[2] * h[2]
    return _INV_PI / (alpha * alpha * s * s)


@device
def _smith_lambda(w, alpha):
    """Smith's Lambda: masked over visible area."""
    tangent2 = (w[0] * w[0] + w[1] * w[1]) / (w[2] * w[2])
    a2t2 = alpha * alpha * tangent2
    return (math.sqrt(_ONE + a2t2) - _ONE) / _TWO


@device
def _specular_choice(f0, base, metallic, roughness, wo):
    """The probability of sampling the GGX layer: its share of the reflectance seen from wo."""
    normal = vec.luminance(f0)
    specular = normal + (_ONE - normal) * _glancing(roughness) * _schlick_term(wo[2])
    diffuse = vec.luminance(base) * (_ONE - metallic) * (_ONE - specular)
    return max(specular / max(specular + diffuse, np.float32(1e-6)), _MIN_CHOICE)


@device
def _half(wo, wi):
    return vec.normalize(vec.add(wo, wi))


@device
def _visible_normal(wo, alpha, u):
    """A microfacet normal by its visible area (Dupuy & Benyoub, "Sampling Visible GGX Normals with Spherical Caps", 2023)."""
    v = vec.normalize((wo[0] * alpha, wo[1] * alpha, wo[2]))
    z = (_ONE - u[0]) * (_ONE + v[2]) - v[2]
    radius = math.sqrt(min(max(_ONE - z * z, _ZERO), _ONE))
    sine, cosine = sincos_turns(u[1])
    h = (radius * cosine + v[0], radius * sine + v[1], z + v[2])
    return vec.normalize((h[0] * alpha, h[1] * alpha, h[2]))


@device
def eval_and_pdf_metallic_roughness(base, metallic, roughness, wo, wi):
    """(f |cos|, pdf) together: they share most of their terms."""
    if wi[2] <= _ZERO or wo[2] <= _ZERO:
        return (_ZERO, _ZERO, _ZERO), _ZERO
    alpha = _alpha(roughness)
    f0 = _f0(base, metallic)
    h = _half(wo, wi)
    fresnel = _schlick(f0, vec.dot(wo, h))
    lambda_o = _smith_lambda(wo, alpha)
    lambda_i = _smith_lambda(wi, alpha)
    density = _ggx_density(h, alpha) / (_FOUR * wo[2])
    specular = density / (_ONE + lambda_o + lambda_i)
    glancing = _glancing(roughness)
    passing = (_ONE - glancing * _schlick_term(wo[2])) * (_ONE - glancing * _schlick_term(wi[2]))
    # divided by its mean over all directions, so that a white base reflects all that the layer lets in from wo
    passing *= (_ONE - _DIELECTRIC_F0) / (_ONE - glancing * _MEAN_SCHLICK_TERM)
    diffuse = (_ONE - metallic) * passing * wi[2] * _INV_PI
    f = vec.add(vec.scale(fresnel, specular), vec.scale(base, diffuse))
    choice = _specular_choice(f0, base, metallic, roughness, wo)
    pdf = choice * density / (_ONE + lambda_o) + (_ONE - choice) * square_to_cosine_hemisphere_pdf(wi)
    return f, pdf


@device
def eval_metallic_roughness(base, metallic, roughness, wo, wi):
    """f |cos|."""
    f, _ = eval_and_pdf_metallic_roughness(base, metallic, roughness, wo, wi)
    return f


@device
def pdf_metallic_roughness(base, metallic, roughness, wo, wi):
    """Per steradian."""
    _, pdf = eval_and_pdf_metallic_roughness(base, metallic, roughness, wo, wi)
    return pdf


@device
def sample_metallic_roughness(base, metallic, roughness, wo, choose, u):
    """(wi, weight, pdf); `choose` picks the layer, u the direction."""
    if choose < _specular_choice(_f0(base, metallic), base, metallic, roughness, wo):
        h = _visible_normal(wo, _alpha(roughness), u)
        wi = vec.sub(vec.scale(h, _TWO * vec.dot(wo, h)), wo)
    else:
        wi = square_to_cosine_hemisphere(u)
    f, pdf = eval_and_pdf_metallic_roughness(base, metallic, roughness, wo, wi)
    if pdf <= _ZERO:
        return wi, (_ZERO, _ZERO, _ZERO), _ZERO
    return wi, vec.scale(f, _ONE / pdf), pdf
