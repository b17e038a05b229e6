"""Directions sampled from the path guide of a scene: a learned distribution of incident light; for one path or for eight.

A vertex on a surface that is not specular samples its direction from a mixture: with a given probability from the histogram of
its cell (renderer/arrays/guide.py), else by the BSDF (one-sample model, Veach, "Robust Monte Carlo Methods for Light Transport
Simulation", 1997, 9.2.4). The density of the mixture takes the place of the BSDF's in all MIS weights. The histogram is sampled
by hierarchical warping, as in Mueller et al., "Practical Path Guiding for Efficient Light-Transport Simulation" (2017), with
wider nodes. A guide of portals takes the place of the histograms in scenes where they suffice (portals.py). Whatever a guide
holds, the estimate is unbiased, since the BSDF's density is part of the mixture.

Compiled only for settings with `guiding`. Bins are compared eight at a time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.arrays.guide import BIN_WIDTH, BINS, BLOCK_WIDTH, CELL_WIDTH, CELLS_PER_UNIT, COUNT, LOW, SIDE, SIDES
from renderer.bvh.simd import bits, less_equal, load, lowest_bit, splat
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.fetch import columns
from renderer.kernel.sampling.octahedron import octahedron_to_square, square_to_octahedron, square_to_octahedron_pdf
from renderer.kernel.steps.aim import mixed_sample, unguided_factor
from renderer.kernel.steps.portals import NO_PORTAL, portals_in_view, portals_pdf, sample_portal
from renderer.kernel.steps.state import BsdfSample
from renderer.wide.lanes import each_lane
from renderer.wide.values import any_of, not_, to_float, to_int, u32, where, where3, zero_like

__all__ = ["Guided", "choose_guided", "guided_pdf", "guided_sample", "histogram_pdf", "sample_histogram"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_BELOW_ONE = np.float32(1.0 - 2.0**-24)
_SIDE = np.float32(SIDE)
_BINS = np.float32(BINS)
_LAST_BIN = np.float32(SIDE - 1)
_SIDES = np.float32(SIDES)
_TWO = np.float32(2.0)
_FOUR = np.float32(4.0)
_ALL, _LAST = np.uint32(255), np.uint32(128)


class Guided(NamedTuple):
    """A vertex's choice between its guide and its BSDF."""

    block: Any  # of its cell's histogram, a float; of a guide of portals, the number of its cube
    chance: Any  # probability of sampling the guide; 0 without a histogram or a portal in view
    is_guided: Any
    direction: Any  # from the guide, world space; any unit vector if not guided
    choose: Any  # the random number that is left, in [0, 1), to choose a lobe of the BSDF
    point: Any
    normal: Any
    total: Any  # of its Portals; 0 with histograms
    portal: Any  # number of the portal that was sampled, a float; NO_PORTAL if none was


@device
def _floor(x, most):
    """Returns the integer part, as a float, of x limited to 0 ... most; 0 for NaN."""
    return to_float(to_int(min(where(x > _ZERO, x, zero_like(x)), most)))


@device
def _coordinate(guide, x, axis):
    return _floor((x - guide.frame[LOW + axis]) * guide.frame[CELLS_PER_UNIT], guide.frame[COUNT + axis] - _ONE)


@device
def _cube_at(guide, p):
    """Returns the number of the cube of a point, a float."""
    x, y, z = _coordinate(guide, p[0], 0), _coordinate(guide, p[1], 1), _coordinate(guide, p[2], 2)
    return (x * guide.frame[COUNT + 1] + y) * guide.frame[COUNT + 2] + z


@device
def _cell_at(guide, p, n):
    """Returns (the block of the cell of a point with normal n, the probability of sampling its histogram)."""
    none = zero_like(p[0])
    ax, ay, az = abs(n[0]), abs(n[1]), abs(n[2])
    by_x, by_y = (ax >= ay) & (ax >= az), ay >= az
    component = where(by_x, n[0], where(by_y, n[1], n[2]))
    side = where(by_x, none, where(by_y, none + _TWO, none + _FOUR)) + where(component < _ZERO, none + _ONE, none)
    cell = _cube_at(guide, p) * _SIDES + side
    return columns(guide.cell, u32(to_int(cell)), CELL_WIDTH, 0, 2)


@device
def _step(cdf, first, u):
    """Returns (the number of the bin, of a cdf of SIDE values, that contains u; u rescaled within the bin)."""
    k = np.int64(lowest_bit((bits(less_equal(load(cdf, first), splat(u))) ^ _ALL) | _LAST))
    low = cdf[first + k - 1] if k > 0 else _ZERO
    return k, min((u - low) / (cdf[first + k] - low), _BELOW_ONE)


