"""Tests of trees assembled from separately built trees: they have the same hits as one tree built over all primitives.

This holds for any order of the primitives in the arrays.
"""

import numpy as np
import pytest

from renderer.bvh.build import build, tree_of
from renderer.bvh.instances import Instances
from renderer.bvh.layout import NODE_ROWS, PACKET_ROWS, PAGE, ROW_CHILD, WIDTH
from renderer.bvh.subtrees import assemble_bvh
from renderer.threads import Team
from tests.renderer.bvh.rays import NO_SPHERES, trace
from tests.renderer.bvh.test_instances import directions, forest

NOTHING = np.zeros((0, NODE_ROWS, WIDTH), np.float32), np.zeros((0, PACKET_ROWS, WIDTH), np.float32)


def parted(brute=False, loose=True):
    """Returns the geometry of `forest` as one tree assembled from parts, and the map between the primitives' numbers.

    The first tree's instances are static, the second's move. loose: whether 12 world triangles and 4 spheres form a separate
    part.
    """
    rng = np.random.default_rng(11)
    position, triangle, sphere, every = forest(rng)
    order = np.argsort(every.tree, kind="stable")
    every = Instances(every.first, every.tree[order], every.to_world[order])
    of_still = every.tree == 0
    cut = 18 if loose else 30
    # Primitives in the order of the parts: static world triangles, the trees, the loose triangles.
    numbers = np.concatenate([np.arange(cut), np.arange(30, 130), np.arange(cut, 30)])
    triangle = triangle[numbers]
    first_body, first_loose = cut + 70, cut + 100
    spheres = 5 if loose else 9
    standing = Instances(np.array([cut, first_body]), every.tree[of_still], every.to_world[of_still])
    still = build(position, triangle[:first_body], sphere[:spheres], standing, first_sphere=130)
    body = tree_of(position, triangle[first_body:first_loose])
    rest = build(position, triangle[first_loose:], sphere[spheres:], first_sphere=130 + spheres - first_loose)
    lax = (rest.node, rest.packet) if loose else NOTHING
    shown = np.zeros(np.count_nonzero(~of_still), int)
    with Team(1) as team:
        laid = assemble_bvh(still, [body], [first_body], lax, first_loose, shown, every.to_world, team, brute)
    whole = build(position, triangle[np.argsort(numbers)], sphere, every, brute)
    return laid, whole, np.concatenate([numbers, np.arange(130, 139), [-1]])


@pytest.mark.parametrize("brute", [False, True])
@pytest.mark.parametrize("loose", [False, True])
def test_assembled_tree_has_the_hits_of_one_tree(brute, loose):
    laid, whole, numbers = parted(brute, loose)
    rng = np.random.default_rng(12)
    o, d = rng.uniform(-4, 4, (3000, 3)).astype(np.float32), directions(rng, 3000)
    ours, theirs = trace(laid.bvh, o, d), trace(whole, o, d)
    np.testing.assert_array_equal(ours.t, theirs.t)
    np.testing.assert_array_equal(numbers[ours.primitive], theirs.primitive)
    np.testing.assert_array_equal(ours.instance, theirs.instance)
    np.testing.assert_array_equal(ours.shadow, theirs.shadow)
    assert len(np.unique(theirs.primitive)) > 100


def test_parts_start_at_pages_and_do_not_depend_on_motion():
    laid, *_ = parted()
    for starts, array in ((laid.node, laid.bvh.node), (laid.packet, laid.bvh.packet)):
        assert starts[-1] == len(array)
        assert all(start * array[0].nbytes % PAGE == 0 for start in starts[:-1])
    rng = np.random.default_rng(13)
    position, triangle, *_ = forest(rng)
    still, body = build(position, triangle[:100], NO_SPHERES), tree_of(position, triangle[100:])
    found = []
    for count in (1, 40):
        places = np.tile(np.eye(4)[:3], (count, 1, 1)) + np.arange(count)[:, None, None]
        with Team(1) as team:
            found.append(assemble_bvh(still, [body], [100], NOTHING, 130, np.zeros(count, int), places, team))
    one, many = found
    assert one.node == many.node
    np.testing.assert_array_equal(one.bvh.node[one.node[1] :], many.bvh.node[one.node[1] :])
    np.testing.assert_array_equal(one.bvh.packet, many.bvh.packet)
    assert (one.bvh.node[: one.node[1], ROW_CHILD] != many.bvh.node[: one.node[1], ROW_CHILD]).any()


def test_scene_may_consist_of_moving_parts_only():
    rng = np.random.default_rng(14)
    position, triangle, *_ = forest(rng)
    empty = build(position[:0], triangle[:0], NO_SPHERES)
    empty = empty._replace(node=empty.node[:0])
    with Team(1) as team:
        laid = assemble_bvh(empty, [tree_of(position, triangle)], [0], NOTHING, 130, np.zeros(1, int), np.eye(4)[None, :3], team)
    o, d = rng.uniform(-4, 4, (1000, 3)).astype(np.float32), directions(rng, 1000)
    ours, theirs = trace(laid.bvh, o, d), trace(build(position, triangle, NO_SPHERES), o, d)
    np.testing.assert_array_equal(ours.primitive, theirs.primitive)
    np.testing.assert_array_equal(ours.t, theirs.t)
