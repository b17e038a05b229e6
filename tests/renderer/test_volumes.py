"""Tests of heterogeneous media against closed forms: Beer's law, homogeneous media, furnaces, emission; and equal bits."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from renderer.film import mean
from renderer.render import render_batch, render_frame
from renderer.scene.description import Environment, Light, Material, Medium, Sphere, Volume
from renderer.settings import RenderSettings, Tile, View
from tests.renderer.builders import gray, square
from tests.renderer.judge import assert_mean, limit
from tests.renderer.test_media import AHEAD, BALL, BLACK_SKY, NARROW, assert_colors, described, film, interface, slab

pytestmark = pytest.mark.long  # one more kernel to compile


def cube(half: float = 1.0, center: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Returns the transform of a volume that extends `half` to each side of the centre."""
    place = np.diag((2 * half, 2 * half, 2 * half, 1.0))
    place[:3, 3] = np.array(center) - half
    return place


def noise(seed: int = 1, shape: tuple[int, int, int] = (13, 9, 17)) -> np.ndarray:
    """Returns a density grid, (nz, ny, nx), with holes."""
    return np.maximum(np.random.default_rng(seed).random(shape) - 0.4, 0).astype(np.float32)


def through(density: np.ndarray, x: float = 0.0, y: float = 0.0, half: float = 1.0) -> float:
    """Returns the integral over z of a grid's trilinear interpolation at x and y. The grid fills a cube from -half to half."""
    n = 40_000
    points = np.stack([np.full(n, x), np.full(n, y), (np.arange(n) + 0.5) / n * 2 * half - half], axis=1)
    shape = np.array(density.shape)
    at = np.clip((points + half)[:, ::-1] / (2 * half) * shape - 0.5, 0, shape - 1)
    low = np.minimum(at.astype(int), np.maximum(shape - 2, 0))
    total = np.zeros(n)
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, at - low, 1 - (at - low)), axis=1)
        total += weight * density[tuple(np.minimum(low + corner, shape - 1).T)]
    return float(total.mean() * 2 * half)


def in_grid(material: Material, density: np.ndarray, **more: Any) -> Any:
    """Returns a scene with a slab of the material, whose density is the grid in the cube from -1 to 1, under a white sky."""
    volume = Volume(density, cube(), more.pop("emission", None), more.pop("emission_color", gray(1.0)))
    walls = (slab(2.2, 1.1), *more.pop("meshes", ()))
    lifted = replace(walls[0], positions=walls[0].positions + np.array((0.0, 0.0, 1.1), np.float32))
    return described([replace(material, volume="grid")], (), (lifted, *walls[1:]), volumes={"grid": volume}, **more)


def test_what_is_absorbed_is_what_lies_on_the_line() -> None:
    """The mean of ratio tracking along one line equals Beer's law with the grid's integral."""
    density, sigma = noise(), np.array((0.5, 2.0, 6.0))
    expected = np.exp(-sigma * through(density))
    assert_colors(film(in_grid(interface(sigma_a=tuple(sigma)), density), NARROW, 512), tuple(expected), tests=6)


def test_a_shadow_ray_loses_what_lies_on_the_line() -> None:
    """A floor lit through a volume by a distant lamp has the radiance by Beer's law, in both backends (ratio tracking)."""
    density, sigma = noise(2), np.array((0.5, 1.0, 2.0))
    floor = square((0, 0, -2), (9, 0, 0), (0, 9, 0), 1)
    view = View((9.0, 0.0, 0.0), (0.0, 0.0, -2.0), fov=0.01)
    for opacity in (1.0, 0.5):
        pictures = []
        for sigma_a in (tuple(sigma), gray(0.0)):
            ball = Sphere((0.0, 0.0, 0.0), 1.5, 0)
            card = square((0, 0, 2), (1, 0, 0), (0, 1, 0), 2)
            half_clear = Material(base_color=gray(0.0), opacity=opacity, alpha_mode="blend")
            meshes = (floor, card) if opacity < 1 else (floor,)
            scene = described(
                [interface(sigma_a=sigma_a, volume="grid"), Material(base_color=gray(0.5)), half_clear],
                (ball,),
                meshes,
                volumes={"grid": Volume(density, cube())},
                lights=[Light("directional", gray(2.0), direction=(0.0, 0.0, -1.0))],
                environment=BLACK_SKY,
            )
            pictures.append(film(scene, view, 512, max_depth=2))
        lit, bright = (np.asarray(mean(each, 24)).reshape(-1, 3) for each in pictures)
        share, error = lit.mean(axis=0) / bright.mean(axis=0), lit.std(axis=0) / np.sqrt(len(lit)) / bright.mean(axis=0)
        assert (np.abs(share - np.exp(-sigma * through(density))) <= limit(6) * error + 2e-3).all()


def test_a_grid_that_is_even_is_a_homogeneous_medium() -> None:
    """A constant grid and a homogeneous medium of the same coefficients give the same mean picture, with a lamp."""
    lamp = Material(base_color=gray(0.0), emission=gray(8.0))
    fog = Material(kind="interface", sigma_a=(0.2, 0.1, 0.4), sigma_s=(1.0, 2.0, 3.0), g=0.5)
    ones, sphere = np.full((3, 5, 2), 0.5, np.float32), Sphere((0.0, 3.0, 1.0), 0.5, 1)
    even = described([fog, lamp], (*BALL, sphere), environment=Environment(gray(0.2)))
    double = replace(fog, sigma_a=(0.4, 0.2, 0.8), sigma_s=(2.0, 4.0, 6.0), volume="grid")
    grid = described(
        [double, lamp], (*BALL, sphere), environment=Environment(gray(0.2)), volumes={"grid": Volume(ones, cube(1.2))}
    )
    (a, b), (of_a, of_b) = zip(*(_mean(film(scene, spp=512)) for scene in (even, grid)), strict=True)
    assert (np.maximum(of_a, of_b) < 0.02 * a).all()
    assert (np.abs(a - b) <= limit(3) * np.hypot(of_a, of_b)).all()


