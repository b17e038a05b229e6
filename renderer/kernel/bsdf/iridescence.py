"""Reflectance of a thin film on a surface, by interference: KHR_materials_iridescence.

Belcour & Barla, "A Practical Extension to Microfacet Theory for the Modeling of Varying Iridescence" (SIGGRAPH 2017): Airy
summation of the film's reflections, integrated over the eye's sensitivities in Fourier space. The base under the film is
given by its F0, as in the extension. At the wavelengths of a path (kernel/spectrum), the sum is exact for each polarisation.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device, subroutine
from renderer.kernel.bsdf.fresnel import fresnel_dielectric, schlick_weight
from renderer.kernel.polynomial import exp, sincos_turns

__all__ = ["film_reflectance", "film_reflectance_at"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FOUR = np.float32(4.0)
_GRAZING = np.float32(1e-4)  # least cosine of an angle of incidence
_METRES = np.float32(1e-9)
_MOST_F0 = np.float32(0.9999)
_FADE = np.float32(1.0 / 30.0)  # thinner films (nanometres) fade into none
# Gaussian fits of the CIE sensitivities in Fourier space: value, position, variance; X has a second lobe (its supplement).
_VALUE = tuple(np.float32(v / 1.0685e-7) for v in (5.4856e-13, 4.4201e-13, 5.2481e-13, 9.7470e-14))
_POSITION = tuple(np.float32(p / (2 * math.pi)) for p in (1.6810e6, 1.7953e6, 2.2084e6, 2.2399e6))
_VARIANCE = tuple(np.float32(v) for v in (4.3278e9, 9.3046e9, 6.6121e9, 4.5282e9))
_SPREAD = tuple(np.float32(math.sqrt(2 * math.pi * v)) for v in (4.3278e9, 9.3046e9, 6.6121e9, 4.5282e9))
_TWO_PI = np.float32(2 * math.pi)


@device
def _gauss(k, path, turns):
    _, cosine = sincos_turns(_POSITION[k] * path + turns)
    return _VALUE[k] * _SPREAD[k] * cosine * exp(-_VARIANCE[k] * path * path)


@device
def _sensitivity(path, turns):
    """Returns the linear Rec.709 response to a wave with an optical path difference of `path` / (2 pi) metres and a phase shift.

    turns: phase shift per channel in turns, since the base's phase jump depends on the channel.
    """
    x = _gauss(0, path, turns[0]) + _gauss(3, path, turns[0])
    y = _gauss(1, path, turns[1])
    z = _gauss(2, path, turns[2])
    return (
        np.float32(3.2404542) * x - np.float32(1.5371385) * y - np.float32(0.4985314) * z,
        np.float32(-0.9692660) * x + np.float32(1.8760108) * y + np.float32(0.0415560) * z,
        np.float32(0.0556434) * x - np.float32(0.2040259) * y + np.float32(1.0572252) * z,
    )


@device
def _index(f0, outside):
    """Returns the index of refraction at which a boundary with the medium of index `outside` reflects f0 at normal incidence."""
    root = math.sqrt(min(f0, _MOST_F0))
    return outside * (_ONE + root) / (_ONE - root)


@device
def _film_to_base(f0, film, cosine):
    """Returns one channel's (reflectance at the boundary between film and base, phase jump there in turns).

    f0: of the base without the film. film: the film's index. cosine: of the angle of incidence inside the film.
    """
    index = _index(f0, _ONE)
    ratio = (index - film) / (index + film)
    r0 = ratio * ratio
    return r0 + (_ONE - r0) * schlick_weight(cosine), _HALF if index < film else _ZERO


@device
def _airy(r12, r23, t121, first, second):
    """Returns one channel's reflectance, 0 to 1, of a base under a thin film, from the first two orders of interference.

    r12, r23: reflectances of the film's two boundaries. t121: fraction of the light that the outer boundary transmits. first,
    second: responses of the channel to the two orders.
    """
    r123 = r12 * r23
    root = math.sqrt(max(r123, _ZERO))
    stay = t121 * t121 * r23 / (_ONE - r123)
    c0 = r12 + stay
    c1 = (stay - t121) * root
    c2 = c1 * root
    return min(max(c0 + _TWO * (c1 * first + c2 * second), _ZERO), _ONE)


@subroutine
def film_reflectance(f0, film_ior, thickness, cosine):
    """Returns the reflectance of a base under a thin film, three channels, 0 ... 1.

    f0: of the base without the film. thickness: of the film in nanometres. cosine: of the angle of incidence.
    """
    # As the thickness fades to 0 the film's index becomes that of air, which leaves the bare surface.
    fade = min(max(thickness * _FADE, _ZERO), _ONE)
    fade = fade * fade * (np.float32(3.0) - _TWO * fade)
    film = _ONE + (film_ior - _ONE) * fade
    r12, inside = fresnel_dielectric(cosine, film)
    if r12 >= _ONE:
        return _ONE, _ONE, _ONE
    t121 = _ONE - r12
    path = _TWO * film * thickness * _METRES * inside * _TWO_PI
    outer = _HALF if film < _ONE else _ZERO
    jump = _HALF - outer
    r0, p0 = _film_to_base(f0[0], film, inside)
    r1, p1 = _film_to_base(f0[1], film, inside)
    r2, p2 = _film_to_base(f0[2], film, inside)
    turns = (jump + p0, jump + p1, jump + p2)
    first = _sensitivity(path, turns)
    second = _sensitivity(_TWO * path, (_TWO * turns[0], _TWO * turns[1], _TWO * turns[2]))
    return (
        _airy(r12, r0, t121, first[0], second[0]),
        _airy(r12, r1, t121, first[1], second[1]),
        _airy(r12, r2, t121, first[2], second[2]),
    )


@device
def _interference(outer, inner, sine2):
    """Returns the reflectance of a film for one polarisation: Airy's sum over all orders (Born & Wolf, 7.6).

    outer, inner: amplitudes that its two boundaries reflect. sine2: squared sine of half the phase difference between orders.
    """
    waves = _FOUR * outer * inner * sine2
    total, least = outer + inner, _ONE + outer * inner
    return min(max(total * total - waves, _ZERO) / (least * least - waves), _ONE)


@device
def _film_at(f0, film, thickness, outside, inside, wavelength):
    index = _index(f0, _ONE)
    sine2 = (_ONE - outside * outside) / (index * index)
    beyond = math.sqrt(_ONE - sine2)
    half, _ = sincos_turns(film * thickness * inside / wavelength)
    half2 = half * half
    s12, p12 = (outside - film * inside) / (outside + film * inside), (film * outside - inside) / (film * outside + inside)
    n2, n3 = film * inside, index * beyond
    s23, p23 = (n2 - n3) / (n2 + n3), (index * inside - film * beyond) / (index * inside + film * beyond)
    return _HALF * (_interference(s12, s23, half2) + _interference(p12, p23, half2))


@subroutine
def film_reflectance_at(f0, film_ior, thickness, cosine, wavelengths):
    """Returns the reflectance of a base under a thin film at three wavelengths, 0 ... 1.

    f0, thickness, cosine: as for `film_reflectance`. wavelengths: nanometres.
    """
    outside = max(cosine, _GRAZING)
    inside = math.sqrt(_ONE - (_ONE - outside * outside) / (film_ior * film_ior))
    place = film_ior, thickness, outside, inside
    return (
        _film_at(f0[0], *place, wavelengths[0]),
        _film_at(f0[1], *place, wavelengths[1]),
        _film_at(f0[2], *place, wavelengths[2]),
    )
