"""Light is sampled for eight points as for each alone: the same lights and texels, numbers to a few units in the last place."""

import functools

import numpy as np
import pytest

from renderer.arrays.edition import edition_of, only
from renderer.jit import entry, template
from renderer.kernel.fetch import row
from renderer.kernel.light.environment import choose, choose_from, environment_light, sample_environment
from renderer.scene.cutpoints import cutpoints
from renderer.scene.description import Environment, Material, Sky
from renderer.scene.lights import cumulative
from renderer.wide.rows import load_ints
from tests.renderer.builders import scene, square
from tests.renderer.wide.both import LANES, both, keep, ulps

N = 8 * 500


@template
def in_both(formula, made, width, given, order, eight, one):
    """As that of both.py, of a formula that reads a scene."""
    for i in range(0, len(given), LANES):
        number = load_ints(order, np.uintp(i))
        keep(eight, i, number, formula(made, row(given, number, width)))
        for j in range(i, i + LANES):
            keep(one, j, j, formula(made, row(given, j, width)))


def of(kernel, made, given, count):
    return both(functools.partial(kernel, made), given, count)


FLOOR = (square((0, 0, -9), (1, 0, 0), (0, 1, 0), 0),)


def plain(made):
    """In the edition that it is rendered in."""
    return only(made, edition_of(made))


def sky():
    pixels = np.random.default_rng(4).gamma(0.5, size=(8, 16, 3)).astype(np.float32)
    pixels[2, 5] = 20.0
    return pixels


SKIES = {
    "an image": sky,
    "one colour": lambda: 0.7,
    "a sun": lambda: Environment(sky=Sky(40.0, 20.0, sun_size=30.0), rotation=50.0),
}


@template
def _of_environment(made, given):
    d, pdf = sample_environment(made, given[0], (given[1], given[2]))
    light, density = environment_light(made, (given[3], given[4], given[5]), given[0] < np.float32(0.5))
    return *d, pdf, *light, density


@entry
def _environment(made, given, order, eight, one):
    in_both(_of_environment, made, 6, given, order, eight, one)


def unit(rng, n):
    d = rng.standard_normal((n, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


@pytest.mark.parametrize("name", SKIES)
def test_an_environment_is_sampled_for_eight_as_for_one(name):
    made = plain(scene([Material()], FLOOR, environment=SKIES[name]()))
    rng = np.random.default_rng(1)
    d = unit(rng, N)
    d[:8] = (0, 1, 0), (0, -1, 0), (0, 0, 1), (-0.0, 0, 1), (0, 0, -1), (0, 1.0000001, 0), (1, 0, 0), (-1, 0, 0)
    eight, one = of(_environment, made, np.concatenate([rng.random((N, 3)), d], 1), 8)
    assert ulps(eight[:3], one[:3], 1.0).max() <= 8
    assert ulps(eight[3:], one[3:], 1e-3).max() <= 16


@template
def _of_tables(tables, given):
    cdf, cdfs, start, starts = tables
    i, rest, width = choose(cdf, given[0])
    k, again, _ = choose_from(cdfs, starts, np.uint32(2), given[1])
    j, _, _ = choose_from(cdf, start, np.uint32(0), given[0])
    return i, rest, width, j, k, again


@entry
def _choices(tables, given, order, eight, one):
    in_both(_of_tables, tables, 2, given, order, eight, one)


@pytest.mark.parametrize("count", [1, 5, 9, 300])
def test_eight_choices_are_those_of_one_each(count):
    rng = np.random.default_rng(count)
    cdfs = np.stack([cumulative(rng.random(count) ** 3 * (rng.random(count) > 0.3) + 1e-9) for _ in range(3)])
    tables = cdfs[2].copy(), cdfs, cutpoints(cdfs[2]), cutpoints(cdfs)
    u = rng.random((N, 2), np.float32)
    edges = cdfs[2][cdfs[2] < 1]
    u[: len(edges), 1] = u[: len(edges), 0] = edges
    eight, one = of(_choices, tables, u, 6)
    np.testing.assert_array_equal(eight, one)
    np.testing.assert_array_equal(one[0], one[3])
    np.testing.assert_array_equal(one[0], np.searchsorted(cdfs[2], u[:, 0], "right") - 1)