def _mean(sums: Any) -> tuple[np.ndarray, np.ndarray]:
    """Returns the mean of each pixel block's colour and its standard error from the spread between pixels of equal halves."""
    picture = np.asarray(mean(sums, 24))
    means = np.array([part.mean(axis=(0, 1)) for part in (picture[:, i::4] for i in range(4))])
    return means.mean(axis=0), np.maximum(means.std(axis=0, ddof=1) / 2, 0.003 * means.mean(axis=0))


@pytest.mark.parametrize("sigma_s", [(2.0, 4.0, 9.0), (6.0, 0.0, 1.0)])
def test_what_only_scatters_shows_the_sky_as_it_is(sigma_s: tuple[float, float, float]) -> None:
    """A white heterogeneous medium is invisible in a furnace.

    Each path has the sum of the channels by itself, up to rare events of roulette, which the slack is for.
    """
    scene = described([interface(sigma_s=sigma_s, g=0.3, volume="grid")], BALL, volumes={"grid": Volume(noise(), cube())})
    assert_mean(film(scene, spp=256), 1.0, slack=3e-4, tests=2)
    around = View((0.1, 0.2, 0.3), (0.0, 0.0, -1.0), fov=70.0)
    assert_mean(film(scene, around, spp=256), 1.0, slack=3e-4, tests=2)


@pytest.mark.parametrize("sigma_a", [0.0, 0.7])
def test_what_a_grid_emits_is_its_integral(sigma_a: float) -> None:
    """Emission without absorption has the radiance of the grid's integral; with an even density, of the attenuated integral."""
    emission = noise(3)
    color, even = (1.0, 2.0, 0.5), np.ones_like(emission)
    scene = in_grid(interface(sigma_a=gray(sigma_a)), even, emission=emission, emission_color=color, environment=BLACK_SKY)
    expected = through(emission)
    if sigma_a:
        slices = np.array([through(emission * _slice(emission, k)) for k in range(emission.shape[0])])
        places = (np.arange(len(slices)) + 0.5) / len(slices) * 2 - 1
        expected = float((slices * np.exp(-sigma_a * (1 - places))).sum())
    assert_colors(
        film(scene, NARROW, 1024), tuple(expected * c for c in np.array(color)), tests=6, slack=1e-4 if not sigma_a else 5e-3
    )


def _slice(values: np.ndarray, k: int) -> np.ndarray:
    """Returns a grid of ones in slice k along z, zeros elsewhere. The slices' interpolations add up to 1."""
    found = np.zeros_like(values)
    found[k] = 1
    return found


def test_what_scatters_around_emission_keeps_its_power() -> None:
    """A white ball that emits in its middle sends out all that is emitted, evenly: power is conserved."""
    axis = (np.arange(24) + 0.5) / 12 - 1
    radius = np.sqrt(axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2)
    emission, density = ((radius < most).astype(np.float32) for most in (0.4, 0.8))
    place = cube()
    seen = []
    for sigma_s in (0.0, 3.0):
        scene = described(
            [interface(sigma_s=gray(sigma_s), volume="grid")],
            (Sphere((0.0, 0.0, 0.0), 1.8, 0),),
            volumes={"grid": Volume(density, place, emission)},
            environment=BLACK_SKY,
        )
        far = View((3.0, 4.0, 50.0), (0.0, 0.0, 0.0), projection="orthographic", height=2.0)
        seen.append(float(np.asarray(mean(film(scene, far, 1024), 24)).mean()))
    assert seen[1] == pytest.approx(seen[0], rel=0.03)


def test_the_bits_do_not_depend_on_the_division_into_batches() -> None:
    scene = in_grid(interface(sigma_a=gray(0.2), sigma_s=(1.0, 2.0, 3.0)), noise(), emission=noise(3))
    settings = RenderSettings(24, 16, AHEAD, max_depth=16)
    whole = render_frame(scene, settings, 8)
    assert np.array_equal(whole, render_frame(scene, settings, 8, threads=1))
    parts = np.zeros_like(whole)
    for tile in (Tile(0, 0, 11, 16), Tile(11, 0, 13, 9), Tile(11, 9, 13, 7)):
        for first, count in ((0, 3), (3, 5)):
            sums = render_batch(scene, settings, tile, first, count).sums
            parts[:, tile.y : tile.y + tile.h, tile.x : tile.x + tile.w] += sums
    assert np.array_equal(whole, parts)


def test_the_worlds_medium_may_have_a_grid() -> None:
    """Fog in a grid in the open: it ends with the grid, so that the sky is seen beyond."""
    density, sigma = noise(4), (0.5, 1.0, 3.0)
    mesh = square((0, -9, 0), (1, 0, 0), (0, 0, 1), 0)
    scene = described(
        [Material()], (), (mesh,), medium=Medium(sigma_a=sigma, volume="grid"), volumes={"grid": Volume(density, cube())}
    )
    expected = np.exp(-np.array(sigma) * through(density))
    assert_colors(film(scene, NARROW, 512), tuple(expected), tests=6)
