"""Tests of batches and frames: films are exact for any division, bad samples are reported, settings are applied."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

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
    SAMPLE_MAX,
    SAMPLES,
    SAMPLES_HALF,
    digest,
    in_half,
    mean,
    noise,
)
from renderer.jit import entry
from renderer.kernel.accumulate import MAX_BAD
from renderer.kernel.fixed_point import in_half as kernel_half
from renderer.render import RenderStats, render_batch, render_frame
from renderer.scene.compiled import seal
from renderer.scene.description import Material, Sphere
from renderer.settings import Tile, tiles_of
from tests.grids import grid
from tests.renderer.builders import box, emitter, gray, scene, settings, square
from tests.renderer.judge import ALPHA, assert_mean, limit, sidak

SPP = 6
MANY = settings((0, 2, 6), (0, 0.5, 0), 40, size=40, max_depth=5)


def varied():
    """Returns a scene with every kind of material, both kinds of light, and a sky."""
    materials = [
        Material(base_color=(0.7, 0.6, 0.5)),
        Material(kind="glass", base_color=gray(1.0)),
        Material(kind="metallic_roughness", base_color=(0.9, 0.5, 0.2), metallic=0.5, roughness=0.4),
        Material(kind="mirror", base_color=gray(0.9)),
        emitter(9.0),
    ]
    meshes = (
        square((0, 0, 0), (9, 0, 0), (0, 0, -9), 0),
        box(3, 0.4, (0, 0.4, -1)),
        square((0, 3, 0), (1, 0, 0), (0, 0, 1), 4),
    )
    spheres = (Sphere((1.2, 0.6, 0), 0.6, 1), Sphere((-1.2, 0.6, 0), 0.6, 2), Sphere((0, 1.5, 0), 0.1, 4))
    return scene(materials, meshes, spheres, environment=0.3)


@pytest.fixture(scope="module")
def whole():
    """Returns a scene, and the film sums of its frame rendered in one batch."""
    made = varied()
    return made, render_batch(made, MANY, Tile(0, 0, 40, 40), 0, SPP).sums


def add(sums, made, asked, tile, first, count):
    sums[:, tile.y : tile.y + tile.h, tile.x : tile.x + tile.w] += render_batch(made, asked, tile, first, count).sums


@pytest.mark.parametrize("size", [7, 16, 64])
def test_film_does_not_depend_on_tile_size(whole, size):
    made, expected = whole
    sums = np.zeros_like(expected)
    for tile in reversed(tiles_of(40, 40, size)):
        add(sums, made, MANY, tile, 0, SPP)
    assert digest(sums) == digest(expected)


@pytest.mark.parametrize("threads", [1, 2, 5, None])
def test_film_does_not_depend_on_threads(whole, threads):
    made, expected = whole
    stats = RenderStats()
    calls = []
    sums = render_frame(made, MANY, SPP, threads=threads, progress=lambda *done: calls.append(done), stats=stats)
    assert digest(sums) == digest(expected)
    assert stats.samples == SPP * 40 * 40
    assert stats.rays > stats.samples
    assert calls[-1] == (stats.samples, stats.samples)
    assert sorted(calls) == calls


@given(st.data())
@hypothesis_settings(max_examples=15, deadline=None)
def test_film_does_not_depend_on_batches(whole, data):
    """Batches of any tile sizes and sample ranges, in any order, add up to the same film."""
    made, expected = whole
    tiles = tiles_of(40, 40, data.draw(st.integers(9, 40)))
    cuts = sorted(data.draw(st.sets(st.integers(1, SPP - 1))) | {0, SPP})
    batches = [(t, a, b - a) for t in tiles for a, b in pairwise(cuts)]
    sums = np.zeros_like(expected)
    for batch in data.draw(st.permutations(batches)):
        add(sums, made, MANY, *batch)
    assert digest(sums) == digest(expected)


def test_frame_does_not_depend_on_the_previous_frame(whole):
    made, expected = whole
    first = render_frame(made, MANY, 2)
    rest = sum(render_batch(made, MANY, Tile(0, 0, 40, 40), n, 1).sums for n in range(2, SPP))
    assert digest(first + rest) == digest(expected)
    assert digest(render_frame(varied(), MANY, SPP)) == digest(expected)


def test_half_buffer_contains_its_sample_numbers(whole):
    made, expected = whole
    numbers = [n for n in range(SPP) if in_half(n)]
    half = sum(render_batch(made, MANY, Tile(0, 0, 40, 40), n, 1).sums for n in numbers)
    np.testing.assert_array_equal(expected[COLOR_HALF], half[COLOR])
    assert (expected[SAMPLES_HALF] == len(numbers)).all()
    assert (expected[SAMPLES] == SPP).all()


def test_seeds_pixels_and_samples_are_independent(whole):
    made, expected = whole
    other = render_batch(
        made, settings((0, 2, 6), (0, 0.5, 0), 40, size=40, max_depth=5, seed=1), Tile(0, 0, 40, 40), 0, SPP
    ).sums
    hit = expected[DEPTH] > 0
    assert (other[COLOR] != expected[COLOR])[:, hit].mean() > 0.95
    later = render_batch(made, MANY, Tile(0, 0, 40, 40), SPP, SPP).sums
    assert (later[COLOR] != expected[COLOR])[:, hit].mean() > 0.95
    assert (np.diff(expected[COLOR], axis=2) != 0)[:, hit[:, 1:] & hit[:, :-1]].mean() > 0.95
    # Both are unbiased estimates of the same picture.
    difference = (other[COLOR] - expected[COLOR]).astype(float).sum()
    halves = [2 * s[COLOR_HALF] - s[COLOR] for s in (other, expected)]
    error = np.sqrt(sum((h.astype(float).sum(0) ** 2).sum() for h in halves))  # channels of a pixel are correlated
    assert abs(difference) < 3 * error


def wall_and_sky(radiance=1.0):
    """Returns a scene with a wall in the lower half of the picture and sky in the upper half."""
    return scene([Material(base_color=gray(0.5))], (square((0, -50, -1), (99, 0, 0), (0, 50, 0), 0),), environment=radiance)


LEVEL = settings((0, 0, 0), (0, 0, -1), 60, size=16, max_depth=1)


@pytest.mark.parametrize("poison", [np.nan, np.inf])
def test_bad_samples_are_omitted_counted_and_listed(poison):
    made = wall_and_sky()
    sky = np.full((1, 1, 3), 1.0, np.float32)
    sky[0, 0, 1] = poison
    stats = RenderStats()
    sums = render_frame(seal(made._replace(environment=sky)), LEVEL, 3, stats=stats)
    assert stats.bad_count == 16 * 8 * 3
    assert len(stats.bad) == MAX_BAD
    assert all(0 <= b.x < 16 and 0 <= b.y < 8 and 0 <= b.sample < 3 for b in stats.bad)
    assert len(set(stats.bad)) == MAX_BAD
    assert not sums[:, :8].any()  # bad samples add nothing to the film
    assert (sums[SAMPLES, 8:] == 3).all()
    assert np.isfinite(mean(sums, 24)).all()


def test_bad_samples_have_frame_coordinates():
    made = wall_and_sky()
    sky = np.full((1, 1, 3), np.nan, np.float32)
    batch = render_batch(seal(made._replace(environment=sky)), LEVEL, Tile(5, 7, 2, 2), 40, 2)
    assert batch.bad_count == 4
    assert sorted(batch.bad) == [(5, 7, 40), (5, 7, 41), (6, 7, 40), (6, 7, 41)]


def test_infinite_light_and_nan_material_keep_sums_valid():
    made = varied()
    for column, value in ((3, np.inf), (0, np.nan), (7, np.nan)):
        material = made.material.copy()
        material[4 if column == 3 else 2, column] = value
        stats = RenderStats()
        sums = render_frame(seal(made._replace(material=material)), MANY, 2, stats=stats)
        assert stats.bad_count > 0
        assert sums[SAMPLES].sum() == 2 * 40 * 40 - stats.bad_count
        assert np.abs(sums[COLOR]).max() <= 2 * SAMPLE_MAX * 2**24


def test_bright_samples_are_clamped():
    made = wall_and_sky(1e9)
    sums = render_frame(made, LEVEL, 5)
    assert (sums[COLOR, :8] == 5 * int(SAMPLE_MAX) * 2**24).all()
    assert (mean(sums, 24)[:8] == SAMPLE_MAX).all()


def test_first_hit_planes_of_a_known_plane():
    """A floor's normal and albedo are exact to the quantum, and its depth is between the values at a pixel's corners.

    The floor is one unit below the eye.
    """
    made = scene([Material(base_color=(0.25, 0.5, 0.75))], (square((0, -1, 0), (1000, 0, 0), (0, 0, -1000), 0),), environment=1.0)
    asked = settings((0, 0, 0), (0, -1, -1), 40, size=16, max_depth=2)
    sums = render_frame(made, asked, 4)
    assert (mean(sums, 24, ALBEDO) == np.float32((0.25, 0.5, 0.75))).all()
    assert (
        np.abs(mean(sums, 24, NORMAL) - (0, 1, 0)).max() <= 2.0**-23
    )  # one step of float32, since the shading normal is normalised
    edge = np.tan(np.radians(20)) * np.linspace(-1, 1, 17)
    x, y = np.meshgrid(edge, edge)
    forward, down = np.array([0, -1, -1]) / 2**0.5, np.array([0, -1, 1]) / 2**0.5
    ray = forward + x[..., None] * np.array([1, 0, 0]) + y[..., None] * down
    depth = np.linalg.norm(ray, axis=-1) / -ray[..., 1]
    corners = np.stack([depth[:-1, :-1], depth[1:, :-1], depth[:-1, 1:], depth[1:, 1:]])
    position = mean(sums, 24, POSITION)
    np.testing.assert_allclose(position[..., 1], -1, atol=1e-5)
    assert (np.abs(position[..., 0] / mean(sums, 24, DEPTH)) < 1).all()
    assert (np.diff(position[..., 0], axis=1) > 0).all()
    assert (np.diff(position[..., 2], axis=0) > 0).all()
    found = mean(sums, 24, DEPTH)
    assert (found <= corners.max(0) * (1 + 1e-5)).all()
    assert (found >= corners.min(0) * (1 - 1e-5)).all()


def test_first_hit_planes_are_zero_where_nothing_is_hit():
    sums = render_frame(wall_and_sky(), LEVEL, 2)
    assert not sums[ALBEDO, :8].any()
    assert not sums[NORMAL, :8].any()
    assert not sums[DEPTH, :8].any()
    assert not sums[POSITION, :8].any()
    assert not sums[[OBJECT, MATERIAL], :8].any()
    assert sums[DEPTH, 8:].all()


def test_settings_replace_and_scale_the_environment():
    made = wall_and_sky(0.5)

    def sky(**changes):
        asked = settings((0, 0, 0), (0, 0, -1), 60, size=16, max_depth=3, **changes)
        return mean(render_frame(made, asked, 32), 24)

    assert (sky()[:8] == 0.5).all()
    assert (sky(environment_strength=3.0)[:8] == 1.5).all()
    assert (sky(environment=(1.0, 2.0, 4.0))[:8] == (1, 2, 4)).all()
    assert (sky(environment=(1.0, 2.0, 4.0), environment_strength=0.5)[:8] == (0.5, 1, 2)).all()
    assert not sky(environment_strength=0.0).any()
    assert not sky(environment=(0.0, 0.0, 0.0)).any()
    lit = sky(environment=(1.0, 2.0, 4.0))[8:]  # Lambertian under a constant sky: albedo times radiance, without noise
    np.testing.assert_allclose(lit, np.broadcast_to((0.5, 1, 2), lit.shape), rtol=1e-6)


def test_settings_environment_lights_a_dark_scene():
    made = scene([Material(base_color=gray(0.5))], spheres=(Sphere((0, 0, 0), 1.0),))
    asked = settings((0, 0, 4), (0, 0, 0), 10, size=16, environment=(2.0, 2.0, 2.0))
    assert_mean(render_frame(made, asked, 64), 1.0)


def spread_and_estimate(sampler, spp, seeds=48):
    """Returns three values, relative to the mean: the spread over pictures, the film's noise estimate, and that estimate's error.

    The spread is the standard deviation of a pixel over pictures of different seeds; the error is a standard error.
    """
    made = varied()
    pictures, estimates = [], []
    for seed in range(seeds):
        asked = settings((0, 2, 6), (0, 0.5, 0), 40, size=20, max_depth=4, seed=seed, sampler=sampler)
        sums = render_frame(made, asked, spp, threads=2)
        pictures.append(mean(sums, 24).astype(float))
        estimates.append(noise(sums, 24))
    spread = np.sqrt(np.var(pictures, axis=0, ddof=1).mean()) / np.mean(pictures)
    return spread, np.sqrt(np.mean(np.square(estimates))), np.std(estimates, ddof=1) / np.sqrt(seeds)


@pytest.mark.parametrize("spp", [8, 13])
def test_noise_estimate_matches_the_spread_over_seeds(spp):
    spread, found, error = spread_and_estimate("independent", spp)
    assert error < 0.05 * spread
    assert abs(found - spread) < 3 * 2 * error  # both values are estimates of similar precision


@grid("spp", [2, 8, 13, 64], ordinary=(13,))
def test_noise_estimate_of_sobol_samples(spp):
    spread, found, error = spread_and_estimate("sobol", spp)
    assert spread < found + 3 * 2 * error
    assert found < 1.7 * spread


@entry
def _kernel_halves(numbers, halves):
    for i in range(len(numbers)):
        halves[i] = kernel_half(numbers[i])


def test_kernel_halves_match_the_film():
    numbers = np.array([*range(5000), 2**19 - 1, 2**19, 3 * 2**18 - 1, 3 * 2**18, 2**20 - 1])
    halves = np.empty(len(numbers), bool)
    _kernel_halves(numbers, halves)
    assert halves.tolist() == [in_half(int(n)) for n in numbers]


def test_id_planes_add_up_in_any_order(whole):
    """The object and material planes hold the numbers of sample 0; a batch without sample 0 adds nothing to them."""
    made, expected = whole
    assert {0, 1, 2, 3, 4} <= set(np.unique(expected[MATERIAL])) <= {0, 1, 2, 3, 4, 5}  # only three pixels may show material 5
    assert ((expected[OBJECT] == 0) == (expected[MATERIAL] == 0)).all()
    later = render_batch(made, MANY, Tile(0, 0, 40, 40), 1, 3).sums
    assert not later[OBJECT].any()
    assert not later[MATERIAL].any()
    first = render_batch(made, MANY, Tile(0, 0, 40, 40), 0, 1).sums
    np.testing.assert_array_equal(first[OBJECT], expected[OBJECT])
    hit = first[OBJECT] > 0
    assert (hit == (first[DEPTH] > 0)).all()


@pytest.mark.parametrize("sampler", ["sobol", "independent"])
@pytest.mark.parametrize("name", ["blackman-harris", "tent", "box"])
def test_filters_leave_no_seams_at_tile_borders(whole, name, sampler):
    """A wide filter moves a sample into another tile, but its value is added to its own pixel."""
    made, _ = whole
    asked = settings((0, 2, 6), (0, 0.5, 0), 40, size=40, max_depth=3, filter=name, sampler=sampler)
    digests = set()
    for size in (16, 64):
        sums = np.zeros((CHANNELS, 40, 40), np.int64)
        for tile in tiles_of(40, 40, size):
            add(sums, made, asked, tile, 0, 2)
        digests.add(digest(sums))
    assert len(digests) == 1


@pytest.mark.long
@pytest.mark.parametrize(("spp", "gain"), [(4, 1.05), (16, 1.2), (64, 1.4)])
def test_sobol_sampler_reduces_noise(spp, gain):
    spreads = {sampler: spread_and_estimate(sampler, spp, 16)[0] for sampler in ("sobol", "independent")}
    assert spreads["independent"] > gain * spreads["sobol"], spreads


def test_tile_borders_leave_no_trace():
    """In a furnace all pixels estimate one value: those at tile borders are as precise and as independent as others."""
    wall = Material(base_color=gray(0.5), emission=gray(0.5), double_sided=True)
    asked = settings((0.1, 0.2, 0.3), (1, 0, 0), 70, size=96, max_depth=4)
    values = mean(render_frame(scene([wall], (box(0),)), asked, 16), 24)[..., 0].astype(float)
    residual = values - values.mean()
    border = np.zeros(96, bool)
    border[[31, 32, 63, 64]] = True
    for along in (residual, residual.T):
        beside, within = along[:, border], along[:, ~border]
        assert scipy.stats.ttest_ind(beside.ravel(), within.ravel(), equal_var=False).pvalue > sidak(ALPHA, 4)
        across = (along[:, :-1] * along[:, 1:])[:, [31, 63]].ravel()  # the products across a border
        assert abs(across.mean()) < limit(4) * across.std() / np.sqrt(across.size)


def test_stopped_frame_equals_a_frame_of_fewer_samples(whole):
    made, _ = whole
    seen = []

    def stop(sums):
        seen.append(int(sums[SAMPLES].min()))
        return seen[-1] >= 4

    sums = render_frame(made, MANY, 64, stop=stop)
    assert seen == [1, 2, 4]
    assert digest(sums) == digest(render_frame(made, MANY, 4))
    sums = render_frame(made, MANY, 64, time_limit=0.0)
    assert (sums[SAMPLES] == 1).all()
    assert sums.shape == (CHANNELS, 40, 40)
