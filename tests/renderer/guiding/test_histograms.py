"""Tests of making a guide from records: it depends on the records alone, and holds what they show."""

from __future__ import annotations

import numpy as np

from renderer.arrays.guide import BINS, BLOCK_WIDTH, NO_BLOCK, SIDE
from renderer.guiding.histograms import guide_of
from renderer.kernel.guiding.pilot import RECORD_COLUMNS, RECORD_NEAR, RECORD_SCALE
from tests.renderer.guiding.records import NO_PHOTONS, made_records


def test_the_order_of_paths_changes_no_bit():
    paths = made_records(20_000).reshape(-1, 2, RECORD_COLUMNS)
    photons = made_records(5_000, seed=2)
    first = guide_of(paths.reshape(-1, RECORD_COLUMNS), photons, 1e-4)
    order = np.random.default_rng(5).permutation(len(paths))
    other = guide_of(paths[order].reshape(-1, RECORD_COLUMNS), photons[::-1], 1e-4)
    assert len(first.bin) > BINS
    assert all(np.array_equal(a, b) for a, b in zip(first, other, strict=True))


def test_blocks_are_distributions():
    guide = guide_of(made_records(20_000), NO_PHOTONS, 0.0)
    cdf = guide.cdf.reshape(-1, BLOCK_WIDTH)
    parts = np.concatenate((cdf[:, None, :SIDE], cdf[:, SIDE:].reshape(-1, SIDE, SIDE)), axis=1)
    assert (parts[:, :, -1] == 1).all()
    assert (np.diff(parts, axis=2, prepend=0) > 0).all(), "a bin cannot be sampled"
    block, share = guide.cell.T
    child = guide.bin[:, 1].reshape(-1, BINS)
    roots = block[block != NO_BLOCK].astype(np.int64)
    assert roots.min() > 0 and roots.max() < len(cdf) and child.max() < len(cdf)
    assert ((share > 0) == (block != NO_BLOCK)).all() and share.max() < 1
    assert child[roots].max() > NO_BLOCK, "the lamp's bin is not divided"
    assert np.allclose(guide.bin[:, 0].reshape(-1, BINS).mean(axis=1), 1, atol=1e-5)
    assert (guide.bin[:BINS] == (1, NO_BLOCK)).all(), "the first block is not uniform"


def test_a_scene_without_light_has_no_histogram():
    records = made_records(2_000)
    dark = records.copy()
    dark[:, [RECORD_NEAR, RECORD_SCALE]] = 0
    for each in (dark, records[:4], records[:0]):
        guide = guide_of(each, NO_PHOTONS, 0.0)
        assert (guide.cell == (NO_BLOCK, 0)).all()
        assert len(guide.bin) == BINS


def test_cells_with_few_records_share_a_histogram():
    guide = guide_of(made_records(4_000), NO_PHOTONS, 0.0)
    used = guide.cell[guide.cell[:, 0] != NO_BLOCK, 0]
    assert len(np.unique(used)) < len(used)
