"""Paint under a coat of varnish: how much light comes out of it again."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

__all__ = ["dielectric_albedo", "under_a_coat"]


@functools.cache
def dielectric_albedo(ior: float) -> float:
    """What a smooth boundary reflects of light from everywhere, 0 to 1; ior: of what lies behind, at least 1."""
    cosine = (np.arange(1024) + 0.5) / 1024
    behind = np.sqrt(1 - (1 - cosine**2) / ior**2)
    across = (cosine - ior * behind) / (cosine + ior * behind)
    along = (ior * cosine - behind) / (ior * cosine + behind)
    return float(((across**2 + along**2) / 2 * 2 * cosine).mean())


def under_a_coat(reflectance: Any, inner: float) -> Any:
    """The reflectance that paint seems to have, of the light that gets into its coat, counted as if all of it got out again.

    inner: what the coat throws back of light from within. Source: Pharr, Jakob and Humphreys 2023, 14.3, in the limit of a thin
    smooth coat; the sum of what bounces between paint and coat is a geometric series.
    """
    values = np.clip(np.asarray(reflectance, np.float32), 0, 1)
    found = (1 - inner) * values / (1 - inner * values)
    if isinstance(reflectance, tuple):
        r, g, b = (float(v) for v in found)
        return r, g, b
    return found
