"""Tests of pairing emissive triangles into parallelogram lights, and of these lights' rows in the light table."""

import numpy as np
import pytest

from renderer.arrays.light_rows import CORNER, CORNER_ERROR, EDGES, RECIPROCAL
from renderer.scene.parallelograms import pair, tabulate_parallelograms
from tests.renderer.builders import emitter, scene, square

A, B, C, D = np.array([[0, 0, 0], [2, 0, 1], [3, 1, 1], [1, 1, 0]], float)  # corners of a parallelogram, in order
NEARLY = A + 0.5 * (B - A) + (0, 1e-6, 0)
EVERY = np.ones(1, bool)


@pytest.mark.parametrize("first", range(3))
@pytest.mark.parametrize("second", range(3))
@pytest.mark.parametrize("halves", [((A, B, C), (A, C, D)), ((A, B, D), (B, C, D))])
def test_triangle_pairs_form_a_parallelogram_in_any_order(halves, first, second):
    corners = np.array([np.roll(halves[0], first, 0), np.roll(halves[1], second, 0)])
    which, shape = pair(corners, EVERY)
    assert which.tolist() == [0]
    p, s, t, q = shape[0]
    np.testing.assert_array_equal(p + q, s + t)
    assert {tuple(corner) for corner in shape[0]} == {tuple(corner) for corner in (A, B, C, D)}
    np.testing.assert_allclose(np.cross(s - p, t - p), np.cross(B - A, D - A))


@pytest.mark.parametrize(
    ("corners", "alike"),
    [
        ([[A, B, C], [A, C, D]], False),
        ([[A, B, C], [A, D, C]], True),  # opposite winding
        ([[A, B, C], [A, C, D + 0.01]], True),
        ([[A, B, C], [A + 1e-7, C, D]], True),  # not connected
        ([[A, B, C], [B, D, C]], True),  # folded over an edge
        ([[A, B, NEARLY], [B, B + NEARLY - A, NEARLY]], True),  # a sliver
    ],
)
def test_other_triangle_pairs_are_not_joined(corners, alike):
    assert len(pair(np.array(corners), np.array([alike]))[0]) == 0


def test_each_triangle_is_in_one_pair_at_most():
    """Each triangle is in at most one pair, also in a strip, where it could be paired with either neighbour."""
    up = np.array([0, 1, 0.0])
    right = np.array([1.0, 0, 0])
    strip = []
    for k in range(3):
        o = k * right
        strip += [[o, o + right, o + up], [o + right, o + right + up, o + up]]
    which, _ = pair(np.array(strip), np.ones(5, bool))
    assert which.tolist() == [0, 2, 4]


def test_no_triangles_give_no_parallelograms():
    assert len(pair(np.zeros((0, 3, 3)), np.zeros(0, bool))[0]) == 0
    assert tabulate_parallelograms(np.zeros(0, np.int64), np.zeros((0, 4, 3)), 5).shape == (0, 16)


def test_row_contains_reciprocal_edges():
    row = tabulate_parallelograms(np.array([1]), np.array([[A, B, D, C]]), 3).astype(float)
    assert not row[[0, 2]].any()
    corner, edges, reciprocal = row[1, CORNER : CORNER + 3], row[1, EDGES : EDGES + 6], row[1, RECIPROCAL : RECIPROCAL + 6]
    point = corner + 0.3 * edges[:3] + 0.8 * edges[3:]
    np.testing.assert_allclose([(point - corner) @ reciprocal[:3], (point - corner) @ reciprocal[3:]], [0.3, 0.8], rtol=1e-6)
    assert 0 < row[1, CORNER_ERROR] < 1e-5


def test_lamp_of_two_triangles_is_one_light():
    lamps = square((0, 0, 2), (1, 0, 0), (0, -1, 0), 0), square((3, 0, 2), (1, 0, 0), (0, -0.5, 0), 0)
    made = scene([emitter(1.0)], lamps)
    assert len(made.light_primitive) == len(made.light_parallelogram) == 2
    assert sorted(made.light_area.tolist()) == [2, 4]
    assert made.triangle_light[0] == made.triangle_light[1] != made.triangle_light[2] == made.triangle_light[3]
    assert (made.light_parallelogram[:, CORNER_ERROR] > 0).all()


def test_guides_include_both_triangles():
    made = scene([emitter(1.0)], (square((0, 0, 2), (1, 0, 0), (0, -1, 0), 0),))
    assert sorted(made.guide.tolist()) == [0, 1]
