"""Tests of sampling a path guide: directions follow their density, which integrates to 1."""

from __future__ import annotations

import numpy as np

from renderer.arrays.guide import BINS, NO_BLOCK, Guide
from renderer.guiding.histograms import guide_of
from renderer.jit import entry
from renderer.kernel.steps.guide import histogram_pdf, sample_histogram
from tests.renderer.guiding.records import NO_PHOTONS, made_records
from tests.renderer.judge import direction_test

N = 100_000


@entry
def _directions(guide, block, u, found, pdf):
    """Writes the direction sampled for each u, and the pdf of the directions in `found` before that."""
    for i in range(len(found)):
        pdf[i] = histogram_pdf(guide, np.float32(block), (found[i, 0], found[i, 1], found[i, 2]))
        w = sample_histogram(guide, block, (u[i, 0], u[i, 1]))
        for k in range(3):
            found[i, k] = w[k]


def _sampled(guide: Guide, block: int, u: np.ndarray) -> np.ndarray:
    found = np.zeros((len(u), 3), np.float32)
    found[:, 2] = 1
    _directions(guide, block, u, found, np.zeros(len(u), np.float32))
    return found


def _density(guide: Guide, block: int, at: np.ndarray) -> np.ndarray:
    pdf = np.zeros(len(at), np.float32)
    _directions(guide, block, np.zeros((len(at), 2), np.float32), np.array(at, np.float32), pdf)
    return pdf


def test_directions_follow_their_density():
    guide = guide_of(made_records(20_000), NO_PHOTONS, 0.0)
    block = int(guide.cell[guide.cell[:, 0] != NO_BLOCK, 0][0])
    assert (guide.bin[block * BINS : (block + 1) * BINS, 1] != NO_BLOCK).any(), "no bin is divided"
    directions = _sampled(guide, block, np.random.default_rng(3).random((N, 2), np.float32))
    assert np.abs(np.linalg.norm(directions, axis=1) - 1).max() < 1e-6
    direction_test(directions, lambda at: _density(guide, block, at), tests=1, fine=24)


def test_the_ends_of_the_unit_square_are_directions():
    guide = guide_of(made_records(20_000), NO_PHOTONS, 0.0)
    block = int(guide.cell[guide.cell[:, 0] != NO_BLOCK, 0][0])
    ends = np.array([0.0, 1.0 - 2.0**-24], np.float32)
    directions = _sampled(guide, block, np.stack(np.meshgrid(ends, ends), -1).reshape(-1, 2))
    assert np.isfinite(directions).all()
    assert (_density(guide, block, directions) > 0).all()
