"""Tests of the encoding of film sums: every kind of plane is restored bit by bit, and damage is detected."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.sums import add_sums, check_sums, check_weight, pack_sums, unpack_sums
from renderer.film import ALBEDO, CHANNELS, COLOR, COLOR_HALF, MATERIAL, SAMPLES, Sums, plane_count
from renderer.settings import Tile

TILE = Tile(0, 0, 7, 5)


def sums_of(seed: int, bits: list[int]) -> Sums:
    """Returns random sums (channels, 5, 7); the values of plane i fit into bits[i] bits.

    If bits[i] is 0, all values of the plane are equal.
    """
    random = np.random.default_rng(seed)
    planes = [
        random.integers(-(1 << b - 1), (1 << b - 1) - 1, (5, 7), endpoint=True) if b else np.full((5, 7), seed) for b in bits
    ]
    return np.array(planes, np.int64)


@settings(max_examples=50)
@given(
    st.integers(0, 1 << 30), st.lists(st.sampled_from([0, 1, 8, 9, 16, 17, 32, 33, 63, 64]), min_size=CHANNELS, max_size=CHANNELS)
)
def test_packed_sums_round_trip(seed: int, bits: list[int]) -> None:
    sums = sums_of(seed, bits)
    sums[COLOR_HALF] = sums[COLOR]
    for packing in (1, 2):
        data = pack_sums(sums, packing)
        check_sums(data, TILE)
        np.testing.assert_array_equal(unpack_sums(data, TILE), sums)
        found = unpack_sums(data, TILE, planes=(4, MATERIAL))  # the first plane is a copy of one that is not requested
        np.testing.assert_array_equal(found[[4, MATERIAL]], sums[[4, MATERIAL]])
        assert not found[[0, SAMPLES]].any()
        add_sums(found, data, TILE, planes=(4, MATERIAL))
        np.testing.assert_array_equal(found[[4, MATERIAL]], 2 * sums[[4, MATERIAL]])
        assert not found[[0, SAMPLES]].any()
        add_sums(found, data, TILE)
        np.testing.assert_array_equal(found[[0, 4, SAMPLES]], sums[[0, 4, SAMPLES]] * [[[1]], [[3]], [[1]]])


def test_equal_planes_take_no_space() -> None:
    sums = np.zeros((CHANNELS, 5, 7), np.int64)
    sums[COLOR] = sums_of(3, [24, 24, 24])
    without = len(pack_sums(sums))
    sums[COLOR_HALF] = sums[COLOR]
    sums[ALBEDO] = 1 << 60
    assert len(pack_sums(sums)) == without
    assert without < 3 * 4 * 35 + 9 * CHANNELS + 2 + 30


def test_planes_that_are_left_out_are_packed_as_zero() -> None:
    """Also of a part of larger sums, whose rows are not adjacent in memory."""
    sums = np.random.default_rng(1).integers(-(1 << 40), 1 << 40, (CHANNELS, 9, 12))
    sums[4] = sums[3]
    part, wanted = sums[:, 2:7, 3:11], {0, 2, 4, CHANNELS - 1}
    zeroed = np.zeros_like(part)
    zeroed[sorted(wanted)] = part[sorted(wanted)]
    assert pack_sums(part, planes=wanted) == pack_sums(zeroed)
    assert pack_sums(part, planes=range(CHANNELS)) == pack_sums(part)


def test_planes_missing_in_older_release_are_zero() -> None:
    sums = sums_of(5, [20] * CHANNELS)
    for packing in (1, 2):
        old_planes = sums[:12]
        old = pack_sums(old_planes, packing)
        with pytest.raises(ValueError, match="sums have"):
            unpack_sums(old, TILE)
        found = unpack_sums(old, TILE, stored=True)
        np.testing.assert_array_equal(found[:12], sums[:12])
        assert not found[12:].any()
        add_sums(found, old, TILE, stored=True)
        np.testing.assert_array_equal(found[:12], 2 * old_planes)
        assert not found[12:].any()


def test_damaged_sums_are_rejected() -> None:
    good = pack_sums(sums_of(7, [0, 20, 40, 8] * 5))
    heads = 2 + 9 * CHANNELS
    wrong = [b"", good[:1], good[:40], good[:-1], good + b"x", b"\x03" + good[1:]]
    wrong += [good[:2] + b"\x09" + good[3:], good[:2] + b"\x07" + good[3:]]  # the first plane as a copy, and of an unknown kind
    wrong += [good[:heads] + bytes(len(good) - heads)]
    for data in wrong:
        for read in (check_sums, unpack_sums):
            with pytest.raises(ValueError):
                read(data, TILE)
    for read in (check_sums, unpack_sums):
        with pytest.raises(ValueError):
            read(good, Tile(0, 0, 7, 6))


@pytest.mark.parametrize("packing", [1, 2])
def test_pixel_sample_counts_are_checked(packing: int) -> None:
    sums = sums_of(9, [20] * CHANNELS)
    for least, most, is_right in ((3, 3, True), (0, 3, True), (0, 4, False), (4, 4, False), (-1, 3, False), (-1, -1, False)):
        sums[SAMPLES] = least
        sums[SAMPLES, 4, 6] = most
        for same in (sums[SAMPLES], sums[SAMPLES] + 1):
            sums[COLOR][0] = same  # with the plane encoded as a copy of another
            data = pack_sums(sums, packing)
            if is_right:
                check_weight(data, TILE, 3)
            else:
                with pytest.raises(ValueError, match="but the batch has 3"):
                    check_weight(data, TILE, 3)


def test_sums_with_light_groups_have_extra_planes() -> None:
    """A film with other planes rejects sums with light groups. Sums with a damaged number of planes are always rejected."""
    planes = plane_count(3)
    sums = sums_of(4, [20] * planes)
    sums[SAMPLES] = 2
    data = pack_sums(sums)
    check_sums(data, TILE)
    check_weight(data, TILE, 2, planes)
    np.testing.assert_array_equal(unpack_sums(data, TILE), sums)
    total = sums.copy()
    add_sums(total, data, TILE)
    np.testing.assert_array_equal(total, 2 * sums)
    for wrong in (CHANNELS, plane_count(2), plane_count(4)):
        with pytest.raises(ValueError, match="planes"):
            check_weight(data, TILE, 2, wrong)
        other = np.zeros((wrong, TILE.h, TILE.w), np.int64)
        with pytest.raises(ValueError, match="planes"):
            add_sums(other, data, TILE)
        assert not other.any()
    for count in (CHANNELS + 2, plane_count(28)):
        with pytest.raises(ValueError, match="planes"):
            check_sums(pack_sums(np.zeros((count, TILE.h, TILE.w), np.int64)), TILE)
