"""Tests of sampling directions towards targets: they follow the stated density, from outside, from inside, and edge-on."""

import numpy as np
import pytest

from renderer.jit import entry
from renderer.kernel.lineage.mixture import sample_towards, target_density
from renderer.scene.description import Material, Sphere
from tests.grids import grid
from tests.renderer.builders import emitter, gray, scene, square
from tests.renderer.judge import direction_test

N = 200_000
POINTS = [(0.1, -0.2, 0.3), (0.0, 0.0, 1.2), (-0.6, 0.9, -0.4)]


@entry
def _aim(made, primitive, p, u, direction, pdf):
    for i in range(len(u)):
        d, pdf[i] = sample_towards(made, primitive, (p[0], p[1], p[2]), (u[i, 0], u[i, 1]))
        for k in range(3):
            direction[i, k] = d[k]


@entry
def _density(made, primitive, p, direction, pdf):
    for i in range(len(direction)):
        d = (direction[i, 0], direction[i, 1], direction[i, 2])
        pdf[i] = target_density(made, primitive, (p[0], p[1], p[2]), d)


@pytest.fixture(scope="module")
def targets():
    """Returns two triangles and two spheres, the larger of which contains the first point."""
    meshes = (square((0, 0, -1), (1, 0, 0), (0, 1, 0), 0),)
    return scene([emitter(1.0), Material(base_color=gray(0.5))], meshes, (Sphere((1, 1, 1), 0.5, 1), Sphere((0, 0, 0), 0.6, 1)))


@pytest.mark.long
@grid("point", POINTS, ordinary=((-0.6, 0.9, -0.4),))
@grid("primitive", range(4), ordinary=(0,))
def test_directions_follow_their_density(targets, point, primitive):
    p = np.array(point, np.float32)
    u = np.random.default_rng(primitive).random((N, 2), np.float32)
    directions, pdf = np.empty((N, 3), np.float32), np.empty(N, np.float32)
    _aim(targets, np.int32(primitive), p, u, directions, pdf)
    again = np.empty(N, np.float32)
    _density(targets, np.int32(primitive), p, directions, again)
    inner = again > 0  # rounding may let a direction at the rim miss
    assert inner.mean() > 0.999
    np.testing.assert_allclose(again[inner], pdf[inner], rtol=2e-3)

    def density(grid):
        values = np.empty(len(grid), np.float32)
        _density(targets, np.int32(primitive), p, np.ascontiguousarray(grid, np.float32), values)
        return values

    direction_test(directions, density, tests=len(POINTS) * 4, fine=48, name=f"primitive {primitive} from {point}")


def test_targets_are_marked_spheres_and_lights():
    meshes = (square((0, 0, -1), (1, 0, 0), (0, 1, 0), 0),)
    made = scene(
        [emitter(1.0), Material(base_color=gray(0.5))], meshes, (Sphere((1, 1, 1), 0.5, 1), Sphere((0, 0, 0), 0.6, 1, guide=True))
    )
    assert made.guide.tolist() == [3, 0, 1]
