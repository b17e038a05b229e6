"""Tests of the compressed tree for graphics cards, traversed on the CPU: it has bit-identical hits to the CPU's own tree."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from renderer.bvh.build import build
from renderer.bvh.compress import compressed
from renderer.bvh.compressed_tree import STACK_DEPTH
from renderer.bvh.hit import FACING, FROM_ORIGIN, SHADOW_REACH
from renderer.bvh.instances import Instances
from renderer.bvh.layout import Bvh
from renderer.bvh.motion_bvh import keyed_tree
from renderer.bvh.ray_masks import exclude_primitives
from renderer.bvh.traverse import any_hit, camera_root, closest_hit, new_stack, shadow_root
from renderer.jit import entry, subroutine
from renderer.reference import Packed, by_reference
from renderer.threads import Team
from tests.renderer.builders import kept
from tests.renderer.bvh.test_instances import forest
from tests.renderer.bvh.test_ray_masks import laid
from tests.renderer.bvh.test_traverse import directions, random_primitives

_ROOT = np.int32(0)


class Hits(NamedTuple):
    """The results of a traversal for n rays."""

    distance: np.ndarray  # (n, 3) f32: of the closest hit, of a camera ray's, of the hits in sequence along a shadow ray
    number: np.ndarray  # (n, 4) i32: primitives and instances of the first two
    uv: np.ndarray  # (n, 2) f32
    passed: np.ndarray  # (n,) i32: hits along a shadow ray, one after another
    occluded: np.ndarray  # (n,) bool


@subroutine
def _trace_all(bvh, stack, o, d, time, distance, number, uv, count, occluded):
    for i in range(len(o)):
        origin, direction = (o[i, 0], o[i, 1], o[i, 2]), (d[i, 0], d[i, 1], d[i, 2])
        hit = closest_hit(bvh, stack, origin, direction, np.float32(1e6), time[i], _ROOT, FROM_ORIGIN, FACING)
        distance[i, 0], number[i, 0], number[i, 1], uv[i, 0], uv[i, 1] = hit.t, hit.primitive, hit.instance, hit.u, hit.v
        hit = closest_hit(bvh, stack, origin, direction, np.float32(1e6), time[i], camera_root(bvh), FROM_ORIGIN, FACING)
        distance[i, 1], number[i, 2], number[i, 3] = hit.t, hit.primitive, hit.instance
        after = FROM_ORIGIN
        count[i] = 0
        total = np.float32(0.0)
        while True:  # as rays through surfaces that their alpha makes transparent
            hit = closest_hit(bvh, stack, origin, direction, SHADOW_REACH, time[i], shadow_root(bvh), after, None)
            if hit.primitive < 0 or count[i] > 1000:
                break
            after = hit.t, hit.instance, hit.primitive
            count[i] += 1
            total += hit.t * np.float32(hit.primitive + 1) + np.float32(hit.instance)
        distance[i, 2] = total
        occluded[i] = any_hit(bvh, stack, origin, direction, SHADOW_REACH, time[i], shadow_root(bvh))


@entry
def _trace(bvh, stack, o, d, time, distance, number, uv, count, occluded):
    _trace_all(by_reference(bvh), stack, o, d, time, distance, number, uv, count, occluded)


def card_tree(bvh: Bvh, threads: int = 1) -> Bvh:
    with Team(threads) as team:
        return compressed(kept(bvh), team)


def trace(bvh: Bvh, o: Any, d: Any, time: Any) -> Hits:
    d = np.array(d, np.float32, order="C")
    n = len(d)
    o = np.array(np.broadcast_to(o, (n, 3)), np.float32, order="C")
    hits = Hits(
        np.empty((n, 3), np.float32),
        np.empty((n, 4), np.int32),
        np.empty((n, 2), np.float32),
        np.empty(n, np.int32),
        np.empty(n, np.bool_),
    )
    _trace(Packed(bvh), new_stack(), o, d, np.array(np.broadcast_to(time, n), np.float32), *hits)
    return hits


def assert_same_hits(bvh: Bvh, o: Any, d: Any, time: Any = 0.5) -> Hits:
    """Asserts that the compressed and the ordinary tree return the same bits for the rays (o, d, time); returns the hits."""
    expected = trace(kept(bvh), o, d, time)
    found = trace(card_tree(bvh), o, d, time)
    for name, a, b in zip(Hits._fields, found, expected, strict=True):
        np.testing.assert_array_equal(a, b, err_msg=name)
    return expected


def rays(seed: int, count: int = 3000, spread: float = 1.5) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    return random.uniform(-spread, spread, (count, 3)).astype(np.float32), directions(random, count) * np.float32(3.0)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize(("triangles", "spheres"), [(0, 0), (1, 0), (0, 1), (7, 0), (9, 9), (2000, 300)])
def test_random_rays_have_equal_hits(triangles: int, spheres: int, scale: float) -> None:
    position, triangle, sphere = random_primitives(
        np.random.default_rng(triangles), triangles, spheres, 0.1 if triangles > 100 else 0.4
    )
    o, d = rays(1)
    scaled = np.float32(scale)
    hits = assert_same_hits(build(position * scaled, triangle, sphere * scaled), o * scaled, d * scaled)
    if triangles + spheres > 8:
        assert 0 < hits.occluded.mean() < 1
        assert hits.passed.max() > 2


def test_axis_parallel_rays_have_equal_hits() -> None:
    random = np.random.default_rng(8)
    position, triangle, sphere = random_primitives(random, 300, 60, 0.2)
    position = np.round(position * 8) / 8  # many planes that contain rays, and degenerate triangles
    o = np.round(random.uniform(-1.5, 1.5, (6000, 3)) * 8) / 8
    d = random.integers(-1, 2, (6000, 3)).astype(np.float32)
    for zero in (0.0, -0.0, 1e-30, -1e-42):
        tilted = np.where(d == 0, np.float32(zero), d)[d.any(1)]
        hits = assert_same_hits(build(position.astype(np.float32), triangle, sphere), o[d.any(1)], tilted)
        assert hits.occluded.any()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_rays_within_a_flat_grid_have_equal_hits(axis: int) -> None:
    side = np.arange(9) * 0.125 - 0.5
    u, v = (each.ravel() for each in np.meshgrid(side, side, indexing="ij"))
    position = np.insert(np.stack([u, v], 1), axis, 0.0, axis=1).astype(np.float32)
    i = (np.arange(8)[:, None] * 9 + np.arange(8)).ravel()
    triangle = np.concatenate([np.stack([i, i + 9, i + 10], 1), np.stack([i, i + 10, i + 1], 1)]).astype(np.int32)
    bvh = build(position, triangle, np.zeros((0, 4), np.float32))
    fine = np.arange(65) / 64 - 0.5
    a, b = (each.ravel() for each in np.meshgrid(fine, fine, indexing="ij"))
    for height, along in ((-2.0, np.insert(np.zeros(2), axis, 4.0)), (0.0, np.insert(np.array([0.0, 1.0]), axis, 0.0))):
        o = np.insert(np.stack([a, b], 1), axis, height, axis=1)
        hits = assert_same_hits(bvh, o, np.broadcast_to(along, o.shape))
        assert hits.occluded.all() == (height != 0.0)


def test_lowest_primitive_number_wins_at_equal_distance() -> None:
    """If several hits have the same distance, both trees return the one with the lowest primitive number.

    Each triangle occurs four times, each sphere three times, in random order.
    """
    random = np.random.default_rng(5)
    position, triangle, sphere = random_primitives(random, 60, 20, 0.4)
    triangle = triangle[random.permutation(np.repeat(np.arange(60), 4))]
    sphere = sphere[random.permutation(np.repeat(np.arange(20), 3))]
    hits = assert_same_hits(build(position, triangle, sphere), *rays(2))
    first = {tuple(corners): number for number, corners in reversed(list(enumerate(triangle.tolist())))}
    solid = (hits.number[:, 0] >= 0) & (hits.number[:, 0] < len(triangle))
    assert solid.sum() > 500
    assert all(first[tuple(triangle[number])] == number for number in hits.number[solid, 0])


@pytest.mark.parametrize("instances", [3, 60])
def test_instances_have_the_same_hits(instances: int) -> None:
    position, triangle, sphere, placed = forest(np.random.default_rng(3), instances)
    twice = Instances(placed.first, np.repeat(placed.tree, 2), np.repeat(placed.to_world, 2, axis=0))  # equal distances
    o, d = rays(4, spread=4.0)
    hits = assert_same_hits(build(position, triangle, sphere, twice), o, d)
    assert (hits.number[:, 1] >= 0).sum() > 100
    assert (hits.number[hits.number[:, 1] >= 0, 1] % 2 == 0).all()


def test_primitives_in_motion_have_the_same_hits() -> None:
    random = np.random.default_rng(6)
    position, triangle, sphere = random_primitives(random, 400, 80, 0.15)
    moved = position + random.normal(0, 0.3, (4, *position.shape)).astype(np.float32)
    spheres = np.abs(sphere + random.normal(0, 0.05, (4, *sphere.shape)).astype(np.float32))
    with Team(1) as team:
        node, packet = keyed_tree(moved, triangle, spheres, len(triangle), team)
    bvh = build(position, triangle, sphere)._replace(node=node, packet=packet, keyed_packets=np.array([0, 4], np.int32))
    times = random.random(3000).astype(np.float32)
    times[:4] = 0.0, 1.0, 1 / 3, 2 / 3
    assert assert_same_hits(bvh, *rays(7), times).occluded.any()


def test_rays_with_hidden_primitives_have_equal_hits() -> None:
    random = np.random.default_rng(9)
    position, triangle, sphere = random_primitives(random, 500, 50, 0.15)
    unseen, shadeless = random.random((2, 550)) < 0.3
    bvh = exclude_primitives(laid(build(position, triangle, sphere)), unseen, shadeless).bvh
    hits = assert_same_hits(bvh, *rays(10))
    seen = hits.number[:, 2] >= 0
    assert not unseen[hits.number[seen, 2]].any()
    assert (hits.number[:, 0] != hits.number[:, 2]).any()


@pytest.mark.parametrize("bad", [(np.nan, 0, 1), (0, 0, np.nan), (np.nan,) * 3, (np.inf, 0, 0), (0, 0, 0), (np.inf, -np.inf, 0)])
def test_invalid_ray_terminates(bad: tuple[float, float, float]) -> None:
    hits = trace(
        card_tree(build(*random_primitives(np.random.default_rng(9), 9, 9))), np.zeros(3), np.array([bad], np.float32), 0.5
    )
    assert not hits.occluded.any()


def test_the_tree_does_not_depend_on_the_number_of_threads() -> None:
    bvh = build(*random_primitives(np.random.default_rng(11), 100_000, 100, 0.01))
    one, three = card_tree(bvh, 1).compressed, card_tree(bvh, 3).compressed
    np.testing.assert_array_equal(one.node, three.node)
    np.testing.assert_array_equal(one.leaf.view(np.uint32), three.leaf.view(np.uint32))


@pytest.mark.parametrize("triangles", [10_000, 100_000])
def test_a_triangle_takes_at_most_120_bytes(triangles: int) -> None:
    side = int(np.sqrt(triangles / 2))
    u, v = np.meshgrid(np.linspace(-1, 1, side + 1), np.linspace(-1, 1, side + 1), indexing="ij")
    height = 0.2 * np.sin(9 * u) * np.cos(7 * v)
    position = np.stack([u, v, height], -1).reshape(-1, 3).astype(np.float32)
    i = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    surface = np.concatenate([np.stack([i, i + side + 1, i + side + 2], 1), np.stack([i, i + side + 2, i + 1], 1)])
    none = np.zeros((0, 4), np.float32)
    for bvh in (
        build(position, surface.astype(np.int32), none),
        build(*random_primitives(np.random.default_rng(12), triangles, 0, 0.02)),
    ):
        tree = card_tree(bvh).compressed
        assert tree.node.nbytes + tree.leaf.nbytes <= 120 * triangles
        assert len(tree.leaf) in (triangles, len(surface))


def test_the_stack_is_smaller_than_that_of_the_cpu() -> None:
    assert len(new_stack()) > 10 * 2 * STACK_DEPTH
