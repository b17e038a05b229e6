"""Tests of dividing a live view into pieces, each a tile and a range of samples.

Every sample is in one piece, the first picture is within its time limit, and lost pieces come next.
"""

from __future__ import annotations

import numpy as np
import pytest

from protocol.view_parts import CLEAN_GUIDE_SAMPLES
from service.viewing.passes import (
    DRAFT_S,
    FIRST_GUIDES,
    FIRST_PICTURE_S,
    GUIDES_AFTER,
    Passes,
    Piece,
    draft_size,
    has_guides,
    levels_of,
)


def all_of(passes: Passes) -> list[list[Piece]]:
    found = []
    while pieces := passes.next_message():
        found.append(pieces)
    return found


@pytest.mark.parametrize("cost", [1e-8, 1e-6, 1e-4, 1e-2])
@pytest.mark.parametrize("slots", [1, 2, 64])
def test_each_sample_is_in_exactly_one_piece(cost: float, slots: int) -> None:
    levels = levels_of(160, 90, 11, cost, slots)
    assert (levels[-1].width, levels[-1].height, levels[-1].samples) == (160, 90, 11)
    passes = Passes(levels, cost)
    samples = [{tile: [] for tile in range(len(level.tiles))} for level in levels]
    for pieces in all_of(passes):
        assert len({piece.level for piece in pieces}) == 1
        for piece in pieces:
            samples[piece.level][piece.tile] += range(piece.first, piece.first + piece.count)
    for level, of in zip(levels, samples, strict=True):
        assert all(numbers == list(range(level.samples)) for numbers in of.values())
        covered = np.zeros((level.height, level.width), int)
        for tile in level.tiles:
            covered[tile.y : tile.y + tile.h, tile.x : tile.x + tile.w] += 1
        assert (covered == 1).all()


@pytest.mark.parametrize("cost", [1e-8, 1e-5, 1e-2])
def test_guides_follow_the_first_samples_in_messages_of_their_own(cost: float) -> None:
    levels = levels_of(160, 90, 64, cost, 2)
    sent = all_of(Passes(levels, cost, has_guides=True))
    assert all(len({(piece.level, piece.is_guide) for piece in pieces}) == 1 for pieces in sent)
    whole = [piece for pieces in sent for piece in pieces if piece.level == len(levels) - 1]
    numbers = {tile: [] for tile in range(len(levels[-1].tiles))}
    for place, piece in enumerate(whole):
        if piece.is_guide:
            numbers[piece.tile] += range(piece.first, piece.first + piece.count)
            assert all(each.first < GUIDES_AFTER for each in whole[:place] if not each.is_guide)
    assert all(found == list(range(GUIDES_AFTER, FIRST_GUIDES)) for found in numbers.values())
    plain = [piece for pieces in all_of(Passes(levels, cost)) for piece in pieces]
    assert [piece for pieces in sent for piece in pieces if not piece.is_guide] == plain, "all samples besides"
    guiding = {tile: [] for tile in numbers}
    for pieces in sent:
        assert len({has_guides(piece) for piece in pieces}) == 1, "a message has one set of planes"
        for piece in pieces:
            if has_guides(piece) and piece.level == len(levels) - 1:
                guiding[piece.tile] += range(piece.first, piece.first + piece.count)
    assert all(found == list(range(CLEAN_GUIDE_SAMPLES)) for found in guiding.values()), "each sample guides once"
    few = all_of(Passes(levels_of(160, 90, GUIDES_AFTER, cost, 2), cost, has_guides=True))
    assert not any(piece.is_guide for pieces in few for piece in pieces), "the view is complete before they would be used"


def test_first_picture_respects_time_limit() -> None:
    for slots, cost in ((2, 1e-6), (16, 1e-5)):
        first = levels_of(1920, 1080, 256, cost, slots)[0]
        assert first.width * first.height * cost / slots == pytest.approx(FIRST_PICTURE_S, rel=0.05)
        assert len(first.tiles) >= slots, "work for all of them"
    assert len(levels_of(320, 180, 4, 1e-7, 2)) == 1, "what is quick is whole at once"


def test_lost_pieces_are_sent_next() -> None:
    passes = Passes(levels_of(64, 64, 4, 1e-6, 1), 1e-6)
    first = passes.next_message()
    passes.next_message()
    passes.requeue(first)
    assert passes.next_message()[: len(first)] == first


def test_draft_is_as_large_as_a_card_renders_in_time() -> None:
    for cost in np.geomspace(1e-11, 1e-6, 40):
        width, height, samples = draft_size(1920, 1080, 256, cost)
        assert width * height * samples * cost <= DRAFT_S or (width, height, samples) == (240, 135, 1)
        assert 240 <= width <= 1920 and width % 240 == 0 and height == 1080 * width // 1920 and 1 <= samples <= 4
        assert samples == 1 or (width, height) == (1920, 1080), "size precedes samples"
    assert draft_size(1920, 1080, 256, 2e-9) == (1920, 1080, 4)
    assert draft_size(1920, 1080, 2, 2e-9) == (1920, 1080, 2), "not more samples than the view"
    assert draft_size(16, 16, 256, 1.0) == (2, 2, 1)
