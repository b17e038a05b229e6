"""Tests of segments of round curves: where rays hit them, against float64, and that rays from inside leave them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from renderer.bvh.build import build
from renderer.bvh.compress import compressed
from renderer.bvh.curve_ends import segment_ends
from renderer.bvh.layout import CURVES, LEAF_KIND, ROW_CHILD, ROW_PRIMITIVE, Bvh
from renderer.bvh.motion_bvh import keyed_tree
from renderer.bvh.traverse import any_hit, closest_hit, new_stack
from renderer.jit import entry
from renderer.threads import Team


def chain(strands: int, points: int) -> np.ndarray:
    """Returns the segments of curves as triangles (a, b, b)."""
    first = (np.arange(strands)[:, None] * points + np.arange(points - 1)).reshape(-1)
    return np.stack([first, first + 1, first + 1], axis=1).astype(np.int32)


def grown(strands: int = 300, points: int = 7) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the positions, triangles and radii of strands that bend at random and become thinner."""
    random = np.random.default_rng(1)
    root, steps = random.uniform(-1, 1, (strands, 1, 3)), random.normal(0, 0.05, (strands, points, 3))
    radius = (0.004 + 0.01 * random.random((strands, 1))) * np.linspace(1, 0.3, points)
    positions = (root + np.cumsum(steps, axis=1)).reshape(-1, 3)
    return positions.astype(np.float32), chain(strands, points), radius.reshape(-1).astype(np.float32)


@entry
def _trace(bvh, stack, o, d, found, number):
    for i in range(len(o)):
        origin, direction = (o[i, 0], o[i, 1], o[i, 2]), (d[i, 0], d[i, 1], d[i, 2])
        hit = closest_hit(bvh, stack, origin, direction, np.float32(np.inf))
        found[i, 0], found[i, 1], found[i, 2], number[i, 0] = hit.t, hit.u, hit.v, hit.primitive
        number[i, 1] = any_hit(bvh, stack, origin, direction, np.float32(100.0))


