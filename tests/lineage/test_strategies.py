"""Tests that different sampling strategies yield the same mean picture, with the expected noise.

Compared are strategies of light sampling, Russian roulette, and Whitted's integrator with path tracing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.arrays.scene import CompiledScene
from renderer.film import COLOR, mean
from renderer.render import render_frame
from renderer.scene.description import Material, Sphere
from renderer.settings import RenderSettings
from tests.grids import grid
from tests.renderer.builders import emitter, gray, scene, settings, square
from tests.renderer.judge import limit

STRATEGIES = ["uniform", "bsdf", "light", "mis"]
SEEDS = 8


@pytest.fixture(scope="module")
def room() -> CompiledScene:
    """Returns a scene whose light all four sampling strategies can find completely.

    It has a floor, a wall, a square light, a bright ball, and a ball of rough metal.
    """
    materials = [
        Material(base_color=gray(0.7)),
        emitter(5.0),
        emitter(3.0, double_sided=True),
        Material(kind="metallic_roughness", base_color=gray(0.8), metallic=1.0, roughness=0.6),
    ]
    meshes = (
        square((0, 0, 0), (2, 0, 0), (0, 0, -2), 0),
        square((0, 1.5, -1.5), (2, 0, 0), (0, 1.5, 0), 0),
        square((0, 2, 0), (0.6, 0, 0), (0, 0, 0.6), 1),
    )
    spheres = (Sphere((-0.9, 0.4, 0.2), 0.3, 2), Sphere((0.7, 0.5, 0.0), 0.5, 3))
    return scene(materials, meshes, spheres)


def look(**more: object) -> RenderSettings:
    return settings((0, 1.2, 4.5), (0, 0.7, 0), fov=35, size=24, max_depth=5, sampler="independent", **more)


def means(made: CompiledScene, how: RenderSettings, spp: int, seeds: int = SEEDS) -> np.ndarray:
    """Renders the scene with seeds 0 to seeds - 1; returns the mean over all pixels of each picture. how: render settings."""
    return np.array([render_frame(made, replace(how, seed=s), spp)[COLOR].mean() / spp * 2.0**-24 for s in range(seeds)])


def variance(made: CompiledScene, how: RenderSettings, spp: int) -> float:
    """Renders the scene with four seeds; returns the variance of a pixel between them, averaged over all pixels."""
    pictures = np.array([mean(render_frame(made, replace(how, seed=s), spp), 24) for s in range(4)], np.float64)
    return float(pictures.var(0, ddof=1).mean())


def assert_same(samples: dict[str, np.ndarray]) -> None:
    """Asserts that all strategies have the same mean, each compared with the strategy of the lowest noise.

    Differences may be three standard errors, increased for the number of strategies. samples: means of several seeds, by
    strategy.
    """
    best = min(samples, key=lambda name: samples[name].std())
    for name, values in samples.items():
        if name == best:
            continue
        error = np.sqrt((values.var(ddof=1) + samples[best].var(ddof=1)) / len(values))
        assert error < 0.02 * samples[best].mean(), f"{name} is too noisy to judge"
        assert abs(values.mean() - samples[best].mean()) < limit(len(samples)) * error, name


def test_all_strategies_have_the_same_mean(room):
    spp = {"uniform": 96, "bsdf": 64, "light": 24, "mis": 16, "mixture": 32}
    assert_same({s: means(room, look(sampling=s), n) for s, n in spp.items()})


@grid("sampling", STRATEGIES)
def test_variance_falls_as_one_over_the_samples(room, sampling):
    few, many = (variance(room, look(sampling=sampling), spp) for spp in (16, 128))
    assert few / many == pytest.approx(8, rel=0.35)


def test_mis_is_as_good_as_the_best_of_the_others(room):
    found = {s: variance(room, look(sampling=s), 48) for s in STRATEGIES}
    assert found["mis"] <= 1.1 * min(v for s, v in found.items() if s != "mis"), found


@grid("survival", [0.2, 0.5, 0.8])
def test_roulette_at_a_constant_chance_keeps_the_mean(room, survival):
    assert_same(
        {
            "by throughput": means(room, replace(look(), max_depth=64), 16),
            "constant": means(room, replace(look(), max_depth=64, roulette=survival), 48),
        }
    )


@pytest.mark.long
def test_path_and_whitted_agree_where_only_direct_light_is():
    made = scene(
        [Material(base_color=gray(0.7)), emitter(6.0)],
        (square((0, 0, 0), (2, 0, 0), (0, 0, -2), 0), square((0, 2, 0), (0.5, 0, 0), (0, 0, 0.5), 1)),
        (Sphere((0.0, 0.4, 0.0), 0.4, 0),),
    )
    direct = means(made, look(integrator="direct"), 32)
    whitted = means(made, look(integrator="whitted", light_samples=16), 32)
    assert_same({"direct": direct, "whitted": whitted})


@pytest.mark.parametrize("side", [1, -1])
def test_a_flat_quad_is_hit_from_both_sides(side):
    made = scene([emitter(1.0, double_sided=True)], (square((0, 0, 0), (1, 0, 0), (0, 1, 0), 0),))
    sums = render_frame(made, settings((0, 0, 3.0 * side), (0, 0, 0), fov=20, size=8), 4)
    assert (mean(sums, 24) == 1.0).all()


def test_a_box_without_thickness_is_still_a_box():
    """Rays hit a scene of zero extent along an axis, although its bounding box has no volume."""
    flat = square((0, 0, 0), (1, 0, 0), (0, 1, 0), 0)
    made = scene([emitter(1.0, double_sided=True)], (flat,))
    assert np.ptp(made.bounds[:, 2]) == 0
    for eye in ((0.3, -0.2, 2.0), (0.5, 0.5, -2.0), (0.01, 0.0, 1e-3)):
        sums = render_frame(made, settings(eye, (eye[0], eye[1], 0.0), fov=5, size=4), 4)
        assert (mean(sums, 24) == 1.0).all()
