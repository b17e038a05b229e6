"""Tests of the cache of tile sums: its size is limited, and the least recently used sums are dropped.

Sums are added up only when they are read.
"""

from __future__ import annotations

import numpy as np
import pytest

from renderer.film import Sums
from service.store.tile_cache import MAX_PENDING, TileCache

KEY = ("film", 0, 3)


def sums(value: int) -> Sums:
    return np.full((2, 4, 4), value, np.int64)


def adding(value: int, done: list[int]) -> object:
    def add(total: Sums) -> None:
        done.append(value)
        total += value

    return add


def test_pending_samples_are_summed_on_read() -> None:
    cache, done = TileCache(1 << 20), list[int]()
    cache.add_samples(KEY, adding(1, done), 10)  # type: ignore[arg-type]
    assert cache.get(KEY) is None, "nobody had asked before"
    cache.put(KEY, sums(5))
    before = cache.get(KEY)
    for value in (1, 2):
        cache.add_samples(KEY, adding(value, done), 10)  # type: ignore[arg-type]
    assert not done
    np.testing.assert_array_equal(cache.get(KEY), sums(8))
    np.testing.assert_array_equal(cache.get(KEY), sums(8))
    assert done == [1, 2], "once"
    np.testing.assert_array_equal(before, sums(5), "who has it keeps it as it was")


def test_unread_tile_is_evicted() -> None:
    cache, done = TileCache(1 << 20), list[int]()
    cache.put(KEY, sums(5))
    for value in range(MAX_PENDING + 1):
        cache.add_samples(KEY, adding(value, done), 10)  # type: ignore[arg-type]
    assert cache.get(KEY) is None
    assert cache._bytes == 0
    cache.put(KEY, sums(5))
    cache.evict(KEY)
    assert cache.get(KEY) is None
    assert not done


@pytest.mark.parametrize("by_growth", [False, True])
def test_cache_size_is_limited(by_growth: bool) -> None:
    size = sums(0).nbytes
    cache = TileCache(4 * size)
    for tile in range(4):
        cache.put(("film", 0, tile), sums(tile))
    cache.get(("film", 0, 0))
    if by_growth:
        cache.add_samples(("film", 0, 3), adding(1, []), size)  # type: ignore[arg-type]
    else:
        cache.put(("other", 0, 0), sums(9))
    left = [tile for tile in range(4) if cache.get(("film", 0, tile)) is not None]
    assert left == [0, 2, 3], "what was used longest ago went"
    cache.evict_film("film")
    cache.evict_film("other")
    assert cache._bytes == 0