def trace(bvh: Bvh, o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns (distance, u and v; primitive, whether anything is hit) of rays."""
    o, d = (np.array(np.broadcast_to(each, d.shape), np.float32, order="C") for each in (o, d))
    found, number = np.zeros((len(d), 3), np.float32), np.zeros((len(d), 2), np.int32)
    _trace(bvh._replace(curves=True), new_stack(), o, d, found, number)
    return found, number


@cache
def rays(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns origins on a sphere of radius 3, and directions into it, in float32: nearly unit."""
    random = np.random.default_rng(2)
    o = random.normal(size=(count, 3))
    o *= 3 / np.linalg.norm(o, axis=1, keepdims=True)
    d = random.uniform(-0.8, 0.8, (count, 3)) - o
    return o.astype(np.float32), (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)


def first_entry(position: np.ndarray, triangle: np.ndarray, radius: np.ndarray, o: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Returns the distance at which a ray enters each cone with spheres at its joints, inf where it misses.

    In float64, after Quilez.
    """
    o, scale = o.astype(float), np.linalg.norm(d.astype(float))
    d = d / scale
    a, b = position[triangle[:, 0]].astype(float), position[triangle[:, 1]].astype(float)
    ra, rb = radius[triangle[:, 0]].astype(float), radius[triangle[:, 1]].astype(float)
    axis, from_a, from_b, taper = b - a, o - a, o - b, ra - rb
    m0, m1, m2, m3, m5 = (axis**2).sum(1), (axis * from_a).sum(1), axis @ d, from_a @ d, (from_a**2).sum(1)
    d2 = m0 - taper**2
    k2, k1 = d2 - m2**2, d2 * m3 - m1 * m2 + m2 * taper * ra
    k0 = d2 * m5 - m1**2 + 2 * m1 * taper * ra - m0 * ra**2
    with np.errstate(invalid="ignore"):
        t = (-np.sqrt(k1**2 - k0 * k2) - k1) / k2
        y = m1 - ra * taper + t * m2
        ends = [-f @ d - np.sqrt((f @ d) ** 2 - (f**2).sum(1) + r * r) for f, r in ((from_a, ra), (from_b, rb))]
    loose = segment_ends(position, triangle[:, :2], radius)[:, :2] < 0
    first_end = np.argmin(np.where(np.isnan(ends), np.inf, ends), axis=0)
    at_end = np.where(np.take_along_axis(loose, first_end[:, None], axis=1)[:, 0], np.inf, np.fmin(*ends))
    t = np.where((y > 0) & (y < d2), t, at_end)
    return np.where(t > 0, t / scale, np.inf)


def test_loose_ends_and_bends():
    """Radii at loose ends are negative; the reach is the axis' length times the sine of the bend, or whole at sharp bends."""
    position = np.array([(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 2, 0), (1, 2.1, 0), (2, 2.1, 0), (9, 9, 9), (9, 9, 7)], np.float32)
    segment = np.array([(0, 1), (1, 2), (2, 3), (3, 4), (6, 7)])
    found = segment_ends(position, segment, np.full(8, 0.1, np.float32))
    assert np.sign(found[:, :2]).tolist() == [[-1, 1], [1, 1], [1, 1], [1, -1], [-1, -1]]
    np.testing.assert_allclose(np.abs(found[:, :2]), 0.1)
    np.testing.assert_allclose(found[:, 2], [1 / 64, 1 + 1 / 64, 2 * (1 + 1 / 64), 1.005 * (1 / 1.005 + 1 / 64), 0], rtol=1e-2)


def test_trees_have_curves_beside_other_shapes():
    """Leaves are of one kind, and contain every triangle, segment and sphere by its number, at its place and with its keys."""
    position, triangle, radius = grown(60)
    flat = np.array([(0, 20, 41), (5, 80, 99)], np.int32)
    mixed = np.concatenate([triangle[:50], flat, triangle[50:]])
    sphere = np.array([(0, 0, 0, 0.3), (1, 0, 0, 0.1)], np.float32)
    keys = np.stack([position, position + np.float32(0.5)])
    still = build(position, mixed, sphere, radius=radius)
    moving = keyed_tree(keys, mixed, np.stack([sphere, sphere]), len(mixed), Team(1), radius)
    for node, packet in ((still.node, still.packet), moving):
        child = node[:, ROW_CHILD].view(np.int32)
        leaf = np.unique(~child[(child < 0) & (node[:, 0] <= node[:, 1])])
        seen = []
        for first, kind in zip(leaf >> 2, leaf & LEAF_KIND, strict=True):
            lanes = ~np.isnan(packet[first, 0])
            number = packet[first, ROW_PRIMITIVE].view(np.int32)[lanes]
            seen += number.tolist()
            assert (kind == CURVES) == (number[0] < len(mixed) and mixed[number[0], 1] == mixed[number[0], 2])
            if kind == CURVES:
                for version in range(len(packet) // len(still.packet)):
                    ends = segment_ends(keys[version], mixed[number, :2], radius)
                    corners = keys[version][mixed[number, :2]].reshape(-1, 6)
                    np.testing.assert_array_equal(packet[first + version, :6].T[lanes], corners)
                    np.testing.assert_array_equal(np.abs(packet[first + version, 6:8].T[lanes]), np.abs(ends[:, :2]))
        assert sorted(seen) == list(range(len(mixed) + 2))


@pytest.mark.long
def test_hits_agree_with_float64():
    """Rays hit the nearest segment at its distance, in all trees alike; only rays that graze may differ, one in a hundred."""
    position, triangle, radius = grown()
    tree, (o, d) = build(position, triangle, np.zeros((0, 4), np.float32), radius=radius), rays(3000)
    found, number = trace(tree, o, d)
    with Team(1) as team:
        others = [compressed(tree, team), build(position, triangle, np.zeros((0, 4), np.float32), brute=True, radius=radius)]
    for other in others:
        for ours, theirs in zip((found, number), trace(other, o, d), strict=True):
            np.testing.assert_array_equal(ours, theirs)
    expected = np.array([first_entry(position, triangle, radius, *ray) for ray in zip(o, d, strict=True)])
    nearest = expected.min(axis=1)
    hit = np.isfinite(nearest)
    assert 0.1 < hit.mean() < 0.9
    assert ((number[:, 0] >= 0) == hit).mean() > 0.99 and ((number[:, 1] != 0) == hit).mean() > 0.99
    both = hit & (number[:, 0] >= 0)
    assert (number[both, 0] == expected[both].argmin(axis=1)).mean() > 0.99
    assert np.median(np.abs(found[both, 0] - nearest[both])) < 1e-6
    # The point of the axis, and the distance of the ray's point from it.
    a, b = (triangle[number[both, 0], k] for k in (0, 1))
    along, offset = found[both, 1] + found[both, 2], found[both, 1] - found[both, 2]
    centre = position[a] + along[:, None] * (position[b] - position[a])
    here = radius[a] + along * (radius[b] - radius[a])
    out = o[both] + found[both, :1] * d[both] - centre
    np.testing.assert_allclose(np.linalg.norm(out, axis=1) / here, 1, atol=2e-3)
    side = np.cross(d[both], position[b] - position[a])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    np.testing.assert_allclose((out * side).sum(axis=1) / here, offset, atol=2e-3)


@pytest.mark.long
def test_projected_area_of_a_strand():
    """Parallel rays across a strand of many segments hit its width times its length: its ends are open."""
    points, r = 33, 0.02
    position = np.column_stack([np.linspace(-1, 1, points), np.zeros((points, 2))]).astype(np.float32)
    tree = build(position, chain(1, points), np.zeros((0, 4), np.float32), radius=np.full(points, r, np.float32))
    x, y = np.meshgrid((np.arange(1100) + 0.5) / 500 - 1.1, (np.arange(600) + 0.5) / 10_000 - 0.03)
    _, number = trace(tree, np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 5)]), np.tile((0.0, 0.0, -1.0), (x.size, 1)))
    area = (number[:, 0] >= 0).mean() * 2.2 * 0.06
    assert area == pytest.approx(2 * 2 * r, rel=2e-3)


