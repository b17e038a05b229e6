"""Learns the probability of sampling the guide in each cell, from pilot paths that its histograms were not made from.

The integrand at a vertex is the light that arrives times the cosine; for the light of the next bounces its mean over the next
vertex's cell. The second moment of its estimate from a mixture of the histogram and the cosine is the mean, over directions of
any other density, of the squared integrand over the product of both densities. A cell gets the smallest share whose second
moment is within a tenth of the smallest, since the weights of other directions multiply along a path; it gets a share of 0 if
that saves less than a tenth, which would not pay for looking up the guide.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from renderer.arrays.guide import BINS, CELL_WIDTH, NO_BLOCK, SIDE, Guide, histogram_guide
from renderer.guiding.histograms import Records, arriving, cells_of, integers, squares, sums

__all__ = ["SHARES", "learn_shares"]

SHARES = (0.0, 0.125, 0.25, 0.375, 0.5)
_SAVED = 0.9  # a cell is guided if its second moment falls below this fraction


def learn_shares(guide: Guide, other: Guide, records: Records) -> tuple[Guide, float]:
    """Returns (the guide with the shares of its cells, the fraction of the sum of all second moments that is left).

    other: a guide made without these records of camera paths, whose histograms stand for the guide's. The fraction is 1 if no
    cell is guided.
    """
    cell = cells_of(records, guide.frame)
    block = guide.cell[cell, 0].astype(np.int64)
    light = arriving(records, cell, len(guide.cell))
    direction, normal = records[:, 6:9].astype(np.float64), records[:, 3:6].astype(np.float64)
    cosine = np.abs(direction[:, 0] * normal[:, 0] + direction[:, 1] * normal[:, 1] + direction[:, 2] * normal[:, 2])
    used = np.flatnonzero((light > 0) & (block != NO_BLOCK) & (cosine > 0))
    block, light, cosine, direction = block[used], light[used], cosine[used], direction[used]
    if not len(used):
        return _with_shares(guide, np.zeros(len(guide.bin) // BINS)), 1.0
    its = other.cell[cells_of(records[used], other.frame), 0].astype(np.int64)
    density = np.where(its != NO_BLOCK, _pdf(other, its, direction), 0.0)
    lambertian, sampled = cosine / math.pi, cosine / records[used, 10].astype(np.float64)
    moment = light * light * sampled
    mixtures = np.stack([moment / ((1 - share) * lambertian + share * density) for share in SHARES])
    _, unit = integers(mixtures[0])
    count = len(guide.bin) // BINS
    units = np.ceil(np.minimum(mixtures / unit, 2.0**21)).astype(np.int64)
    total = np.stack([sums(block, each, count) for each in units])
    best = np.argmax(total * 10 <= total.min(axis=0) * 11, axis=0)  # the first that is near the smallest
    best[np.take_along_axis(total, best[None], axis=0)[0] > _SAVED * total[0]] = 0
    left = int(np.take_along_axis(total, best[None], axis=0).sum()) / int(total[0].sum())
    return _with_shares(guide, np.array(SHARES)[best]), left


def _pdf(guide: Guide, block: npt.NDArray[np.int64], direction: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Returns the pdf, per steradian, of directions by the histograms that begin with these blocks."""
    square = squares(direction)
    outer = guide.bin[block * BINS + (square // SIDE) @ np.array([SIDE, 1])]
    inner = guide.bin[outer[:, 1].astype(np.int64) * BINS + (square % SIDE) @ np.array([SIDE, 1])]
    x, y, z = np.abs(direction).T
    length = x + y + z
    # Products in place of a power, whose last bit differs between processors: all workers must learn the same shares.
    pdf: npt.NDArray[np.float64] = outer[:, 0].astype(np.float64) * inner[:, 0] / (4 * (length * length * length))
    return pdf


def _with_shares(guide: Guide, shares: npt.NDArray[np.float64]) -> Guide:
    cell = guide.cell.copy()
    cell[:, 1] = np.where(cell[:, 0] == NO_BLOCK, 0, shares[cell[:, 0].astype(np.int64)])
    return histogram_guide(guide.frame, cell.reshape(-1, CELL_WIDTH), guide.cdf, guide.bin)
