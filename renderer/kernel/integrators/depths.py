"""Limits on a path's bounces by kind, in addition to the limit on its segments; for one path or for eight lanes.

A bounce is diffuse if its pdf is at most the maximum of a cosine lobe, 1 / pi per steradian; glossy if it is greater, or if the
direction is discrete, as for a mirror. Smooth transmission has a count of its own (`is_counted` of state.py), and vertices in a
medium have none. Both counts are packed in one float32.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.wide.values import not_, to_float, to_int, where

__all__ = ["bounced", "spent"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_DIFFUSE = np.float32(1.0001 / math.pi)
_GLOSSY = np.float32(2048.0)  # more than a path has bounces
_PER_GLOSSY = np.float32(1.0 / 2048.0)


@device
def bounced(counts, reflected, pdf):
    """Returns the counts after a bounce that `is_counted`. pdf: of the whole material; 0 for a discrete direction."""
    is_glossy = (pdf > _DIFFUSE) | ((pdf == _ZERO) & reflected)
    is_diffuse = (pdf > _ZERO) & not_(is_glossy)
    return counts + where(is_glossy, _GLOSSY, where(is_diffuse, _ONE, _ZERO))


@device
def spent(counts, options):
    """Whether a limit is reached: the path ends at the next surface, after adding its emission."""
    glossy = to_float(to_int(counts * _PER_GLOSSY))
    return (counts - glossy * _GLOSSY >= options.diffuse_depth) | (glossy >= options.glossy_depth)