@pytest.mark.long
def test_rays_from_inside_leave_a_strand():
    """At most 2 % of the rays that start inside a bent strand hit it again, at a joint or another segment."""
    points, r, random = 25, 0.02, np.random.default_rng(3)
    turn = np.linspace(0, 1.5, points)
    position = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn]).astype(np.float32)
    tree = build(position, chain(1, points), np.zeros((0, 4), np.float32), radius=np.full(points, r, np.float32))
    at = random.uniform(0.2, 1.3, 20000)
    d = random.normal(size=(len(at), 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    d[:, 2] = np.copysign(np.maximum(np.abs(d[:, 2]), 0.05), d[:, 2])  # leaves the plane of the strand: enters it nowhere again
    inside = random.normal(size=(len(at), 3))
    inside *= 0.9 * r / np.linalg.norm(inside, axis=1, keepdims=True) * random.random((len(at), 1)) ** (1 / 3)
    _, number = trace(tree, np.column_stack([np.cos(at), np.sin(at), 0 * at]) + inside, d)
    assert (number[:, 0] >= 0).mean() < 0.02


@pytest.mark.long
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_shadow_rays_to_an_infinite_distance(scale):
    """Rays whose direction has a length of 1e18 hit what those of unit length hit, whether they start outside or inside."""
    position, triangle, radius = grown()
    tree = build(position * np.float32(scale), triangle, np.zeros((0, 4), np.float32), radius=radius * np.float32(scale))
    o, d = rays(3000)
    centre = (position[triangle[:, 0]] + position[triangle[:, 1]]) / 2
    for start in (o, centre[np.arange(3000) % len(centre)]):
        unit, far = (trace(tree, start * np.float32(scale), d * np.float32(length))[1] for length in (1, 1e18))
        assert 0.01 < (unit[:, 0] >= 0).mean() < 0.9
        assert (unit[:, 0] == far[:, 0]).mean() > 0.999
        assert ((unit[:, 0] >= 0) == (far[:, 1] != 0)).mean() > 0.999
