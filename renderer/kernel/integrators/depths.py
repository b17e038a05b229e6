"""Bounces of a path by kind, each with a limit of its own beside that of all segments.

A bounce is diffuse where its density is at most that of a cosine lobe at its middle, 1 / pi per steradian; glossy where it is
greater, or where the direction is the only one: a mirror's. Smooth transmission has a count of its own (`is_counted` of
state.py), and vertices in a medium have none. Both counts are kept in one float32. Of one path, or of eight.
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
    """The counts after a bounce that `is_counted`. pdf: of the material's whole density; 0: of a single direction."""
    is_glossy = (pdf > _DIFFUSE) | ((pdf == _ZERO) & reflected)
    is_diffuse = (pdf > _ZERO) & not_(is_glossy)
    return counts + where(is_glossy, _GLOSSY, where(is_diffuse, _ONE, _ZERO))


@device
def spent(counts, options):
    """Whether the path ends at the next surface, whose emission it still sees."""
    glossy = to_float(to_int(counts * _PER_GLOSSY))
    return (counts - glossy * _GLOSSY >= options.diffuse_depth) | (glossy >= options.glossy_depth)
