"""Splitting: a path's first vertex scatters it into several branches, which go on side by side (Arvo & Kirk, "Particle Transport
and Image Synthesis", 1990). Of one path, or of eight.

Most of a picture's noise is what lies behind the first vertex, and the way there need not be gone twice for it. The branches
are samples of one strategy: together they are weighed against light sampling (Veach 1997, 9.2).
"""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.sampling.sampler import Stream, opposite
from renderer.wide.values import u32

__all__ = ["beside", "of_branch", "turned"]


_ONE = np.float32(1.0)
_ALL = np.uint32(0xFFFFFFFF)


@device
def of_branch(weight, pdf, branches):
    """One branch's part of what a vertex passes on, and the density of directions that all of them have. branches: a float."""
    return vec.scale(weight, _ONE / branches), branches * pdf


@device
def turned(numbers):
    """A second branch's numbers at the vertex where it begins, of those of the first: evenly between them."""
    x, y, choose = opposite(numbers)
    return x, y, choose, numbers[3]


@device
def beside(stream):
    """Where a second branch's numbers come from behind that vertex: as those of another pixel, far away."""
    return Stream(stream.sampler, stream.seed, u32(stream.pixel ^ _ALL), stream.sample)