@device
def sample_histogram(guide, block, u):
    """Returns the unit direction sampled from the histogram that begins with a block. u: two random numbers in [0, 1)."""
    a, b = u
    x, y, size = _ZERO, _ZERO, _ONE
    at = np.int64(block)
    while True:
        i, a = _step(guide.cdf, at * BLOCK_WIDTH, a)
        j, b = _step(guide.cdf, at * BLOCK_WIDTH + SIDE + i * SIDE, b)
        size = size / _SIDE
        x, y = x + np.float32(i) * size, y + np.float32(j) * size
        at = np.int64(guide.bin[at * BINS + i * SIDE + j, 1])
        if at == 0:
            break
    return square_to_octahedron((x + a * size, y + b * size))


@device
def _bin(guide, block, x, y):
    """Returns (density, dividing block, x and y within the bin) of the bin of a block at the point (x, y) of its square."""
    x, y = x * _SIDE, y * _SIDE
    i, j = _floor(x, _LAST_BIN), _floor(y, _LAST_BIN)
    density, child = columns(guide.bin, u32(to_int(block * _BINS + i * _SIDE + j)), BIN_WIDTH, 0, 2)
    return density, child, x - i, y - j


@device
def histogram_pdf(guide, block, w):
    """Returns the pdf, per steradian, of `sample_histogram` at the unit direction w. block: a float."""
    x, y = octahedron_to_square(w)
    outer, child, x, y = _bin(guide, block, x, y)
    inner, _, _, _ = _bin(guide, child, x, y)
    return outer * inner * square_to_octahedron_pdf(w)


@subroutine
def _sample(scene, block, a, b):
    never_inline()
    return sample_histogram(scene.path_guide, block, (a, b))


@device
def choose_guided(scene, point, normal, is_specular, is_surface, choose, u):
    """Decides at random whether a vertex samples its guide, and samples the direction if so; returns a Guided.

    normal: the shading normal on the viewer's side. is_surface: False for a vertex in a medium. choose: the random number for the
    choice of a lobe. u: two numbers for the direction.
    """
    none = zero_like(point[0])
    guide, total, portal = scene.path_guide, none, none + NO_PORTAL
    can_guide = not_(is_specular) & is_surface
    if len(guide.portal) > 0:
        block = _cube_at(guide, point)
        view = portals_in_view(guide, u32(to_int(block)), point, normal, none + u[0])
        chance, total = where(can_guide, view.chance, none), view.total
        is_guided = choose < chance
        d = sample_portal(view, point, none + u[1])
        portal = where(is_guided, view.number, portal)
    else:
        block, share = _cell_at(guide, point, normal)
        chance = where(can_guide, share, none)
        is_guided = choose < chance
        d = each_lane(_sample, is_guided, (scene, block, u[0], u[1]))
    left = where(is_guided, none, (choose - chance) / (_ONE - chance))
    direction = where3(is_guided, d, (none, none, none + _ONE))
    return Guided(block, chance, is_guided, direction, min(left, none + _BELOW_ONE), point, normal, total, portal)


@device
def guided_pdf(scene, guided, d, bsdf_pdf, sampled):
    """Returns the pdf, per steradian, of the unit direction d by the mixture of a vertex's BSDF and its guide.

    bsdf_pdf: of d by the BSDF alone. sampled: the number of the portal for which d was sampled; NO_PORTAL if for none.
    """
    pdf = bsdf_pdf
    if any_of(guided.chance > _ZERO):
        guide = scene.path_guide
        if len(guide.portal) > 0:
            cube = u32(to_int(guided.block))
            of_guide = portals_pdf(guide, cube, guided.point, guided.normal, guided.total, d, sampled)
        else:
            of_guide = histogram_pdf(guide, guided.block, d)
        mixed = (_ONE - guided.chance) * bsdf_pdf + guided.chance * of_guide
        pdf = where(guided.chance > _ZERO, mixed, bsdf_pdf)
    return pdf


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
    pdf = guided_pdf(scene, guided, d, own, guided.portal)
    if any_of(guided.chance > _ZERO):
        mixed = mixed_sample(guided.chance, guided.is_guided, sample, wi, f, own, pdf)
        inner = where(guided.is_guided, unguided_factor(own_pdf, bsdf_pdf), sample.unguided)
        sample = BsdfSample(mixed.wi, mixed.weight, mixed.pdf, mixed.eta2, mixed.unguided * inner)
    return sample
