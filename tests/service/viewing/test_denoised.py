"""Tests of when a live view's picture is denoised, and what the denoiser gets."""

from __future__ import annotations

import numpy as np
import pytest

from renderer import film
from renderer.image import rgbe9995
from renderer.settings import Tile
from service.viewing import denoised
from service.viewing.canvas import Canvas
from service.viewing.denoised import EARLY_REST, EARLY_SAMPLES, LOST_S, REST, DenoisedView
from service.viewing.passes import FIRST_GUIDES, Level
from tests.service.peer_worker import expected_sums

PICTURE = np.full((2, 3, 3), 0.5, np.float32)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(denoised.time, "monotonic", lambda: now[0])
    return now


def test_picture_is_denoised_at_doubled_samples_in_a_part_of_the_time(clock: list[float]) -> None:
    view = DenoisedView()
    assert not view.is_due(0, 0.9, False), "a tile has no samples"
    assert view.is_due(1, 1.0, False)
    view.begin(PICTURE, PICTURE, PICTURE, 1.0)
    assert view.means == PICTURE.tobytes() * 3
    assert not view.is_due(8, 8.0, True), "one at a time"
    clock[0] += 2.0
    view.end(rgbe9995.pack(PICTURE))
    assert (view.has_picture, view.has_shown) == (True, False)
    mean, samples = view.take()
    assert (mean.shape, samples, view.has_picture, view.has_shown) == ((3, 2, 3), 1, False, True)
    np.testing.assert_array_equal(mean, np.moveaxis(PICTURE, -1, 0))
    assert not view.is_due(8, 8.0, False), "it rests"
    assert view.is_due(8, 8.0, True), "but not before the last picture"
    clock[0] += EARLY_REST * 2.0
    assert view.is_due(2, 2.0, False)
    assert not view.is_due(1, 1.9, False)
    assert not view.is_due(1, 1.0, True), "nothing new"
    view.begin(PICTURE, PICTURE, PICTURE, EARLY_SAMPLES)
    clock[0] += 2.0
    view.end(rgbe9995.pack(PICTURE))
    assert view.shown_samples == 1, "the next is not taken yet"
    clock[0] += EARLY_REST * 2.0
    assert not view.is_due(16, 16.0, False), "a good picture rests longer"
    clock[0] += (REST - EARLY_REST) * 2.0
    assert view.is_due(16, 16.0, False)


def test_small_pictures_are_denoised_once_each_and_the_whole_one_waits_for_none(clock: list[float]) -> None:
    view = DenoisedView()
    assert not view.is_small_due(0, False), "a tile has no samples"
    for level in (0, 1):
        assert view.is_small_due(level, True)
        view.begin(PICTURE, PICTURE, PICTURE, 1.0, level, is_whole=False)
        assert not view.is_small_due(1, True), "one at a time"
        clock[0] += 2.0
        view.end(rgbe9995.pack(PICTURE))
        assert view.take()[1] == 0.0
        assert not view.is_small_due(level, True)
    assert not view.is_small_due(0, True), "a larger one was shown"
    assert view.is_due(1, 1.0, False), "it does not rest"


def test_lost_picture_is_tried_again_later(clock: list[float]) -> None:
    view = DenoisedView()
    view.begin(PICTURE, PICTURE, PICTURE, 4.0)
    view.end(None)
    assert not view.is_due(4, 4.0, True)
    clock[0] += LOST_S
    assert view.is_due(4, 4.0, True)
    assert not view.has_picture
    assert view.failures == 1
    view.begin(PICTURE, PICTURE, PICTURE, 4.0)
    view.end(rgbe9995.pack(PICTURE))
    assert view.failures == 0, "only those in succession count"


def test_canvas_gives_means_of_colour_and_guides() -> None:
    """Colour is the mean of all samples, albedo and normal are of the guides, which are complete once every tile has all."""
    tiles = [Tile(0, 0, 8, 6), Tile(8, 0, 4, 6)]
    canvas = Canvas(Level(12, 6, 64, tiles), 24, has_guides=True)
    for index, tile in enumerate(tiles):
        for first, count in ((0, 1), (1, 7), (8, 8)):
            canvas.add(index, first, count, expected_sums(tile, first, count, 0))
        assert not canvas.has_all_guides
        canvas.add_guides(index, FIRST_GUIDES, expected_sums(tile, 0, FIRST_GUIDES, 0))
    assert canvas.has_all_guides
    whole = Tile(0, 0, 12, 6)
    color, albedo, normal = canvas.means()
    np.testing.assert_allclose(color, film.mean(expected_sums(whole, 0, 16, 0), 24), rtol=1e-5)
    guides = expected_sums(whole, 0, FIRST_GUIDES, 0)
    np.testing.assert_allclose(albedo, film.mean(guides, 24, film.ALBEDO), rtol=1e-5)
    np.testing.assert_allclose(normal, film.mean(guides, 24, film.NORMAL), rtol=1e-5)
