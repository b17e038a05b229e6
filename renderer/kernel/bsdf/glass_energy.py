"""Single-scattering albedo of rough boundaries between dielectrics, from a table (albedo_tables.py)."""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device, never_inline, subroutine
from renderer.kernel.bsdf.albedo_tables import GLASS_SIZE, MOST_BEND, table_path

__all__ = ["glass_albedo", "glass_mean_albedo"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TABLE = np.concatenate([np.load(table_path(name)) for name in ("glass_albedo", "beckmann_glass_albedo")])
_LAST = np.float32(GLASS_SIZE - 1)
_LAST_INTERVAL = GLASS_SIZE - 2
_BENDS = np.float32((GLASS_SIZE - 1) / (2 * MOST_BEND))
_MOST_BEND = np.float32(MOST_BEND)


@device
def _node(x):
    """Returns (index of the table node below x, the fraction of the way to the next node).

    x: position along a table axis, 0 at the first node to 1 at the last.
    """
    x = min(max(x, _ZERO), _LAST)
    i = min(np.int64(x), _LAST_INTERVAL)
    return i, x - np.float32(i)


@device
def _mix(a, b, t):
    return a + t * (b - a)


@device
def _plane_of(beckmann, eta):
    """Returns (index of the table plane below the index ratio eta, the fraction of the way to the next plane)."""
    k, r = _node(_bend(eta))
    return k + (GLASS_SIZE if beckmann != _ZERO else 0), r


@device
def _bend(eta):
    return ((eta - _ONE) / (eta + _ONE) + _MOST_BEND) * _BENDS


@device
def _plane(k, i, j, s, t):
    smoother = _mix(_TABLE[k, i, j], _TABLE[k, i, j + 1], t)
    rougher = _mix(_TABLE[k, i + 1, j], _TABLE[k, i + 1, j + 1], t)
    return _mix(smoother, rougher, s)


@subroutine
def glass_albedo(beckmann, cosine, roughness, eta):
    """Returns the single-scattering albedo of rough glass, reflection plus transmission, for one direction.

    cosine: of the angle between the direction and the normal. eta: index beyond the boundary over index on this side. beckmann:
    see facets.py.
    """
    never_inline()
    k, r = _plane_of(beckmann, eta)
    i, s = _node(roughness * _LAST)
    j, t = _node(math.sqrt(max(cosine, _ZERO)) * _LAST)
    return min(_mix(_plane(k, i, j, s, t), _plane(k + 1, i, j, s, t), r), _ONE)


@subroutine
def glass_mean_albedo(beckmann, roughness, eta):
    """Returns the mean of `glass_albedo` over the cosine-weighted hemisphere."""
    never_inline()
    k, r = _plane_of(beckmann, eta)
    i, s = _node(roughness * _LAST)
    here = _mix(_TABLE[k, GLASS_SIZE, i], _TABLE[k, GLASS_SIZE, i + 1], s)
    return _mix(here, _mix(_TABLE[k + 1, GLASS_SIZE, i], _TABLE[k + 1, GLASS_SIZE, i + 1], s), r)
