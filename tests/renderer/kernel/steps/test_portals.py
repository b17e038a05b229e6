"""Tests of sampling the portals of a path guide: directions follow their density, which integrates to 1."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.arrays.guide import FRAME_COLUMNS, OTHER_RADIANCE, RADIANCE_COLUMNS, portal_guide
from renderer.jit import entry
from renderer.kernel.steps.portals import MOST_CHANCE, NO_PORTAL, portals_in_view, portals_pdf, sample_portal
from tests.renderer.judge import direction_test

N = 100_000
# Two overlapping spheres above the vertex, one partly below its horizon, one about it, and one behind it.
PORTALS = np.array([(1, 2, 0, 0.5), (1.3, 2.2, 0.2, 0.7), (-2, 0, 1, 0.8), (0.1, 0, 0, 0.4), (0, -2, 0, 0.5)], np.float32)


def _guide(other: float):
    radiance = np.zeros((1, RADIANCE_COLUMNS), np.float32)
    radiance[0, : len(PORTALS)], radiance[0, OTHER_RADIANCE] = (5, 1, 3, 50, 50), other
    return portal_guide(np.array([-1, -1, -1, 1, 1, 1, 1], np.float32)[:FRAME_COLUMNS], PORTALS.copy(), radiance)


@entry
def _portals(guide, u, found, pdf):
    """Writes the direction sampled for each u, and the pdf of the directions in `found` before that; returns the chance."""
    point, normal, cube = (
        (np.float32(0), np.float32(0), np.float32(0)),
        (np.float32(0), np.float32(1), np.float32(0)),
        np.uint32(0),
    )
    chance = np.float32(0)
    for i in range(len(found)):
        view = portals_in_view(guide, cube, point, normal, u[i, 0])
        pdf[i] = portals_pdf(guide, cube, point, normal, view.total, (found[i, 0], found[i, 1], found[i, 2]), NO_PORTAL)
        w = sample_portal(view, point, u[i, 1])
        chance = view.chance
        for k in range(3):
            found[i, k] = w[k]
    return chance


def _run(u: np.ndarray, at: np.ndarray, other: float = 1.0):
    found, pdf = np.array(at, np.float32), np.zeros(len(at), np.float32)
    return _portals(_guide(other), np.array(u, np.float32), found, pdf), found, pdf


@pytest.mark.long
def test_directions_towards_portals_follow_their_density():
    start = np.tile(np.float32((0, 1, 0)), (N, 1))
    _, found, _ = _run(np.random.default_rng(3).random((N, 2), np.float32), start)
    direction_test(found, lambda at: _run(np.zeros((len(at), 2)), at)[2], tests=1, fine=24)
    assert (_run(np.zeros((N, 2)), found)[2] > 0).mean() > 0.999


@pytest.mark.long
def test_portals_are_sampled_as_often_as_they_bring_light():
    one = np.float32([(0, 1, 0)])
    chances = [_run(np.zeros((1, 2)), one, other)[0] for other in (0.0, 10.0, 1000.0)]
    assert chances[0] == MOST_CHANCE > chances[1] > chances[2] > 0
