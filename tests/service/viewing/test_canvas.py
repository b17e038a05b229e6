"""Tests of the sums of a live view: its noise, and which tiles are due to be shown."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from renderer import film
from renderer.settings import tiles_of
from service.viewing.canvas import GROWTH, Canvas
from service.viewing.passes import Level, Passes
from tests.service.peer_worker import expected_sums


def add_samples(canvas: Canvas, samples: int) -> list[int]:
    """Adds samples to a canvas until it has `samples` per pixel; returns the counts at which the first tile is due to be shown.

    Asserts that the mean of the last tile is then as expected.
    """
    level, shown = canvas.level, []
    for pieces in iter(Passes([Level(level.width, level.height, samples, level.tiles)], 1e-5).next_message, []):
        for piece in pieces:
            rect = level.tiles[piece.tile]
            canvas.add(piece.tile, piece.first, piece.count, expected_sums(rect, piece.first, piece.count, 0))
            for tile in list(canvas.changed):
                shown += [canvas.take_tile(tile)[1]] * (tile == 0)
    mean, has, *_ = canvas.take_tile(piece.tile)
    assert has == samples
    np.testing.assert_array_equal(mean, np.moveaxis(film.mean(expected_sums(rect, 0, samples, 0), 24), -1, 0))
    return shown


def canvas_of(samples: int, noise: float | None = None) -> Canvas:
    return Canvas(Level(64, 48, samples, tiles_of(64, 48, 32)), 24, noise)


def test_tile_of_transparent_view_has_alpha() -> None:
    coverage = np.random.default_rng(1).uniform(0, 1, (32, 32))
    sums = np.zeros((film.plane_count(0, is_transparent=True), 32, 32), np.int64)
    sums[film.SAMPLES] = 4
    sums[film.alpha_plane(0)] = 4 * coverage * 2**24
    canvas = Canvas(Level(32, 32, 8, tiles_of(32, 32, 32)), 24, is_transparent=True)
    for first in (0, 4):
        canvas.add(0, first, 4, sums)
    np.testing.assert_array_equal(canvas.take_tile(0)[3], np.rint(255 * coverage))
    assert canvas_of(8).take_tile(0)[3] is None


@pytest.mark.parametrize("samples", [8, 64, 100])
def test_canvas_noise_equals_job_noise(samples: int) -> None:
    canvas = canvas_of(samples)
    assert canvas.noise is None
    add_samples(canvas, samples)
    tiles = [(film.noise(expected_sums(tile, 0, samples, 0), 24), tile.w * tile.h) for tile in canvas.level.tiles]
    assert canvas.noise == pytest.approx(math.sqrt(sum(noise**2 * area for noise, area in tiles) / (64 * 48)), rel=1e-12)
    assert canvas.is_complete
    assert canvas.mean_samples == samples


def test_tile_is_complete_at_target_noise() -> None:
    canvas = canvas_of(256, 0.058)  # evenly distributed samples: 0.577 / sqrt(n)
    add_samples(canvas, 64)
    assert not canvas.is_complete
    assert canvas.noise == pytest.approx(0.577 / 8, rel=0.05)
    canvas = canvas_of(256, 0.075)
    add_samples(canvas, 32)
    assert not any(map(canvas.tile_is_complete, range(4)))
    canvas = canvas_of(256, 0.075)
    add_samples(canvas, 64)
    assert canvas.is_complete


def test_tile_is_due_after_samples_grow_by_half() -> None:
    shown = add_samples(canvas_of(100), 100)
    assert shown[:3] == [1, 2, 3]
    assert shown[-1] == 100
    assert all(after >= GROWTH * before for before, after in itertools.pairwise(shown[:-1]))
    assert len(shown) <= 2 + math.log(100, GROWTH)
