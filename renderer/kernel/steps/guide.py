"""Directions sampled from the path guide of a scene: a learned distribution of incident light; for one path or for eight.

A vertex on a surface that is not specular samples its direction from a mixture: with a given probability from the histogram of
its cell (renderer/arrays/guide.py), else by the BSDF (one-sample model, Veach, "Robust Monte Carlo Methods for Light Transport
Simulation", 1997, 9.2.4). The density of the mixture takes the place of the BSDF's in all MIS weights. The histogram is sampled
by hierarchical warping, as in Mueller et al., "Practical Path Guiding for Efficient Light-Transport Simulation" (2017), with
wider nodes. Whatever the histogram holds, the estimate is unbiased, since the BSDF's density is part of the mixture.

Compiled only for settings with `guiding`, and for the processor only: bins are compared eight at a time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.arrays.guide import BINS, BLOCK_WIDTH, CELLS_PER_UNIT, COUNT, LOW, SIDE, SIDES
from renderer.bvh.simd import bits, less_equal, load, lowest_bit, splat
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.sampling.octahedron import octahedron_to_square, square_to_octahedron, square_to_octahedron_pdf
from renderer.kernel.steps.aim import mixed_sample, unguided_factor
from renderer.kernel.steps.state import BsdfSample
from renderer.wide.lanes import each_lane
from renderer.wide.values import any_of, not_, where, where3, zero_like

__all__ = ["Guided", "choose_guided", "guided_pdf", "guided_sample", "histogram_pdf", "sample_histogram"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_BELOW_ONE = np.float32(1.0 - 2.0**-24)
_SIDE = np.float32(SIDE)
_BINS = np.float32(BINS)
_ALL, _LAST = np.uint32(255), np.uint32(128)


class Guided(NamedTuple):
    """A vertex's choice between its guide and its BSDF."""

    block: Any  # of its cell's histogram, uint32; any number if `chance` is 0
    chance: Any  # probability of sampling the guide; 0 without a histogram
    is_guided: Any
    direction: Any  # from the guide, world space; any unit vector if not guided
    choose: Any  # the random number that is left, in [0, 1), to choose a lobe of the BSDF


@device
def _coordinate(guide, x, axis):
    at = (x - guide.frame[LOW + axis]) * guide.frame[CELLS_PER_UNIT]
    return np.int64(min(max(at, _ZERO), guide.frame[COUNT + axis] - _ONE))


@device
def _block_at(guide, p, n):
    """Returns the block of the histogram for a point with normal n, or NO_BLOCK."""
    x, y, z = _coordinate(guide, p[0], 0), _coordinate(guide, p[1], 1), _coordinate(guide, p[2], 2)
    ax, ay, az = abs(n[0]), abs(n[1]), abs(n[2])
    axis, component = np.int64(2), n[2]
    if ax >= ay and ax >= az:
        axis, component = np.int64(0), n[0]
    elif ay >= az:
        axis, component = np.int64(1), n[1]
    side = axis * 2 + (1 if component < _ZERO else 0)
    cube = (x * np.int64(guide.frame[COUNT + 1]) + y) * np.int64(guide.frame[COUNT + 2]) + z
    return np.int64(guide.cell[cube * SIDES + side])


@device
def _step(cdf, first, u):
    """Returns (the number of the bin, of a cdf of SIDE values, that contains u; u rescaled within the bin)."""
    k = np.int64(lowest_bit((bits(less_equal(load(cdf, first), splat(u))) ^ _ALL) | _LAST))
    low = cdf[first + k - 1] if k > 0 else _ZERO
    return k, min((u - low) / (cdf[first + k] - low), _BELOW_ONE)


@device
def sample_histogram(guide, block, u):
    """Returns the unit direction sampled from a block of a guide. u: two random numbers in [0, 1)."""
    a, b = u
    x, y, size = _ZERO, _ZERO, _ONE
    at = np.int64(block)
    while at >= 0:
        i, a = _step(guide.cdf, at * BLOCK_WIDTH, a)
        j, b = _step(guide.cdf, at * BLOCK_WIDTH + SIDE + i * SIDE, b)
        size = size / _SIDE
        x, y = x + np.float32(i) * size, y + np.float32(j) * size
        at = np.int64(guide.child[at * BINS + i * SIDE + j])
    return square_to_octahedron((x + a * size, y + b * size))


