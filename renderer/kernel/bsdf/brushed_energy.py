"""Single-scattering albedo of anisotropic GGX and Beckmann surfaces, from tables (albedo_tables.py).

The albedo depends on the azimuth too: across the grooves, where facets tilt most, far more light is lost at grazing angles than
along them. An isotropic surface cannot reproduce both.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device, never_inline, subroutine
from renderer.kernel.bsdf.albedo_tables import BRUSHED_NODES, table_path
from renderer.kernel.bsdf.energy import ggx_albedo, ggx_mean_albedo
from renderer.kernel.fetch import columns
from renderer.wide.values import any_of, not_, to_float, to_int, where, zero_like

__all__ = ["brushed_albedo", "brushed_mean_albedo"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TABLE = np.concatenate([np.load(table_path(name)) for name in ("brushed_albedo", "beckmann_albedo")])
_LAST_ROUGHNESS, _LAST_RATIO, _LAST_COSINE, _LAST_AZIMUTH = (np.float32(nodes - 1) for nodes in BRUSHED_NODES)
# Number of entries (A, B) for one roughness; the means follow the nodes of the cosine.
_RATIOS, _COSINES, _AZIMUTHS = (np.uint32(entries) for entries in _TABLE.shape[1:4])
_BECKMANN = np.uint32(BRUSHED_NODES[0])  # index of the lowest roughness of Beckmann
_MEANS = np.uint32(BRUSHED_NODES[2])
_FIRST = np.uint32(0)
_LEAST = np.float32(1e-6)


@device
def _node(x, last):
    """Returns (index of the table node below x, the fraction of the way to the next node). Nodes are numbered 0 to `last`.

    x: position along the axis, 0 at the first node to 1 at the last. For NaN, as in unused lanes, the node is valid too.
    """
    x = min(_ONE, max(_ZERO, x)) * last
    i = to_int(min(last - _ONE, x))
    return i, x - to_float(i)


@device
def _share(side, t):
    return t if side == 1 else _ONE - t


@device
def _entry(roughness, ratio, cosine, azimuth):
    """Returns the albedo terms (A, B) at the table node with these four indices (roughness, ratio of alphas, cosine, azimuth)."""
    number = ((roughness * _RATIOS + ratio) * _COSINES + cosine) * _AZIMUTHS + azimuth
    return columns(_TABLE, number, 2, 0, 2)


@device
def _first(beckmann):
    """Returns the index at which the table of the distribution in use, GGX or Beckmann, starts along the roughness axis.

    beckmann: see facets.py.
    """
    first = _FIRST
    if beckmann is not None:  # noqa: SIM102
        if beckmann != _ZERO:
            first = _BECKMANN
    return first


@device
def _is_tabled(beckmann, alpha_x, alpha_y):
    """Returns True if the table of this module contains the albedo of a surface; isotropic GGX has a table of its own."""
    tabled = alpha_x > alpha_y
    if beckmann is not None:
        tabled = tabled | (beckmann != _ZERO)
    return tabled


@subroutine
def _lookup(first, w, alpha_x, alpha_y):
    never_inline()
    sine2 = w[0] * w[0] + w[1] * w[1]
    x, y = alpha_x * w[0], alpha_y * w[1]
    alpha = where(sine2 > _ZERO, math.sqrt((x * x + y * y) / sine2), alpha_x)
    i, r = _node(math.sqrt(alpha_x), _LAST_ROUGHNESS)
    j, q = _node(math.sqrt(alpha_y / alpha_x), _LAST_RATIO)
    k, c = _node(math.sqrt(max(w[2], _ZERO)), _LAST_COSINE)
    n, t = _node((alpha - alpha_y) / max(alpha_x - alpha_y, _LEAST), _LAST_AZIMUTH)
    a = b = zero_like(t)
    for corner in range(16):
        di, dj, dk, dn = np.uint32(corner & 1), np.uint32(corner >> 1 & 1), np.uint32(corner >> 2 & 1), np.uint32(corner >> 3)
        share = _share(di, r) * _share(dj, q) * _share(dk, c) * _share(dn, t)
        at_a, at_b = _entry(first + i + di, j + dj, k + dk, n + dn)
        a = a + share * at_a
        b = b + share * at_b
    return a, b


@subroutine
def _mean_lookup(first, alpha_x, alpha_y):
    never_inline()
    i, r = _node(math.sqrt(alpha_x), _LAST_ROUGHNESS)
    j, q = _node(math.sqrt(alpha_y / alpha_x), _LAST_RATIO)
    a = b = zero_like(r)
    for corner in range(4):
        di, dj = np.uint32(corner & 1), np.uint32(corner >> 1)
        share = _share(di, r) * _share(dj, q)
        at_a, at_b = _entry(first + i + di, j + dj, _MEANS, _FIRST)
        a = a + share * at_a
        b = b + share * at_b
    return a, b


@device
def brushed_albedo(beckmann, w, roughness, alpha_x, alpha_y):
    """Returns (A, B), see `ggx_albedo`, for direction w in the frame whose x axis has alpha_x >= alpha_y.

    beckmann: see facets.py. roughness: the square root of both alphas if they are equal.
    """
    brushed = _is_tabled(beckmann, alpha_x, alpha_y)
    a = b = zero_like(w[2])
    if any_of(not_(brushed)):
        a, b = ggx_albedo(w[2], roughness)
    if any_of(brushed):
        brushed_a, brushed_b = _lookup(_first(beckmann), w, alpha_x, alpha_y)
        a, b = where(brushed, brushed_a, a), where(brushed, brushed_b, b)
    return a, b


@device
def brushed_mean_albedo(beckmann, roughness, alpha_x, alpha_y):
    """Returns the means over the cosine-weighted hemisphere of `brushed_albedo`'s terms (A, B)."""
    brushed = _is_tabled(beckmann, alpha_x, alpha_y)
    a = b = zero_like(roughness)
    if any_of(not_(brushed)):
        a, b = ggx_mean_albedo(roughness)
    if any_of(brushed):
        brushed_a, brushed_b = _mean_lookup(_first(beckmann), alpha_x, alpha_y)
        a, b = where(brushed, brushed_a, a), where(brushed, brushed_b, b)
    return a, b
