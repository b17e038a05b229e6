"""The single-scatter albedo of brushed surfaces: GGX whose two alphas differ, from a table (albedo_tables.py).

It depends on the azimuth as well: along the groove's cross direction, where facets tilt most, far more light is lost at
grazing angles than along the groove. No isotropic surface loses as much in one direction and as little in the other.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device, out_of_line, subroutine
from renderer.kernel.bsdf.albedo_tables import BRUSHED_NODES, table_path
from renderer.kernel.bsdf.energy import ggx_albedo, ggx_mean_albedo

__all__ = ["brushed_albedo", "brushed_mean_albedo"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TABLE = np.load(table_path("brushed_albedo"))
_LAST_ROUGHNESS, _LAST_RATIO, _LAST_COSINE, _LAST_AZIMUTH = (np.float32(nodes - 1) for nodes in BRUSHED_NODES)
_MEANS = BRUSHED_NODES[2]


@device
def _node(x, last):
    """(the node below x of 0 ... 1, how far x is beyond it)."""
    x = min(max(x, _ZERO), _ONE) * last
    i = min(np.int64(x), np.int64(last) - 1)
    return i, x - np.float32(i)


@device
def _share(side, t):
    return t if side == 1 else _ONE - t


@subroutine
def _lookup(w, alpha_x, alpha_y):
    out_of_line()
    sine2 = w[0] * w[0] + w[1] * w[1]
    x, y = alpha_x * w[0], alpha_y * w[1]
    alpha = math.sqrt((x * x + y * y) / sine2) if sine2 > _ZERO else alpha_x
    i, r = _node(math.sqrt(alpha_x), _LAST_ROUGHNESS)
    j, q = _node(math.sqrt(alpha_y / alpha_x), _LAST_RATIO)
    k, c = _node(math.sqrt(max(w[2], _ZERO)), _LAST_COSINE)
    n, t = _node((alpha - alpha_y) / (alpha_x - alpha_y), _LAST_AZIMUTH)
    a = b = _ZERO
    for corner in range(16):
        di, dj, dk, dn = corner & 1, corner >> 1 & 1, corner >> 2 & 1, corner >> 3
        share = _share(di, r) * _share(dj, q) * _share(dk, c) * _share(dn, t)
        a += share * _TABLE[i + di, j + dj, k + dk, n + dn, 0]
        b += share * _TABLE[i + di, j + dj, k + dk, n + dn, 1]
    return a, b


@subroutine
def _mean_lookup(alpha_x, alpha_y):
    out_of_line()
    i, r = _node(math.sqrt(alpha_x), _LAST_ROUGHNESS)
    j, q = _node(math.sqrt(alpha_y / alpha_x), _LAST_RATIO)
    a = b = _ZERO
    for corner in range(4):
        di, dj = corner & 1, corner >> 1
        share = _share(di, r) * _share(dj, q)
        a += share * _TABLE[i + di, j + dj, _MEANS, 0, 0]
        b += share * _TABLE[i + di, j + dj, _MEANS, 0, 1]
    return a, b


@device
def brushed_albedo(w, roughness, alpha_x, alpha_y):
    """(A, B) as `ggx_albedo` gives them, towards w in the frame whose x axis has alpha_x >= alpha_y.

    roughness: the root of both alphas where they are the same."""
    if alpha_x > alpha_y:
        return _lookup(w, alpha_x, alpha_y)
    return ggx_albedo(w[2], roughness)


@device
def brushed_mean_albedo(roughness, alpha_x, alpha_y):
    """(A, B), their means over the cosine-weighted hemisphere."""
    if alpha_x > alpha_y:
        return _mean_lookup(alpha_x, alpha_y)
    return ggx_mean_albedo(roughness)
