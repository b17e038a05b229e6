"""Tests of light through casters: closed forms, brute force, the split against BSDF sampling, and the limit on trials.

Those that render are `long`, since such light has a kernel of its own. The others and test_differentials.py need none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import renderer.render as rendering
from renderer.arrays.scene import CompiledScene
from renderer.bvh.traverse import new_stack
from renderer.film import COLOR, SAMPLES, Sums, digest
from renderer.guiding.caustic_photons import brightness_of, greatest_irradiance, seeds_of, with_long_chains
from renderer.kernel.manifold.brightness import BUCKETS, LEVELS, REFINEMENT
from renderer.kernel.manifold.photons import (
    ALL,
    CASTER,
    FLUX,
    INTERFACE,
    KIND,
    LONG_COLUMNS,
    PHOTON_COLUMNS,
    PLACE,
    REFLECTS,
    follow_caustic_photons,
)
from renderer.kernel.manifold.walk import LONG
from renderer.render import render_frame
from renderer.scene.caustics import caustic_tables, with_caustics
from renderer.scene.description import Light, Material, Mesh, Sphere
from renderer.settings import RenderSettings, Tile
from tests.renderer.builders import box, emitter, gray, icosphere, scene, settings, square

GLASS = Material(kind="glass", base_color=gray(1.0), ior=1.33)
MATT = Material(base_color=gray(0.5))
MIRROR = Material(kind="mirror", base_color=gray(0.8))
POINT = Light("point", intensity=gray(10.0), position=(0.0, 2.0, 0.0))
REFLECTANCE = (0.33 / 2.33) ** 2
FLOOR = square((0, -1, 0), (3, 0, 0), (0, 0, -3), 0)
WATER = square((0, 0, 0), (0, 0, 2), (2, 0, 0), 1)


def pixels(compiled: CompiledScene, asked: RenderSettings, spp: int) -> np.ndarray:
    sums: Sums = render_frame(compiled, asked, spp, threads=2)
    return sums[COLOR].mean(axis=0) / sums[SAMPLES] / 2.0**asked.film_exponent


def floor_radiance(compiled: CompiledScene, **more: object) -> np.ndarray:
    """Returns estimates (16,) of the radiance of the floor below the lamp, seen from below the water."""
    asked = settings((0.8, -0.5, 0.0), (0.0, -1.0, 0.0), fov=0.1, size=4, max_depth=3, **more)
    return pixels(compiled, asked, 128).reshape(-1)


def assert_mean(found: np.ndarray, expected: float) -> None:
    error = found.std(ddof=1) / np.sqrt(len(found))
    assert error < 0.05 * expected
    assert abs(found.mean() - expected) < 4.5 * error + 1e-3 * expected


PANE = replace(box(1), positions=(box(1, 0.5).positions * (4, 1, 4) + (0, 0.5, 0)).astype(np.float32))
DARK = replace(GLASS, attenuation_color=gray(0.5), attenuation_distance=1.0)
SUN = Light("directional", intensity=gray(3.0), direction=(0.0, -1.0, 0.0))
UNDER_WATER = 0.5 / np.pi * 10 * (1 - REFLECTANCE) / (2 + 1 / 1.33) ** 2


@pytest.mark.long
@pytest.mark.parametrize(
    ("made", "expected"),
    [
        (lambda: scene([MATT, GLASS], (FLOOR, WATER), lights=(POINT,)), UNDER_WATER),
        (lambda: scene([MATT, GLASS], (FLOOR, WATER), lights=(SUN,)), 0.5 / np.pi * 3 * (1 - REFLECTANCE)),
        (lambda: scene([MATT, DARK], (FLOOR, WATER), lights=(POINT,)), 0.5 * UNDER_WATER),
        (lambda: scene([MATT, GLASS], (FLOOR, PANE), lights=(POINT,)), (1 - REFLECTANCE) * UNDER_WATER),
    ],
    ids=["water", "sun", "absorption", "pane"],
)
def test_light_through_flat_interfaces_matches_closed_form(made: Callable[[], CompiledScene], expected: float) -> None:
    compiled = made()
    assert floor_radiance(compiled).max() == 0  # no path hits such a light
    assert_mean(floor_radiance(compiled, caustics="on"), expected)


@pytest.mark.long
def test_light_reflected_within_a_pane_matches_closed_form() -> None:
    """Light is reflected twice or four times within a pane of index 3. A nearly black floor sends none back to it.

    The pane is so wide that what its sides reflect does not matter.
    """
    reflectance, thickness = 0.25, 1.0
    pane = replace(PANE, positions=(PANE.positions * (20, 1, 20)).astype(np.float32))
    lamp = Light("point", intensity=gray(2500.0), position=(0.0, 2.0, 0.0))
    compiled = scene([Material(base_color=gray(0.002)), replace(GLASS, ior=3.0)], (FLOOR, pane), lights=(lamp,))
    distances = [2 + thickness * (1 + more) / 3.0 for more in (0, 2, 4)]
    parts = [reflectance ** (2 * k) / distance**2 for k, distance in enumerate(distances)]
    expected = 0.002 / np.pi * 2500 * (1 - reflectance) ** 2 * sum(parts)
    asked = settings((0.8, -0.5, 0.0), (0.0, -1.0, 0.0), fov=0.1, size=4, max_depth=12, caustics="on")
    found = pixels(compiled, asked, 512).reshape(-1)
    assert_mean(found, expected)
    error = found.std(ddof=1) / np.sqrt(found.size)
    assert error < expected * parts[1] / sum(parts) / 6  # so that a test without these parts would fail


@pytest.mark.long
def test_mirror_caustic_matches_the_image_of_the_lamp() -> None:
    mirror = square((1, 0, 0), (0, 2, 0), (0, 0, 2), 1)
    compiled = scene([MATT, MIRROR], (FLOOR, mirror), lights=(POINT,))
    direct = 0.5 / np.pi * 10 / 9
    expected = 0.5 / np.pi * 10 * 0.8 * 3 / (3.0**2 + 2.0**2) ** 1.5  # of the image at (2, 2, 0)
    assert_mean(floor_radiance(compiled, caustics="on"), direct + expected)


def hall(*more: Mesh, spheres: tuple[Sphere, ...], lights: tuple[Light, ...] = ()) -> CompiledScene:
    """Returns a matt floor and a wall with casters and lamps that are small, but large enough for brute force."""
    wall = square((0, 0, -2), (3, 0, 0), (0, 3, 0), 0)
    lamp = Sphere((1.4, 3.2, 0.3), 0.3, 3)
    return scene([MATT, GLASS, MIRROR, emitter(60.0)], (FLOOR, wall, *more), (*spheres, lamp), lights=lights)


def rippled() -> Mesh:
    """Returns a sheet of water with waves, with normals at its vertices."""
    x, z = np.meshgrid(np.linspace(-1.5, 1.5, 13), np.linspace(-1.5, 1.5, 13), indexing="ij")
    y = 0.03 * np.sin(3 * x + z)
    slope = np.stack([-0.09 * np.cos(3 * x + z), np.ones_like(x), -0.03 * np.cos(3 * x + z)], -1).reshape(-1, 3)
    k = np.arange(169).reshape(13, 13)
    a, b, c, d = (each.reshape(-1) for each in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    faces = np.concatenate([np.stack([a, d, c], 1), np.stack([a, c, b], 1)]).astype(np.int32)
    normals = (slope / np.linalg.norm(slope, axis=1, keepdims=True)).astype(np.float32)
    return Mesh("water", np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32), faces, normals, material=1)


def smooth_ball() -> Mesh:
    ball = icosphere(3, 1, 0.6, (0, 0, 0))
    unit = ball.positions / np.linalg.norm(ball.positions, axis=1, keepdims=True)
    return replace(ball, normals=unit.astype(np.float32))


def hollow_ball() -> Mesh:
    outer = smooth_ball()
    unit, faces = outer.normals, outer.triangles
    assert unit is not None
    positions = np.concatenate([0.6 * unit, 0.5 * unit]).astype(np.float32)
    inner = faces[:, ::-1] + len(unit)
    return replace(outer, positions=positions, normals=np.concatenate([unit, -unit]), triangles=np.concatenate([faces, inner]))


HALLS = {
    "sphere": lambda: hall(spheres=(Sphere((-0.3, -0.3, 0), 0.6, 1),)),
    "mesh": lambda: hall(smooth_ball(), spheres=()),
    "mirror": lambda: hall(spheres=(Sphere((-0.3, -0.3, 0), 0.6, 2),)),
    "two": lambda: hall(smooth_ball(), spheres=(Sphere((-1.4, -0.5, 0.3), 0.4, 2), Sphere((1.2, -0.5, 0.5), 0.4, 1))),
    "water": lambda: hall(rippled(), spheres=()),
    "row": lambda: hall(spheres=(Sphere((-0.7, -0.5, 0), 0.45, 1), Sphere((0.1, 0.9, 0.1), 0.35, 1))),
    "hollow": lambda: hall(hollow_ball(), spheres=()),
    "facets": lambda: hall(box(1, 0.5, (0, -0.2, 0)), spheres=()),
    "sun": lambda: hall(
        spheres=(Sphere((-0.3, -0.3, 0), 0.6, 1),),
        lights=(Light("directional", intensity=gray(2.0), direction=(-0.4, -1.0, -0.2), angle=5.0, seen="always"),),
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("name", HALLS)
def test_caustic_mean_equals_brute_force(name: str) -> None:
    """Both estimates agree within 0.5 % of the mean and five standard errors, in each of 16 parts of the picture.

    The margin is needed since light that bounces once more after a caustic is seldom found: its error is underestimated.
    """
    compiled = HALLS[name]()
    eye, target = (0.0, 1.8, 5.0), (0.0, -0.3, 0.0)
    seeds, size, parts = 8, 48, 4

    def blocks(spp: int, first: int, **more: object) -> np.ndarray:
        asked = settings(eye, target, fov=50.0, size=size, **more)
        found = [pixels(compiled, replace(asked, seed=first + k), spp) for k in range(seeds)]
        return np.array(found).reshape(seeds, parts, size // parts, parts, size // parts).mean(axis=(2, 4))

    found, expected = blocks(192, 10, caustics="on"), blocks(1536, 50)
    error = np.sqrt((found.var(axis=0, ddof=1) + expected.var(axis=0, ddof=1)) / seeds)
    off = np.abs(found.mean(axis=0) - expected.mean(axis=0))
    assert (off < 5 * error + 0.005 * expected.mean()).all()
    assert np.median(error) < 0.02 * expected.mean()


@pytest.mark.long
def test_frame_is_unchanged_without_casters_or_small_lamps() -> None:
    asked = settings((0.0, 1.8, 5.0), (0.0, -0.3, 0.0), fov=50.0, size=8)
    near = scene([MATT, GLASS, emitter(3.0)], (FLOOR,), (Sphere((0, 0, 0), 0.5, 1), Sphere((1.0, 0, 0), 0.3, 2)))
    bare = scene([MATT, emitter(3.0)], (FLOOR,), (Sphere((1.0, 2, 0), 0.3, 1),))
    for compiled in (near, bare):
        assert caustic_tables(compiled) is None
        both = [render_frame(compiled, replace(asked, caustics=each), 2, threads=1) for each in ("off", "on")]
        assert digest(both[0]) == digest(both[1])


@pytest.mark.long
def test_a_frame_does_not_depend_on_its_batches() -> None:
    compiled = HALLS["two"]()
    asked = settings((0.0, 1.8, 5.0), (0.0, -0.3, 0.0), fov=50.0, size=40, caustics="on")
    whole = render_frame(compiled, asked, 3, threads=1)
    parts = render_frame(compiled, asked, 3, threads=2, stop=lambda sums: False)
    assert digest(whole) == digest(parts)


@pytest.mark.long
def test_a_replay_has_the_light_of_the_film() -> None:
    compiled = HALLS["two"]()
    asked = settings((0.0, 1.8, 5.0), (0.0, -0.3, 0.0), fov=50.0, size=24, caustics="on")
    for sample in (0, 5):
        film = rendering.render_batch(compiled, asked, Tile(0, 0, 24, 24), sample, 1).sums
        for x, y in np.ndindex(24, 24):
            found = rendering.replay(compiled, asked, x, y, sample)
            assert found.value is not None
            assert [int(v * 2.0**asked.film_exponent) for v in found.value] == film[COLOR, y, x].tolist()
            total = np.sum([np.sum([v.emitted, v.direct, v.beside], axis=0) for v in found.vertices], axis=0)
            np.testing.assert_allclose(total, found.value, rtol=1e-5, atol=1e-5)


@pytest.mark.long
def test_trial_limit_reduces_improbable_solutions(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = HALLS["mesh"]()  # only a part of the walks towards a ball finds a way through it
    asked = settings((0.0, 1.8, 5.0), (0.0, -0.3, 0.0), fov=50.0, size=16, caustics="on")
    own = rendering.kernel_options
    totals = []
    for most in (1, 4, 4096):

        def limited(*given: Any, most: int = most) -> Any:
            return own(*given)._replace(caustic_trials=most)

        monkeypatch.setattr(rendering, "kernel_options", limited)
        totals.append(pixels(compiled, asked, 16).mean())
    assert totals[0] < totals[1] < totals[2]


@pytest.mark.long
def test_walks_beyond_the_edge_of_a_caustic_find_nothing() -> None:
    """Just beyond a caustic's edge there is no solution, and a walk that ends near one must not accept its last point.

    The picture crosses the edge. No other walk would find an accepted point again, so its reciprocal probability would be
    estimated in the thousands: without the limit on the last step a sample takes 386 rays, and pixels reach 67,000.
    """
    compiled = scene([MATT, GLASS], (FLOOR,), (Sphere((0, 0, 0), 0.5, 1),), lights=(POINT,))
    asked = settings((0.1036, -0.62, 0.0), (0.1036, -1.0, 0.0), fov=0.1, size=12, max_depth=3, caustics="on")
    stats = rendering.RenderStats()
    sums = render_frame(compiled, asked, 16, threads=1, stats=stats)
    columns = (sums[COLOR].mean(axis=0) / sums[SAMPLES] / 2.0**asked.film_exponent).mean(axis=0)
    assert columns[:5].max() < 1 < columns[7:].min()
    assert columns.max() < 1000
    assert stats.rays < 100 * stats.samples


@pytest.mark.long
def test_photons_bring_the_light_of_the_closed_form() -> None:
    compiled = with_caustics(scene([MATT, GLASS], (FLOOR, WATER), lights=(POINT,)))
    asked = settings((0.8, -0.5, 0.0), (0.0, -1.0, 0.0), size=4, caustics="on")
    prepared = rendering._prepared(compiled, asked)._replace(caustics=compiled.caustics)
    count = 1 << 19
    photons = np.zeros((count, PHOTON_COLUMNS), np.float32)
    photons = photons[: follow_caustic_photons(prepared, new_stack(), count, photons)]
    near = np.abs(photons[:, [PLACE, PLACE + 2]]).max(axis=1) < 0.3
    below = near & (photons[:, REFLECTS] == 0)
    irradiance = photons[below, FLUX].astype(np.float64).sum() / count / 0.6**2
    noise = 1 / np.sqrt(below.sum())
    assert noise < 0.03
    assert irradiance == pytest.approx(2 * np.pi * UNDER_WATER, rel=4 * noise + 0.03)  # less at the square's corners


def test_brightness_is_irradiance_relative_to_that_of_casters() -> None:
    """One caster of radius 2 receives 40 in all: 10 / pi. Four photons are too few for a fine level."""
    photons = np.zeros((20, PHOTON_COLUMNS), np.float32)
    photons[:, ALL], photons[:, FLUX] = 2, 1
    photons[:4, REFLECTS] = 1
    buckets = np.repeat(np.arange(LEVELS, dtype=np.int32)[:, None], 20, axis=1)
    found = brightness_of(photons, buckets, 3.0, greatest_irradiance(photons, np.array([2.0])))
    side = 3.0 / REFINEMENT ** (LEVELS - 1)
    assert found.shape == (BUCKETS, 2)
    assert found[0] == pytest.approx([16 / side**2 / (10 / np.pi), 0])
    assert found[LEVELS - 1] == pytest.approx([16 / 9 / (10 / np.pi), 4 / 9 / (10 / np.pi)])
    assert not found[LEVELS:].any()


def test_long_chains_are_sampled_where_enough_photons_have_taken_them() -> None:
    """Five photons are enough for a chain, and for the coarsest of the levels, three are not."""
    tables = caustic_tables(HALLS["two"]())
    assert tables is not None
    sequence, rare = 0b1010, 0b111
    photons = np.zeros((8, LONG_COLUMNS), np.float32)
    photons[:, KIND], photons[5:, KIND] = int(LONG) + sequence, int(LONG) + rare
    photons[:, CASTER], photons[:, FLUX] = 1, (1, 1, 4, 1, 1, 9, 9, 9)
    photons[:, INTERFACE] = np.arange(8)
    buckets = np.repeat(np.arange(LEVELS, dtype=np.int32)[:, None], 8, axis=1)
    found = with_long_chains(tables, photons, buckets, 3.0, 2.0)
    assert found.long_kind.tolist() == [[1, int(LONG) + sequence]] and found.long_cdf.tolist() == [0, 1]
    assert np.argwhere(found.is_long).tolist() == [[1, sequence]]
    assert found.long_light[LEVELS - 1, 0] == pytest.approx(8 / 9 / 2)
    assert found.long_light[LEVELS - 1, 2:4].tolist() == [0, 2]  # number of the chain, place of its brightest photon
    assert np.flatnonzero(found.long_light[:, 0]).tolist() == [LEVELS - 1]


def test_seeds_are_spread_over_the_photons_of_a_bucket() -> None:
    buckets = np.array([[5] * 16 + [9] * 2] * LEVELS, np.int32)
    found = seeds_of(buckets)
    assert found[5].tolist() == list(range(0, 16, 2))
    assert found[9].tolist() == [16] * 4 + [17] * 4  # by the coarsest level alone
    assert (found[:5] == -1).all()


def test_tables_list_casters_and_small_lamps_only() -> None:
    tables = caustic_tables(HALLS["two"]())
    assert tables is not None
    assert sorted(tables.caster[:, 2].tolist()) == [0, 1, 1]  # a mirror is not entered
    assert len(tables.lamp) == 1 and tables.is_covered.tolist() == [1]
    water = caustic_tables(HALLS["water"]())
    assert water is not None and water.caster[0, 2:].tolist() == [0, 1]
    large = scene([MATT, GLASS, emitter(3.0)], (FLOOR,), (Sphere((0, 0, 0), 0.5, 1), Sphere((0, 4, 0), 1.0, 2)))
    assert caustic_tables(large) is None


def test_settings_ask_for_caustics_only_where_there_are_some() -> None:
    asked = settings((0.0, 1.8, 5.0), (0.0, -0.3, 0.0), caustics="on")
    assert rendering.settings_as_rendered(asked, HALLS["two"]()) == asked
    bare = scene([MATT, emitter(3.0)], (FLOOR,), (Sphere((1.0, 2, 0), 0.3, 1),))
    assert rendering.settings_as_rendered(asked, bare) == replace(asked, caustics="off")


def test_caustic_tables_depend_on_every_scene_array() -> None:
    """Frames of a shot may share arrays: the tables of one are not those of another that differs in any array."""
    first = HALLS["mesh"]()
    moved = first._replace(position=np.array(first.position - np.float32(0.1)))
    tables = [with_caustics(each).caustics for each in (first, moved, first)]
    assert tables[0] is tables[2]
    assert tables[0].bound[:, :3] - 0.1 == pytest.approx(tables[1].bound[:, :3], abs=1e-5)
