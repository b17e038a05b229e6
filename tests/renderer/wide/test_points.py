"""Tests that random numbers of eight samples have the same bits as those of each sample alone, on any processor."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.jit import entry
from renderer.kernel.sampling.sampler import SOBOL, Stream, draw4, draw_film
from renderer.wide.rows import load_ints
from tests.renderer.wide.both import keep

_SEED, _BLOCK = np.uint32(7), np.uint32(5)


@entry
def _drawn(pixel, sample, block, eight, one):
    for i in range(0, len(sample), 8):
        number = load_ints(sample, np.uintp(i))
        stream = Stream(SOBOL, _SEED, load_ints(pixel, np.uintp(i)), number)
        blocks = load_ints(block, np.uintp(i))
        keep(eight, i, number, (*draw4(stream, _BLOCK), *draw4(stream, blocks), *draw_film(stream)))
        for j in range(i, i + 8):
            stream = Stream(SOBOL, _SEED, np.uint32(pixel[j]), np.uint32(sample[j]))
            keep(one, j, j, (*draw4(stream, _BLOCK), *draw4(stream, np.uint32(block[j])), *draw_film(stream)))


@pytest.mark.parametrize("most", [1, 64, 1 << 28])
def test_numbers_for_eight_lanes_equal_single_ones(most: int) -> None:
    random = np.random.default_rng(3)
    sample = random.integers(0, most, 800).astype(np.int32)
    pixel = random.integers(-(1 << 31), 1 << 31, 800).astype(np.int32)
    block = random.integers(0, 17, 800).astype(np.int32)
    eight, one = np.full((2, 12, 800), np.float32(-1.0))
    _drawn(pixel, sample, block, eight, one)
    np.testing.assert_array_equal(eight, one)
    assert eight.min() >= 0.0
    assert 0.9 < eight.max() < 1.0
