"""Traces random walks over the facets of a Smith-GGX surface, as the reference for multiple scattering.

Heitz, Hanika, d'Eon & Dachsbacher, "Multiple-Scattering Microfacet BSDFs with the Smith Model" (2016), in NumPy and float64,
independent of the renderer. Facets are perfect mirrors; their heights are uniformly distributed between -1 and 1.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["walk"]

F64 = npt.NDArray[np.float64]
BOUNCES = 200


def smith_lambda(w: F64, alpha: float) -> F64:
    """Returns Smith's Lambda for directions w above and below the horizon."""
    sine = np.sqrt(np.maximum(1 - w[:, 2] ** 2, 1e-20))
    slope = w[:, 2] / (alpha * sine)
    return np.asarray((np.copysign(np.sqrt(1 + slope**-2.0), slope) - 1) / 2)


def visible_normals(w: F64, alpha: float, u: F64) -> F64:
    """Returns normals visible from w, sampled by spherical caps (Dupuy & Benyoub 2023); w may be below the horizon."""
    v = w * (alpha, alpha, 1)
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    z = (1 - u[:, 0]) * (1 + v[:, 2]) - v[:, 2]
    radius, turn = np.sqrt(np.clip(1 - z * z, 0, 1)), 2 * np.pi * u[:, 1]
    h = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], 1) + v
    h *= (alpha, alpha, 1)
    return np.asarray(h / np.linalg.norm(h, axis=1, keepdims=True))


def walk(wo: F64, alpha: float, count: int, seed: int = 0) -> tuple[F64, npt.NDArray[np.int64]]:
    """Traces `count` rays from direction wo over the facets.

    Returns exit directions (count, 3) and the number of facets that each ray hit.
    """
    rng = np.random.default_rng(seed)
    out, facets = np.tile(np.asarray(wo, np.float64), (count, 1)), np.zeros(count, np.int64)
    going = np.arange(count)
    w, height = -out, np.full(count, 1.0)  # heights as values of their cumulative distribution, 0 ... 1
    for bounce in range(BOUNCES):
        lam = smith_lambda(w, alpha)
        with np.errstate(divide="ignore", over="ignore"):
            leaves = np.where(w[:, 2] > 0, height ** np.maximum(lam, 0), 0.0)
            u = rng.random(len(w))
            met = height / (1 - u) ** (1 / lam)
        stays = (u < 1 - leaves) & (w[:, 2] < 1 - 1e-9)
        out[going[~stays]], facets[going[~stays]] = w[~stays], bounce
        going, w, height = going[stays], w[stays], np.clip(met[stays], 1e-12, 1.0)
        if len(going) == 0:
            break
        h = visible_normals(-w, alpha, rng.random((len(w), 2)))
        w = 2 * (-w * h).sum(1, keepdims=True) * h + w
    return out, facets
