"""Tests of additions that the threads of a warp share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.renderer.cuda.on_host import warp

LISTS = 4


@pytest.fixture(scope="module")
def reserve(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int, int, int, int], None]:
    return warp(tmp_path_factory.mktemp("warp"))


@pytest.mark.parametrize("mask", (0xFFFFFFFF, 0x80000001, 0x00F0A5C3, 0x00000010))
def test_lanes_of_a_warp_reserve_different_places(reserve: Callable[[int, int, int, int], None], mask: int) -> None:
    """Lanes that append to one list get adjacent places, in the order of their numbers, from one addition to its length."""
    random = np.random.default_rng(mask)
    lanes = np.flatnonzero(mask >> np.arange(32) & 1)
    lengths = random.integers(0, 1000, LISTS)
    for _ in range(5):
        which, places, before = random.integers(0, LISTS, 32), np.full(32, -1), lengths.copy()
        reserve(mask, lengths.ctypes.data, which.ctypes.data, places.ctypes.data)
        for number in range(LISTS):
            taken = places[lanes[which[lanes] == number]]
            assert (taken == before[number] + np.arange(len(taken))).all()
            assert lengths[number] == before[number] + len(taken)
        assert (np.delete(places, lanes) == -1).all()
