"""How far rays keep from a triangle's edges, against the inscribed circle of elementary geometry."""

import numpy as np

from renderer.scene.margins import edge_margins
from renderer.threads import Team


def margins(corners):
    """(T, 2) of triangles (T, 3, 3)."""
    position = np.asarray(corners, np.float32).reshape(-1, 3)
    return edge_margins(position, np.arange(len(position), dtype=np.int32).reshape(-1, 3), Team(1))


def inscribed_radius(corners):
    edges = [corners[:, i] - corners[:, j] for i, j in ((1, 0), (2, 1), (0, 2))]
    twice_area = np.linalg.norm(np.cross(edges[0], edges[1]), axis=1)
    return twice_area / sum(np.linalg.norm(e, axis=1) for e in edges)


def test_the_bound_is_above_one_over_the_inscribed_circles_radius_and_no_more_than_three_times_it():
    corners = np.random.default_rng(1).standard_normal((20_000, 3, 3)).astype(np.float32).astype(np.float64)
    tightness = margins(corners)[:, 0] * inscribed_radius(corners)
    assert tightness.min() > 1 - 1e-6
    assert tightness.max() < 3


def test_margins_scale_with_the_triangle():
    corners = np.random.default_rng(2).standard_normal((1000, 3, 3)).astype(np.float32)
    one, large = margins(corners), margins(1024 * corners)
    np.testing.assert_allclose(large[:, 0] * 1024, one[:, 0], rtol=1e-6)
    np.testing.assert_allclose(large[:, 1] / 1024, one[:, 1], rtol=1e-6)


def test_slivers_are_missed_by_more_but_never_by_more_than_they_are_wide():
    width = np.geomspace(1e-9, 1, 60)
    corners = np.zeros((60, 3, 3))
    corners[:, 1, 0] = 1
    corners[:, 2, 0], corners[:, 2, 1] = 0.3, width
    miss = margins(corners)[:, 1]
    assert (miss <= width).all()
    some = (width > 1e-2) & (width < 0.3)  # below, the width is the limit
    assert (np.diff(miss[some]) < 0).all()  # the narrower, the more
    assert miss[-1] < 1e-6


def test_a_triangle_without_area_has_finite_margins():
    found = margins([[[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[1, 1, 1], [1, 1, 1], [1, 1, 1]]])
    assert np.isfinite(found).all()
