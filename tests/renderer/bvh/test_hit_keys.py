"""Tests of the integer keys that sort a node's children and find a packet's nearest hit: their order equals NumPy's."""

import numpy as np

from renderer.bvh.hit_keys import greater_ints, hit_keys, key_limit, keys_beyond, minimum_key, nearest
from renderer.bvh.simd import bits, less, load
from renderer.jit import entry

LANES = 8
ZERO = np.uintp(0)


@entry
def _visit(distances, limits, order, count):
    """Writes to order[i] the lanes whose distance is below the limit, nearest first, and to count[i] their number."""
    for i in range(len(distances)):
        distance = load(distances[i], ZERO)
        keys = hit_keys(less(distance, load(limits[i], ZERO)), distance)
        key = minimum_key(keys)
        while key <= key_limit(limits[i, 0]):
            order[i, count[i]] = key & (LANES - 1)
            count[i] += 1
            keys = keys_beyond(keys, key)
            key = minimum_key(keys)


@entry
def _nearest(distances, limits, found, lane):
    for i in range(len(distances)):
        distance = load(distances[i], ZERO)
        mask = less(distance, load(limits[i], ZERO))
        if bits(mask) != np.uint32(0):
            found[i], lane[i] = nearest(mask, distance)


@entry
def _exceed(numbers, number, found):
    for i in range(len(numbers)):
        found[i] = bits(greater_ints(load(numbers[i], ZERO), number[i]))


def rows(n, seed):
    """Returns two arrays (n, 8) float32: distances and limits of many magnitudes; some are equal, infinite or 0."""
    rng = np.random.default_rng(seed)
    distance = rng.uniform(0, 1, (n, LANES)) * 10.0 ** rng.integers(-6, 7, (n, 1))
    distance[rng.random((n, LANES)) < 0.1] = np.inf
    distance[rng.random((n, LANES)) < 0.1] = 0
    repeated = rng.random(n) < 0.2
    distance[repeated, 3] = distance[repeated, 6]
    limit = np.broadcast_to(distance[np.arange(n), rng.integers(0, LANES, n)][:, None], distance.shape)
    return np.ascontiguousarray(distance, np.float32), np.ascontiguousarray(limit, np.float32)


def test_children_are_visited_once_in_order_of_distance():
    distances, limits = rows(5000, 1)
    order, count = np.full((5000, LANES), -1), np.zeros(5000, np.int64)
    _visit(distances, limits, order, count)
    for distance, limit, lanes, n in zip(distances, limits, order, count, strict=True):
        visited = lanes[:n]
        assert sorted(visited) == list(np.flatnonzero(distance < limit[0]))
        coarse = distance[visited].view(np.int32) & -LANES  # a key stores the lane in the distance's last bits
        assert (np.diff(coarse) >= 0).all()


def test_nearest_hit_is_exact_and_first_among_equals():
    distances, limits = rows(5000, 2)
    distances[distances == 0] = 1e-30  # hits have positive distances
    found, lane = np.full(5000, -1.0, np.float32), np.full(5000, -1)
    _nearest(distances, limits, found, lane)
    hit = distances < limits
    expected = np.where(hit, distances, np.inf)
    some = hit.any(axis=1)
    assert some.mean() > 0.5
    np.testing.assert_array_equal(found[some], expected.min(axis=1)[some])
    np.testing.assert_array_equal(lane[some], expected.argmin(axis=1)[some])
    assert (lane[~some] == -1).all()


def test_keys_are_compared_as_integers():
    """Keys are compared as integers; half of the tested keys are NaN if read as floats."""
    rng = np.random.default_rng(1)
    numbers = rng.integers(-(2**31), 2**31, (1000, LANES)).astype(np.int32)
    number = rng.integers(-(2**31), 2**31, 1000).astype(np.int32)
    numbers[:, 2] = number
    found = np.zeros(1000, np.uint32)
    _exceed(numbers.view(np.float32), number, found)
    expected = np.packbits(numbers > number[:, None], axis=1, bitorder="little")[:, 0]
    assert np.array_equal(found, expected)
