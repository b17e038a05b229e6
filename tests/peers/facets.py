"""Random walk of light between the facets of a rough dielectric surface; a reference for multiple scattering.

Source: Heitz, Hanika, d'Eon and Dachsbacher 2016, "Multiple-Scattering Microfacet BSDFs with the Smith Model". The slopes of the
surface have a GGX distribution, the heights a uniform one.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["walked"]

F64 = npt.NDArray[np.float64]
_MOST = 30  # maximum number of facet hits


def walked(alpha: float, degrees: float, ior: float, paths: int = 400_000) -> tuple[F64, F64]:
    """Walks paths of light between facets; returns the fractions of them that are (reflected, transmitted).

    Element n of both arrays counts the paths that hit n facets. degrees: angle of incidence. alpha: roughness. ior: refractive
    index.
    """
    random = np.random.default_rng(1)
    w = np.tile((-np.sin(np.radians(degrees)), 0.0, -np.cos(np.radians(degrees))), (paths, 1))
    height, side = np.ones(paths), np.ones(paths)  # 1 outside, -1 inside
    reflected, through = np.zeros(_MOST), np.zeros(_MOST)
    for met in range(_MOST):
        reached = side * _next_height(random, side * w[:, 2], side * height, alpha)
        gone = ~np.isfinite(reached)
        reflected[met], through[met] = ((gone & (side == s)).sum() / paths for s in (1, -1))
        w, side, height = w[~gone], side[~gone], reached[~gone]
        if len(w) == 0:
            break
        facet = _visible(random, -w * side[:, None], alpha) * side[:, None]
        cosine = np.clip(-np.einsum("ij,ij->i", w, facet), 0, 1)
        eta = np.where(side > 0, 1 / ior, ior)
        fresnel, below = _fresnel(cosine, eta)
        is_reflected = random.random(len(w)) < fresnel
        mirrored = w + 2 * cosine[:, None] * facet
        bent = eta[:, None] * w + (eta * cosine - below)[:, None] * facet
        w = np.where(is_reflected[:, None], mirrored, bent)
        w /= np.linalg.norm(w, axis=1)[:, None]
        side = np.where(is_reflected, side, -side)
    return reflected, through


def _next_height(random: np.random.Generator, up: F64, height: F64, alpha: float) -> F64:
    """Returns the height at which each ray hits the next facet; infinity if it hits none and leaves the surface.

    up: the ray direction's component along the surface normal. height: where the ray starts.
    """
    u = random.random(len(up))
    z = np.clip(up, -0.99999, 0.99999)
    z = np.where(np.abs(z) < 1e-5, 1e-5, z)
    a = z / (np.sqrt(1 - z * z) * alpha)
    smith = (np.sign(a) * np.sqrt(1 + 1 / a**2) - 1) / 2
    share = np.clip((height + 1) / 2, 0, 1)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        leaves = np.where(z > 0, share ** np.maximum(smith, 0), 0.0)
        reached = np.clip(2 * share / (1 - u) ** (1 / smith) - 1, -1, 1)
    return np.where(u > 1 - leaves, np.inf, reached)


def _visible(random: np.random.Generator, w: F64, alpha: float) -> F64:
    """Samples, for each direction w, the normal of a facet that is visible from w (Dupuy and Benyoub 2023).

    w may point to either side of the surface.
    """
    stretch = np.array([alpha, alpha, 1.0])
    seen = w * stretch
    seen /= np.linalg.norm(seen, axis=1)[:, None]
    u, v = random.random((2, len(w)))
    z = (1 - u) * (1 + seen[:, 2]) - seen[:, 2]
    ring = np.sqrt(np.clip(1 - z * z, 0, 1))
    facet = (np.stack([ring * np.cos(2 * np.pi * v), ring * np.sin(2 * np.pi * v), z], axis=1) + seen) * stretch
    return np.asarray(facet / np.linalg.norm(facet, axis=1)[:, None])


def _fresnel(cosine: F64, eta: F64) -> tuple[F64, F64]:
    """Returns (Fresnel reflectance, cosine of the angle of refraction) of a smooth dielectric facet.

    eta: refractive index on the incident side divided by that on the other side.
    """
    below = np.sqrt(np.clip(1 - eta**2 * (1 - cosine**2), 0, 1))
    s, p = (eta * cosine - below) / (eta * cosine + below), (cosine - eta * below) / (cosine + eta * below)
    return np.where(below > 0, (s * s + p * p) / 2, 1.0), below
