"""Tests of dividing primitives among the cells of a grid, over which the top of a tree is built.

Each primitive is in one cell, for any number of threads.
"""

import numpy as np
import pytest

from renderer.bvh.boxes import numbered, numbers_of
from renderer.bvh.clusters import FEWEST, JOB, gathered, split_clusters
from renderer.threads import Team

COUNT = 20_000
SOLIDS = 19_000


@pytest.fixture(scope="module")
def boxes():
    """Returns the boxes (N, 8), in the format of boxes.py, of primitives in a flat region, and the bounds of their centroids
    times 2.
    """
    rng = np.random.default_rng(2)
    centre = rng.uniform(-1, 1, (COUNT, 3)) * (50, 2, 30)
    half = rng.uniform(0, 0.3, (COUNT, 3))
    box = np.zeros((COUNT, 8), np.float32)
    box[:, :3], box[:, 4:7] = half - centre, centre + half
    return numbered(box)


def doubled_centroids(box):
    centroid = box - np.roll(box, 4, axis=1)
    return centroid.max(axis=0)


def gathered_by_threads(threads, box):
    with Team(threads) as team:
        return gathered(box, np.arange(COUNT, dtype=np.int32), doubled_centroids(box), SOLIDS, team)


def test_each_primitive_is_in_one_cluster_with_a_tight_box(boxes):
    clusters = gathered_by_threads(1, boxes)
    assert sorted(clusters.source) == list(range(COUNT))
    assert 1000 < len(clusters.box) < COUNT
    ends = np.append(clusters.first[1:], COUNT)
    np.testing.assert_array_equal(clusters.first + clusters.count, ends)
    lanes = [0, 1, 2, 4, 5, 6]
    for c in range(0, len(clusters.box), 37):
        own = clusters.source[clusters.first[c] : ends[c]]
        np.testing.assert_array_equal(clusters.box[c, lanes], boxes[own][:, lanes].max(axis=0))
        assert clusters.weight[c] == (own < SOLIDS).sum() + 8 * (own >= SOLIDS).sum()
        assert (np.diff(own) > 0).all()


def test_clusters_do_not_depend_on_threads(boxes):
    one, three = gathered_by_threads(1, boxes), gathered_by_threads(3, boxes)
    for array, other in zip(one, three, strict=True):
        assert array.tobytes() == other.tobytes()


def test_parts_are_disjoint(boxes):
    clusters = gathered_by_threads(2, boxes)
    tree_box, tree = np.empty((2 * COUNT, 8), np.float32), np.full((2 * COUNT, 3), -2, np.int32)
    node = np.array([0, 0, COUNT, 1, 0, 0, len(clusters.box)])
    parts = split_clusters(clusters, node, doubled_centroids(clusters.box), 500, tree_box, tree)
    assert parts.shape[1] == JOB
    assert len(parts) > COUNT / 500
    number, first, count, rows, _, begin, end = parts[np.argsort(parts[:, 1])].T
    assert ((count <= 500) | (end - begin < FEWEST)).all()
    np.testing.assert_array_equal(first + count, np.append(first[1:], COUNT))
    of_cluster = numbers_of(clusters.box)
    assert sorted(of_cluster) == list(range(len(of_cluster)))
    for a, b, n in zip(begin, end, count, strict=True):
        assert clusters.count[of_cluster[a:b]].sum() == n
    above = np.flatnonzero(tree[:, 0] >= 0)
    taken = [*above, *number, *(row for r, n in zip(rows, count, strict=True) for row in range(r, r + 2 * n - 2))]
    assert len(taken) == len(set(taken)) == 2 * COUNT - 1
