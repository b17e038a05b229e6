"""Path splitting: the first vertex scatters a path into several branches, for one path or for eight lanes.

Arvo & Kirk, "Particle Transport and Image Synthesis", 1990. Most of the noise arises after the first vertex, and the branches
share the cost of reaching it. They are samples of one strategy and are weighted together against light sampling (Veach 1997,
9.2).
"""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.sampling.sampler import Stream, opposite
from renderer.wide.values import not_, u32

__all__ = ["second_branch_numbers", "second_branch_stream", "share_of_branch", "splits"]


_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_ALL = np.uint32(0xFFFFFFFF)


@device
def splits(number, specular):
    """Returns True if a path splits at its vertex: only at the first one, and not if that is specular.

    number: count of earlier vertices.
    """
    return (number == _ZERO) & not_(specular)


@device
def share_of_branch(weight, pdf, branches):
    """Returns (fraction of a vertex's weight that one branch gets, joint density of the directions of all branches).

    branches: their number, a float.
    """
    return vec.scale(weight, _ONE / branches), branches * pdf


@device
def second_branch_numbers(numbers):
    """Returns the second branch's random numbers at the splitting vertex, stratified together with those of the first."""
    x, y, choose = opposite(numbers)
    return x, y, choose, numbers[3]


@device
def second_branch_stream(stream):
    """Returns the random number stream that a second branch uses after the vertex where the path split.

    It is the stream of a pixel far away, and so independent of that of the first branch.
    """
    return Stream(stream.sampler, stream.seed, u32(stream.pixel ^ _ALL), stream.sample)
