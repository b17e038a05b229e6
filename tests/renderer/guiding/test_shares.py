"""Tests of the shares of a guide's cells: the guide is sampled where that lowers the second moment, and not elsewhere."""

from __future__ import annotations

import numpy as np

from renderer.arrays.guide import NO_BLOCK
from renderer.guiding.histograms import guide_of
from renderer.guiding.shares import SHARES, learn_shares
from renderer.kernel.guiding.pilot import (
    RECORD_COLUMNS,
    RECORD_DIRECTION,
    RECORD_INDIRECT,
    RECORD_LINKED,
    RECORD_NEAR,
    RECORD_NORMAL,
    RECORD_SCALE,
)
from tests.renderer.guiding.records import NO_PHOTONS, made_records


def _diffuse(count: int, seed: int, lamp: float) -> np.ndarray:
    """Returns records of cosine-distributed directions below a white sky, a hundredth of which is `lamp` times brighter."""
    records = made_records(count // 2, seed)
    random = np.random.default_rng(seed)
    radius, angle = np.sqrt(random.random(count)), 2 * np.pi * random.random(count)
    d = np.stack((radius * np.cos(angle), np.sqrt(1 - radius * radius), radius * np.sin(angle)), axis=1)
    records[:, RECORD_DIRECTION : RECORD_DIRECTION + 3] = d
    records[:, RECORD_NEAR] = np.where(np.hypot(d[:, 0] - 0.5, d[:, 2] - 0.3) < 0.1, lamp, 1.0)
    records[:, RECORD_SCALE] = np.pi
    records[:, [RECORD_INDIRECT, RECORD_LINKED]] = 0
    assert (records[:, RECORD_NORMAL + 1] == 1).all()
    return records


def test_a_small_bright_lamp_is_guided_to_and_an_even_sky_is_not():
    for lamp, is_guided in ((400.0, True), (1.0, False)):
        earlier, last = _diffuse(20_000, 1, lamp), _diffuse(20_000, 2, lamp)
        other, guide = (guide_of(each, NO_PHOTONS, 0.0) for each in (earlier, np.concatenate((earlier, last))))
        learned, left = learn_shares(guide, other, last)
        block, share = learned.cell.T
        assert (share[block == NO_BLOCK] == 0).all() and set(share) <= set(np.float32(SHARES))
        guided = (share[block != NO_BLOCK] > 0).mean()
        assert (guided > 0.8 and left < 0.6) if is_guided else (guided == 0 and left == 1), f"{guided} of cells, {left} left"


def test_the_order_of_paths_changes_no_share():
    paths = _diffuse(20_000, 3, 400.0)
    guide = guide_of(paths, NO_PHOTONS, 0.0)
    order = np.random.default_rng(4).permutation(len(paths))
    first, other = (learn_shares(guide, guide, each) for each in (paths, paths[order].reshape(-1, RECORD_COLUMNS)))
    assert np.array_equal(first[0].cell, other[0].cell)
