"""Computes the reflectance of an isotropically scattering half-space (Chandrasekhar, "Radiative Transfer", 1950)."""

from __future__ import annotations

import numpy as np

__all__ = ["diffuse_reflectance", "reflectance"]

_X, _W = (np.polynomial.legendre.leggauss(64)[0] + 1) / 2, np.polynomial.legendre.leggauss(64)[1] / 2


def _h(albedo: float) -> np.ndarray:
    """Returns Chandrasekhar's H function at the quadrature nodes, from its second integral equation."""
    h = np.ones_like(_X)
    for _ in range(2000):
        h = 1 / (np.sqrt(1 - albedo) + albedo / 2 * (_W * _X * h / (_X[:, None] + _X)).sum(axis=1))
    return h


def reflectance(albedo: float, cosine: float) -> float:
    """Returns the fraction of light from one direction that is reflected into all directions.

    By reciprocity it equals the radiance in that direction under a white sky.
    """
    h = 1 / (np.sqrt(1 - albedo) + albedo / 2 * (_W * _X * _h(albedo) / (cosine + _X)).sum())
    return float(1 - np.sqrt(1 - albedo) * h)


def diffuse_reflectance(albedo: float) -> float:
    """Returns the reflectance of the half-space under diffuse illumination."""
    return float(1 - 2 * np.sqrt(1 - albedo) * (_W * _X * _h(albedo)).sum())