@device
def histogram_pdf(guide, block, w):
    """Returns the pdf, per steradian, of `sample_histogram` at the unit direction w."""
    x, y = octahedron_to_square(w)
    density = square_to_octahedron_pdf(w)
    at = np.int64(block)
    while at >= 0:
        x, y = x * _SIDE, y * _SIDE
        i, j = min(max(np.int64(x), 0), SIDE - 1), min(max(np.int64(y), 0), SIDE - 1)
        x, y = x - np.float32(i), y - np.float32(j)
        rows = at * BLOCK_WIDTH
        within = rows + SIDE + i * SIDE
        height = guide.cdf[rows + i] - (guide.cdf[rows + i - 1] if i > 0 else _ZERO)
        width = guide.cdf[within + j] - (guide.cdf[within + j - 1] if j > 0 else _ZERO)
        density = density * (height * width * _BINS)
        at = np.int64(guide.child[at * BINS + i * SIDE + j])
    return density


@subroutine
def _choose(scene, x, y, z, nx, ny, nz, choose, a, b):
    """Returns (block, probability of sampling the guide, its direction) for one vertex."""
    never_inline()
    block = _block_at(scene.path_guide, (x, y, z), (nx, ny, nz))
    chance, d = _ZERO, (_ZERO, _ZERO, _ONE)
    if block >= 0:
        chance = scene.path_guide.share[block]
        if choose < chance:
            d = sample_histogram(scene.path_guide, block, (a, b))
    return np.uint32(block), chance, d


@subroutine
def _pdf(scene, block, x, y, z):
    never_inline()
    return histogram_pdf(scene.path_guide, np.int64(block), (x, y, z))


@device
def choose_guided(scene, point, normal, is_specular, is_surface, choose, u):
    """Decides at random whether a vertex samples its guide, and samples the direction if so; returns a Guided.

    normal: the shading normal on the viewer's side. is_surface: False for a vertex in a medium. choose: the random number for the
    choice of a lobe. u: two numbers for the direction.
    """
    none = zero_like(choose)
    wanted = not_(is_specular) & is_surface & (choose == choose)
    block, chance, d = each_lane(_choose, wanted, (scene, *point, *normal, choose, u[0], u[1]))
    is_guided = choose < chance
    left = where(is_guided, none, (choose - chance) / (_ONE - chance))
    direction = where3(is_guided, d, (none, none, none + _ONE))
    return Guided(block, chance, is_guided, direction, min(left, none + _BELOW_ONE))


@device
def guided_pdf(scene, guided, d, bsdf_pdf):
    """Returns the pdf, per steradian, of the unit direction d by the mixture of a vertex's BSDF and its guide.

    bsdf_pdf: of d by the BSDF alone.
    """
    has_guide = guided.chance > _ZERO
    own = each_lane(_pdf, has_guide, (scene, guided.block, *d))
    return where(has_guide, (_ONE - guided.chance) * bsdf_pdf + guided.chance * own, bsdf_pdf)


@device
def guided_sample(scene, guided, frame, sample, wi, f, bsdf_pdf, own_pdf):
    """Returns the BsdfSample of the mixture.

    sample: the BSDF's, for a vertex that does not sample its guide. wi: the guide's direction in the shading frame. f, bsdf_pdf:
    f |cos| and the BSDF's pdf for wi. own_pdf: the pdf for wi by which `sample` is distributed, which differs from the BSDF's
    where a vertex also aims (aim.py).
    """
    s, t, n = frame
    own = where(guided.is_guided, own_pdf, sample.pdf)
    d = where3(guided.is_guided, guided.direction, vec.to_world(s, t, n, sample.wi))
    pdf = guided_pdf(scene, guided, d, own)
    if any_of(guided.chance > _ZERO):
        mixed = mixed_sample(guided.chance, guided.is_guided, sample, wi, f, own, pdf)
        inner = where(guided.is_guided, unguided_factor(own_pdf, bsdf_pdf), sample.unguided)
        sample = BsdfSample(mixed.wi, mixed.weight, mixed.pdf, mixed.eta2, mixed.unguided * inner)
    return sample
