"""Tests of learning portals: they are found where light comes through a small hole, and nowhere if it comes from everywhere."""

from __future__ import annotations

import numpy as np

from renderer.arrays.guide import MOST_PORTALS, OTHER_RADIANCE, PORTAL_CENTER, PORTAL_RADIUS
from renderer.guiding.portals import Segments, learn_portals, lit_part, moment_left
from renderer.guiding.train import MOST_LEFT_BY_PORTALS
from renderer.kernel.guiding.pilot import RECORD_COLUMNS, RECORD_NEAR, RECORD_SCALE

HOLE, SIZE = np.array([1.5, 2.0, 4.0]), 0.4  # centre, and half of the side, of a square hole in the wall z = 4


def _segments(count: int, seed: int, beyond: float) -> Segments:
    """Returns cosine-distributed segments from the floor of a room of 4 x 4 x 4 whose walls have radiance 1.

    beyond: radiance that is seen through the hole.
    """
    random = np.random.default_rng(seed)
    point = random.random((count, 3)) * (4, 0, 2)
    radius, angle = np.sqrt(random.random(count)), 2 * np.pi * random.random(count)
    d = np.stack((radius * np.cos(angle), np.sqrt(1 - radius * radius), radius * np.sin(angle)), axis=1)
    with np.errstate(divide="ignore"):
        walls = np.where(d > 0, (4 - point) / d, np.where(d < 0, -point / d, np.inf))
    length = np.where(d[:, 1] > 0, np.where(walls > 0, walls, np.inf).min(axis=1), np.inf)
    at = point + length[:, None] * d
    through = (np.abs(at - HOLE) < (SIZE, SIZE, 1e-6)).all(axis=1) & (HOLE[2] - at[:, 2] < 1e-6)
    length = np.where(through, length + 3.0, length)
    normal = np.tile((0.0, 1.0, 0.0), (count, 1))
    return Segments(point, normal, d, d[:, 1], np.pi / d[:, 1], length, np.where(through, beyond, 1.0))


def test_a_hole_through_which_light_comes_is_a_portal():
    guide = learn_portals(_segments(20_000, 1, 200.0))
    assert guide is not None and 0 < len(guide.portal) <= MOST_PORTALS
    first = guide.portal[0].astype(np.float64)
    assert np.linalg.norm(first[PORTAL_CENTER : PORTAL_CENTER + 3] - HOLE) < 0.6 and first[PORTAL_RADIUS] < 0.6
    seen = guide.radiance[guide.radiance[:, OTHER_RADIANCE] > 0]
    assert seen[:, 0].mean() > 20 * seen[:, OTHER_RADIANCE].mean()
    left, error = moment_left(guide, _segments(20_000, 2, 200.0))
    assert left < 0.6 * MOST_LEFT_BY_PORTALS and error < 0.1


def test_even_light_has_no_portal_that_is_of_use():
    guide = learn_portals(_segments(20_000, 1, 1.0))
    assert guide is None or moment_left(guide, _segments(20_000, 2, 1.0))[0] > MOST_LEFT_BY_PORTALS
    dark = _segments(1_000, 3, 1.0)._replace(radiance=np.zeros(1_000))
    assert learn_portals(dark) is None
    assert guide is None or moment_left(guide, dark) == (1, 0)
    assert learn_portals(Segments(*(column[:0] for column in dark))) is None


def test_the_error_of_the_moment_left_is_that_of_repetitions():
    guide = learn_portals(_segments(20_000, 1, 200.0))
    assert guide is not None
    found = np.array([moment_left(guide, _segments(2_000, 10 + k, 200.0)) for k in range(40)])
    spread, error = found[:, 0].std(ddof=1), np.sqrt((found[:, 1] ** 2).mean())
    assert 0.6 * spread < error < 1.6 * spread


def test_a_scene_is_as_lit_as_segments_find_light():
    records = np.zeros((8, RECORD_COLUMNS), np.float32)
    records[:4, RECORD_SCALE], records[:1, RECORD_NEAR] = 2.0, 3.0
    records[4:, RECORD_NEAR] = 1.0  # the paths ended there
    assert lit_part(records) == 0.25 and lit_part(records[:0]) == 0
