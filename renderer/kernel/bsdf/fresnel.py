"""Reflectance of smooth boundaries: Fresnel's equations for dielectrics and conductors, and Schlick's approximation."""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.wide.values import where

__all__ = ["fresnel_conductor", "fresnel_dielectric", "mean_fresnel_dielectric", "schlick", "schlick_weight"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FOUR = np.float32(4.0)


@device
def fresnel_dielectric(cosine, eta):
    """Returns (reflectance of a dielectric for unpolarised light, cosine of the refracted angle); (1, 0) for total reflection.

    eta: index beyond the boundary over index on this side.
    """
    sine2 = max(_ZERO, _ONE - cosine * cosine) / (eta * eta)
    total = sine2 >= _ONE
    refracted = math.sqrt(_ONE - sine2)
    parallel = (eta * cosine - refracted) / (eta * cosine + refracted)
    perpendicular = (cosine - eta * refracted) / (cosine + eta * refracted)
    reflectance = _HALF * (parallel * parallel + perpendicular * perpendicular)
    return where(total, _ONE, reflectance), where(total, _ZERO, refracted)


@device
def mean_fresnel_dielectric(eta):
    """Returns a dielectric's mean Fresnel reflectance over the cosine-weighted hemisphere; error below 1e-3.

    A fit by d'Eon & Irving, in the form of Kulla & Conty 2017.
    """
    dense = max(eta, _ONE / eta)
    outside = (dense - _ONE) / (np.float32(4.08567) + np.float32(1.00071) * dense)
    return where(eta >= _ONE, outside, _ONE - (_ONE - outside) * eta * eta)


@device
def fresnel_conductor(cosine, eta, k):
    """Returns the reflectance of unpolarised light, one channel, at a conductor of index eta + i k.

    cosine: of the angle of incidence. Sources: Born & Wolf 14.4; Lagarde 2013.
    """
    cosine2 = cosine * cosine
    sine2 = _ONE - cosine2
    eta2 = eta * eta
    k2 = k * k
    t0 = eta2 - k2 - sine2
    a2_plus_b2 = math.sqrt(t0 * t0 + _FOUR * eta2 * k2)
    t1 = a2_plus_b2 + cosine2
    t2 = _TWO * math.sqrt(max(_ZERO, _HALF * (a2_plus_b2 + t0))) * cosine
    perpendicular = (t1 - t2) / (t1 + t2)
    t3 = cosine2 * a2_plus_b2 + sine2 * sine2
    t4 = t2 * sine2
    return _HALF * perpendicular * (_ONE + (t3 - t4) / (t3 + t4))


@device
def schlick_weight(cosine):
    """Returns (1 - cosine)**5, the weight of f90 in Schlick's approximation (1994)."""
    m = max(_ZERO, _ONE - cosine)
    return (m * m) * (m * m) * m


@device
def schlick(f0, f90, cosine):
    """Returns Schlick's reflectance of three channels, from f0 at normal incidence to f90 (a number) at grazing incidence."""
    w = schlick_weight(cosine)
    return f0[0] + (f90 - f0[0]) * w, f0[1] + (f90 - f0[1]) * w, f0[2] + (f90 - f0[2]) * w
