"""Tests that a film's bits do not depend on how paths are grouped in the path pool, nor on tiles and batches."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest

from renderer.arrays import rows
from renderer.film import CHANNELS, COLOR, Sums
from renderer.kernel.backends.cpu.rows import ROWS
from renderer.render import render_batch, replay
from renderer.scene.compiled import seal
from renderer.settings import Tile
from tests.grids import grid
from tests.renderer.kernel.backends.features import SIZE, made

SCENES = ("metal and plastic", "half clear glass", "a coat on bumps", "fog", "skin")
FIRST, COUNT = 5, 65  # sample numbers; COUNT is no multiple of the samples per batch
WHOLE, PART = Tile(0, 0, SIZE, SIZE), Tile(9, 14, 9, 7)


@cache
def at_once(name: str, tile: Tile) -> Sums:
    """Returns the film sums of the tile rendered as one batch."""
    return render_batch(*made(name), tile, FIRST, COUNT).sums


@grid("name", SCENES, ordinary=("a coat on bumps",))
@pytest.mark.parametrize(("width", "height"), [(1, 1), (7, 5)])
def test_film_does_not_depend_on_tile_shape(name: str, width: int, height: int) -> None:
    scene, settings = made(name)
    sums = np.zeros_like(at_once(name, WHOLE))
    for y in range(0, SIZE, height):
        for x in range(0, SIZE, width):
            tile = Tile(x, y, min(width, SIZE - x), min(height, SIZE - y))
            sums[:, y : y + tile.h, x : x + tile.w] += render_batch(scene, settings, tile, FIRST, COUNT).sums
    np.testing.assert_array_equal(sums, at_once(name, WHOLE))


@grid("name", SCENES, ordinary=("a coat on bumps",))
@pytest.mark.parametrize("most", [1, 3, 64])
def test_film_does_not_depend_on_samples_per_batch(name: str, most: int) -> None:
    scene, settings = made(name)
    sums = np.zeros_like(at_once(name, PART))
    for first in range(FIRST, FIRST + COUNT, most):
        count = min(most, FIRST + COUNT - first)
        sums += render_batch(scene, settings, PART, first, count).sums
    np.testing.assert_array_equal(sums, at_once(name, PART))


def test_batches_smaller_than_the_pool() -> None:
    scene, settings = made(SCENES[0])
    x, y, few = 11, 17, 3
    assert few < ROWS
    alone = render_batch(scene, settings, Tile(x, y, 1, 1), FIRST, few).sums
    one_by_one = sum(render_batch(scene, settings, Tile(x, y, 1, 1), FIRST + k, 1).sums for k in range(few))
    np.testing.assert_array_equal(alone, one_by_one)
    for tile, count in ((Tile(x, y, 0, 0), 4), (Tile(x, y, 3, 0), 4), (Tile(x, y, 2, 3), 0)):
        nothing = render_batch(scene, settings, tile, FIRST, count)
        assert nothing.sums.shape == (CHANNELS, tile.h, tile.w)
        assert not nothing.sums.any()
        assert nothing.bad_count == 0


def test_reused_scratch_memory_leaves_no_trace() -> None:
    """A batch is unaffected by the thread's reused scratch memory, here after a scene whose light is NaN."""
    scene, settings = made(SCENES[0])
    other, others = made(SCENES[1])
    material = other.material.copy()
    material[2, rows.EMISSION] = np.nan  # the lamp's material
    poisoned = seal(other._replace(material=material))
    before = render_batch(poisoned, others, Tile(0, 0, SIZE, SIZE), 0, 3)
    assert 0 < before.bad_count < 3 * SIZE * SIZE
    tile = Tile(3, 4, 11, 9)
    here = render_batch(scene, settings, tile, FIRST, 7)
    with ThreadPoolExecutor(1) as fresh:
        there = fresh.submit(render_batch, scene, settings, tile, FIRST, 7).result()
    np.testing.assert_array_equal(here.sums, there.sums)
    assert here.bad_count == there.bad_count == 0


@grid("name", SCENES, ordinary=("a coat on bumps",))
def test_replay_of_one_sample_equals_the_film(name: str) -> None:
    scene, settings = made(name)
    for sample in (63, 1000):
        film = render_batch(scene, settings, Tile(0, 0, SIZE, SIZE), sample, 1).sums[COLOR]
        for x, y in ((1, 30), (10, 18), (16, 20), (23, 21), (31, 3)):
            found = replay(scene, settings, x, y, sample).value
            assert found is not None
            assert [int(v * 2**settings.film_exponent) for v in found] == film[:, y, x].tolist()
