"""Tests of the survival probabilities of Russian roulette; test_strategies.py and the furnace tests check that it is unbiased."""

import numpy as np
import pytest

from renderer.jit import entry
from renderer.kernel.options import kernel_options
from renderer.kernel.steps.continue_or_end import roulette_weight_after, survival
from renderer.scene.description import Sphere
from renderer.settings import MAX_FLOOR
from tests.renderer.builders import emitter, scene, settings

ROOM = scene([emitter(1.0)], spheres=(Sphere((0, 0, 0), 1.0),))

ON_SURFACE = np.bool_(True)


@entry
def _follow(weights, eta2, unguided, options, chances):
    """Writes the survival probability at each vertex of a path with the given weights."""
    roulette_weight, left = np.float32(1.0), np.float32(1.0)
    for k in range(len(weights)):
        weight = weights[k], np.float32(0.5) * weights[k], np.float32(0.0)
        roulette_weight = roulette_weight_after(roulette_weight, np.float32(k), weight, eta2[k], unguided[k])
        left = left * weights[k]
        throughput = left, np.float32(0.5) * left, np.float32(0.0)
        chances[k] = survival(throughput, roulette_weight, np.float32(k + 1), options, ON_SURFACE)
        left = left / chances[k]


def chances(*weights, eta2=None, unguided=None, **asked):
    eta2, unguided = (
        np.ones(len(weights), np.float32) if each is None else np.array(each, np.float32) for each in (eta2, unguided)
    )
    found = np.zeros(len(weights), np.float32)
    options = kernel_options(settings((0, 0, 0), (1, 0, 0), 50, **asked), ROOM)
    _follow(np.array(weights, np.float32), eta2, unguided, options, found)
    return found.tolist()


def test_roulette_ends_long_dark_paths_only():
    assert chances(0.9, 0.01, 0.5)[:2] == [1, 1]
    assert chances(0.9, 0.01, 0.5)[2] == pytest.approx(1.4 * 0.01 * 0.5)


def test_throughput_of_five_sevenths_survives_with_certainty():
    assert chances(1.0, 0.95, 0.9, 1.0) == [1, 1, 1, 1]
    assert chances(1.0, 0.8, 0.6, 0.9)[2:] == pytest.approx([1.4 * 0.8 * 0.6, 0.9])


@pytest.mark.parametrize("first", [0.02, 0.3, 4.0])
def test_dark_first_vertex_does_not_reduce_survival(first):
    assert chances(first, 0.5, 0.5, 0.5) == pytest.approx(chances(1.0, 0.5, 0.5, 0.5))


def test_radiance_scale_in_glass_does_not_affect_survival():
    """A path that enters glass of eta 1.5 and leaves it three vertices later survives as if radiance were not scaled."""
    square = 1.5**2
    found = chances(0.8, 1 / square, 0.5, 0.5, square, 0.9, eta2=[1, square, 1, 1, 1 / square, 1])
    assert found == pytest.approx(chances(0.8, 1.0, 0.5, 0.5, 1.0, 0.9), rel=1e-6)


def test_long_white_paths_end():
    found = chances(*[1.0] * 12)
    assert found[:7] == [1] * 7
    assert found[7:] == pytest.approx([MAX_FLOOR] * 5)


def test_roulette_minimum_and_constant_are_respected():
    assert chances(0.9, 0.01, 0.5, roulette_floor=0.25)[2] == 0.25
    assert chances(0.9, 0.01, 0.5, roulette=0.75) == [0.75] * 3


def test_aimed_directions_do_not_reduce_survival():
    """The survival is that of the same directions sampled by the BSDF, whose weights are larger by the factor `unguided`."""
    aimed = chances(0.5, 0.01, 0.005, 0.004, 0.02, unguided=(7.0, 80.0, 160.0, 200.0, 40.0))
    assert aimed == pytest.approx(chances(0.5, 0.8, 0.8, 0.8, 0.8), rel=1e-5)
    assert chances(0.5, 0.01, 0.005, 0.004, 0.02)[-1] < 0.06
