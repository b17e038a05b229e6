"""Tests that each terminated path is added once to the sums of its pixel in the film."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from renderer.film import (
    ALBEDO,
    CHANNELS,
    COLOR,
    COLOR_HALF,
    DEPTH,
    MATERIAL,
    NORMAL,
    OBJECT,
    POSITION,
    SAMPLES,
    SAMPLES_HALF,
    alpha_plane,
    plane_count,
)
from renderer.film import in_half as in_half_of_film
from renderer.jit import entry
from renderer.kernel.accumulate import MAX_BAD, Batch
from renderer.kernel.backends.cpu.accumulate_film import SUMS, accumulate_film, flush_film
from renderer.kernel.backends.cpu.lists import DONE, LIST_SIZE, LISTS, append, clear
from renderer.kernel.backends.cpu.rows import PATHS, ROW, ROWS, Sample, column
from renderer.kernel.steps.record_first_hit import FirstHit
from renderer.kernel.steps.state import PathState
from renderer.luminance import REC_709

WIDTH, HEIGHT = 3, 2
NO_IDS = np.zeros((0, 2), np.uint32)
NUMBER, PLACE, BRANCHES = (int(column(Sample, field)) for field in ("number", "place", "branches"))
RADIANCE, FIRST = int(column(PathState, "radiance")), int(column(FirstHit, "albedo"))


@entry
def _keep(pool, lists, done, film, scale, batch, bad, sums, ids):
    clear(lists, DONE)
    for path in done:
        append(lists, DONE, path)
    bad_count = accumulate_film(pool, lists, film, scale, sums.shape[2], batch, bad, 0, None, ids)
    flush_film(film, sums, scale, len(sums) > CHANNELS)
    return bad_count


def film_after(
    rows: npt.NDArray[np.float32], exponent: int = 24, planes: int = CHANNELS
) -> tuple[npt.NDArray[np.int64], list[tuple[int, ...]], int]:
    """Returns (film planes, listed bad samples, number of bad samples) after adding the path rows (N, ROW) to a film."""
    pool = np.zeros((ROWS, int(ROW)), np.float32)
    pool[: len(rows)] = rows
    sums = np.zeros((planes, HEIGHT, WIDTH), np.int64)
    bad = np.zeros((MAX_BAD, 3), np.int64)
    film = np.zeros(WIDTH * HEIGHT * SUMS, np.int64)
    lists = np.zeros(LISTS * LIST_SIZE, np.uint32)
    batch = Batch(100, 200, 0, 9)
    bad_count = _keep(pool.ravel(), lists, np.arange(len(rows)), film, np.float32(2.0**exponent), batch, bad, sums, NO_IDS)
    return sums, [tuple(map(int, row)) for row in bad[: min(bad_count, MAX_BAD)]], int(bad_count)


def paths(count: int, samples: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
    """Returns `count` rows of the path pool with random contents, each at a random pixel."""
    random = np.random.default_rng(5)
    rows = random.normal(0, 10, (count, int(ROW))).astype(np.float32)
    facts = rows.view(np.int32)
    facts[:, NUMBER] = samples
    facts[:, PLACE] = random.integers(0, WIDTH * HEIGHT, count)
    facts[:, FIRST + 7] = random.integers(0, 1 << 22, count)
    facts[:, FIRST + 11] = random.integers(0, 1 << 22, count)
    rows[:, FIRST + 12 : FIRST + 16] = 0
    rows[:, BRANCHES] = 1
    return rows


@pytest.mark.parametrize("exponent", [0, 7, 24])
def test_every_sample_is_in_its_pixels_sums(exponent: int) -> None:
    samples = np.arange(100) % 9
    rows = paths(100, samples)
    expected = np.zeros((CHANNELS, HEIGHT, WIDTH), np.int64)
    facts = rows.view(np.int32)
    for row, ids, sample in zip(rows, facts, samples, strict=True):
        y, x = divmod(int(ids[PLACE]), WIDTH)
        color, first = row[RADIANCE : RADIANCE + 3], FIRST
        planes = [(COLOR, color), (ALBEDO, row[first : first + 3]), (NORMAL, row[first + 4 : first + 7])]
        planes += [(POSITION, row[first + 8 : first + 11]), (slice(DEPTH, DEPTH + 1), row[first + 3 : first + 4])]
        planes += [(COLOR_HALF, color)] if in_half_of_film(int(sample)) else []
        for plane, value in planes:
            expected[plane, y, x] += np.rint(value.astype(np.float64) * 2.0**exponent).astype(np.int64)
        expected[SAMPLES, y, x] += 1
        expected[SAMPLES_HALF, y, x] += in_half_of_film(int(sample))
        if sample == 0:
            expected[OBJECT, y, x] += ids[first + 7]
            expected[MATERIAL, y, x] += ids[first + 11]
    sums, bad, bad_count = film_after(rows, exponent)
    np.testing.assert_array_equal(sums, expected)
    assert (bad, bad_count) == ([], 0)


@pytest.mark.parametrize("exponent", [7, 24])
def test_alpha_is_the_count_of_samples_less_what_is_uncovered(exponent: int) -> None:
    """Also if samples are omitted, and for a throughput above 1, as absorbing media may have in one channel."""
    rows = paths(100, np.arange(100) % 9)
    uncovered = np.random.default_rng(7).choice([0, 0.25, 1 / 3, 1, 1.5], 100).astype(np.float32)
    rows[:, FIRST + 12] = uncovered
    rows[40:50, RADIANCE] = np.nan
    rows[50:60, FIRST + 12] = np.nan
    sums = film_after(rows, exponent, plane_count(0, True))[0]
    expected = np.zeros((HEIGHT, WIDTH), np.int64)
    one = 1 << exponent
    for k in [*range(40), *range(60, 100)]:
        y, x = divmod(int(rows.view(np.int32)[k, PLACE]), WIDTH)
        expected[y, x] += one - int(np.rint(np.float64(uncovered[k]) * one))
    np.testing.assert_array_equal(sums[alpha_plane(0)], expected)
    assert sums[SAMPLES].sum() == 80


def test_a_sample_on_a_shadow_catcher_is_black_and_has_its_light_in_planes_of_its_own() -> None:
    rows = paths(30, np.arange(30) % 9)
    on_catcher = np.arange(30) % 3 == 0
    rows[on_catcher, FIRST + 12] = rows[on_catcher, FIRST + 13] = 0.5
    rows[on_catcher, FIRST + 14] = 7.0
    rows[on_catcher, FIRST + 15] = -1.0
    rows[:, RADIANCE : RADIANCE + 3] = np.abs(rows[:, RADIANCE : RADIANCE + 3])
    sums = film_after(rows, 10, plane_count(0, True))[0]
    others = film_after(rows[~on_catcher], 10, plane_count(0, True))[0]
    np.testing.assert_array_equal(sums[COLOR], others[COLOR])
    assert (sums[SAMPLES].sum(), others[SAMPLES].sum()) == (30, 20)
    covered, caught, unshadowed, shadowed = sums[alpha_plane(0) :].sum(axis=(1, 2)) / 1024
    assert (covered, caught, unshadowed) == (25, 5, 70)
    light = rows[on_catcher, RADIANCE : RADIANCE + 3] @ REC_709
    assert abs(shadowed - light.sum()) < 10 / 1024


def test_a_sample_on_a_catcher_that_has_met_an_object_has_its_colour() -> None:
    """The light of the catcher itself was set apart before."""
    rows = paths(30, np.arange(30) % 9)
    plain = film_after(rows, 10, plane_count(0, True))[0]
    rows[:, FIRST + 12] = rows[:, FIRST + 13] = 0.5
    rows[:, FIRST + 14], rows[:, FIRST + 15] = 7.0, 0.25
    sums = film_after(rows, 10, plane_count(0, True))[0]
    np.testing.assert_array_equal(sums[COLOR], plain[COLOR])
    assert (sums[alpha_plane(0) :].sum(axis=(1, 2)) == 1024 * np.array([15, 15, 210, 7.5])).all()


@pytest.mark.parametrize("column", [group + k for group in (RADIANCE, FIRST, FIRST + 4, FIRST + 8) for k in range(3)])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_nan_samples_are_omitted_and_listed(column: int, value: float) -> None:
    rows = paths(20, np.arange(20))
    spoilt = rows.copy()
    spoilt[7, column] = value
    sums, bad, bad_count = film_after(spoilt)
    np.testing.assert_array_equal(sums, film_after(np.delete(rows, 7, axis=0))[0])
    y, x = divmod(int(rows.view(np.int32)[7, PLACE]), WIDTH)
    assert (bad, bad_count) == ([(100 + x, 200 + y, 7)], 1)


def test_all_bad_samples_are_counted_beyond_the_list() -> None:
    rows = paths(MAX_BAD + 9, np.arange(MAX_BAD + 9))
    rows[:, RADIANCE] = np.nan
    sums, bad, bad_count = film_after(rows)
    assert not sums.any()
    assert bad_count == MAX_BAD + 9
    assert [sample for _, _, sample in bad] == list(range(MAX_BAD))


def test_split_path_is_added_as_one_sample() -> None:
    """A split path is added as one sample, whichever branch ends first; its row of the pool is freed after the last branch."""
    rows = paths(4, np.arange(4))
    rows[:, BRANCHES] = (1, 2, 2, 2)
    pool = np.zeros((ROWS, int(ROW)), np.float32)
    pool[:4] = rows
    seconds = np.random.default_rng(6).normal(0, 10, (4, 3)).astype(np.float32)
    seconds[0] = 0
    pool[PATHS : PATHS + 4, RADIANCE : RADIANCE + 3] = seconds
    rest = (
        np.zeros(WIDTH * HEIGHT * SUMS, np.int64),
        np.float32(2.0**24),
        Batch(100, 200, 0, 9),
        np.zeros((MAX_BAD, 3), np.int64),
        np.zeros((CHANNELS, HEIGHT, WIDTH), np.int64),
        np.zeros((0, 2), np.uint32),
    )
    lists = np.zeros(LISTS * LIST_SIZE, np.uint32)
    free = []
    for done in ([0, PATHS + 1, 2, PATHS + 2], [1, PATHS + 3], [3]):
        _keep(pool.ravel(), lists, np.array(done), *rest)
        of_done = lists.reshape(LISTS, LIST_SIZE)[int(DONE)]
        free.append(of_done[1 : 1 + of_done[0]].tolist())
    assert free == [[0, 2], [1], [3]]
    rows[:, RADIANCE : RADIANCE + 3] += seconds
    rows[:, BRANCHES] = 1
    np.testing.assert_array_equal(rest[-2], film_after(rows)[0])
