"""Tests of the edge margins of triangles, compared with the radius of the inscribed circle, from elementary geometry."""

import numpy as np

from renderer.jit import entry
from renderer.kernel import vec
from renderer.kernel.surface.edge_margins import edge_margins


@entry
def _fill(corner, found):
    for i in range(len(corner)):
        a = corner[i, 0, 0], corner[i, 0, 1], corner[i, 0, 2]
        b = corner[i, 1, 0], corner[i, 1, 1], corner[i, 1, 2]
        c = corner[i, 2, 0], corner[i, 2, 1], corner[i, 2, 2]
        found[i, 0], found[i, 1] = edge_margins(a, b, c, vec.cross(vec.sub(b, a), vec.sub(c, a)))


def margins(corners):
    """Returns the edge margins (T, 2) of the triangles with these corners (T, 3, 3)."""
    corner = np.asarray(corners, np.float32)
    found = np.empty((len(corner), 2), np.float32)
    _fill(corner, found)
    return found


def inscribed_radius(corners):
    edges = [corners[:, i] - corners[:, j] for i, j in ((1, 0), (2, 1), (0, 2))]
    twice_area = np.linalg.norm(np.cross(edges[0], edges[1]), axis=1)
    return twice_area / sum(np.linalg.norm(e, axis=1) for e in edges)


def test_margin_bounds_the_reciprocal_inscribed_radius():
    corners = np.random.default_rng(1).standard_normal((20_000, 3, 3)).astype(np.float32).astype(np.float64)
    tightness = margins(corners)[:, 0] * inscribed_radius(corners)
    assert tightness.min() > 1 - 1e-6
    assert tightness.max() < 3


def test_margins_scale_with_the_triangle():
    corners = np.random.default_rng(2).standard_normal((1000, 3, 3)).astype(np.float32)
    one, large = margins(corners), margins(1024 * corners)
    np.testing.assert_allclose(large[:, 0] * 1024, one[:, 0], rtol=1e-6)
    np.testing.assert_allclose(large[:, 1] / 1024, one[:, 1], rtol=1e-6)


def test_sliver_margins_are_limited_by_their_width():
    width = np.geomspace(1e-9, 1, 60)
    corners = np.zeros((60, 3, 3))
    corners[:, 1, 0] = 1
    corners[:, 2, 0], corners[:, 2, 1] = 0.3, width
    miss = margins(corners)[:, 1]
    assert (miss <= width).all()
    some = (width > 1e-2) & (width < 0.3)  # for narrower triangles the width is the limit
    assert (np.diff(miss[some]) < 0).all()  # narrower triangles miss more
    assert miss[-1] < 1e-6


def test_a_triangle_without_area_has_finite_margins():
    found = margins([[[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[1, 1, 1], [1, 1, 1], [1, 1, 1]]])
    assert np.isfinite(found).all()
