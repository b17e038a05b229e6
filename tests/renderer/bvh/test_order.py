"""Tests of the order in which all hits along a ray are found: by distance, then by instance, then by primitive.

Each hit is found once, also among coincident primitives.
"""

from __future__ import annotations

import numpy as np
import pytest

from renderer.bvh.build import build
from renderer.bvh.instances import Instances
from renderer.bvh.layout import Bvh
from renderer.bvh.traverse import FROM_ORIGIN, NO_PRIMITIVE, closest_hit, new_stack
from renderer.jit import entry, subroutine
from renderer.reference import Packed, by_reference
from tests.renderer.builders import still
from tests.renderer.bvh.rays import NO_SPHERES, trace
from tests.renderer.kernel.backends.cpu.test_walk import closest_together

MOST = 64
RAYS = 300


@subroutine
def _walk_all(bvh, stack, o, d, found):
    """Writes each ray's hits to `found` in the order in which they are found.

    found: (rays, MOST, 3) float64: distance, instance and primitive of each hit.
    """
    for i in range(len(o)):
        after = FROM_ORIGIN
        for k in range(found.shape[1]):
            origin, direction = (o[i, 0], o[i, 1], o[i, 2]), (d[i, 0], d[i, 1], d[i, 2])
            hit = closest_hit(bvh, stack, origin, direction, np.float32(np.inf), None, np.int32(0), after)
            if hit.primitive == NO_PRIMITIVE:
                break
            after = hit.t, hit.instance, hit.primitive
            found[i, k, 0], found[i, k, 1], found[i, k, 2] = hit.t, hit.instance, hit.primitive


@entry
def _walk(bvh, stack, o, d, found):
    _walk_all(by_reference(bvh), stack, o, d, found)


def _hits(bvh: Bvh, o: np.ndarray, d: np.ndarray) -> np.ndarray:
    found = np.full((len(o), MOST, 3), np.nan)
    _walk(Packed(still(bvh)), new_stack(), o, d, found)
    return found


def _layers(count: int, rng: np.random.Generator, gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns (vertices, triangles) of `count` parallel squares in oblique planes with distance `gap`; 0: in one plane.

    Each square is split along either diagonal, and faces either side.
    """
    position, triangle = [], []
    turn = np.linalg.qr(np.array([(1.0, 2.0, 3.0), (-2.0, 1.0, 0.5), (0.3, -1.0, 2.0)]))[0]
    for k in range(count):
        size = 1.0 if k % 2 else rng.uniform(0.9, 1.1)
        z = gap * k
        square = np.array([(-size, -size, z), (size, -size, z), (size, size, z), (-size, size, z)])
        cut = np.array([(0, 1, 2), (0, 2, 3)] if rng.random() < 0.5 else [(0, 1, 3), (1, 2, 3)])
        triangle.append((cut[:, ::-1] if rng.random() < 0.3 else cut) + 4 * k)
        position.append(square @ turn.T + (30.0, -20.0, 10.0))
    return np.concatenate(position).astype(np.float32), np.concatenate(triangle).astype(np.int32)


def _rays(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    target = np.array((30.0, -20.0, 10.0)) + rng.uniform(-0.4, 0.4, (RAYS, 3))
    away = rng.normal(size=(RAYS, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    return (target + 3 * away).astype(np.float32), (-away).astype(np.float32)


def _each_alone(position: np.ndarray, triangle: np.ndarray, o: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Returns hit distances (rays, triangles), each computed with a tree of one triangle; NaN for a miss."""
    found = []
    for one in triangle:
        hit = trace(build(position, one[None], NO_SPHERES), o, d)
        found.append(np.where(hit.primitive >= 0, hit.t, np.nan))
    return np.column_stack(found)


@pytest.mark.parametrize("gap", [0.0, 1e-6, 0.01])
def test_ray_hits_each_surface_once_in_order(gap: float) -> None:
    rng = np.random.default_rng(11)
    position, triangle = _layers(20, rng, gap)
    o, d = _rays(rng)
    alone, walked = _each_alone(position, triangle, o, d), _hits(build(position, triangle, NO_SPHERES), o, d)
    assert (~np.isnan(alone)).sum() > 10 * RAYS
    for t, seen in zip(alone, walked, strict=True):
        hit = np.flatnonzero(~np.isnan(t))
        order = hit[np.lexsort((hit, t[hit]))]
        there = ~np.isnan(seen[:, 0])
        np.testing.assert_array_equal(seen[there, 2], order)
        np.testing.assert_array_equal(seen[there, 0], t[order])


def test_coincident_instances_are_hit_in_number_order() -> None:
    rng = np.random.default_rng(12)
    position, triangle = _layers(2, rng, 0.0)
    o, d = _rays(rng)
    places = np.repeat(np.eye(4)[None, :3], 5, axis=0)
    instances = Instances(np.array([len(triangle), 2 * len(triangle)]), np.zeros(5, np.int64), places)
    whole = np.concatenate([triangle, triangle])  # once as world triangles, once in the tree that the instances share
    bvh = build(position, whole, NO_SPHERES, instances)
    alone, walked = _hits(build(position, triangle, NO_SPHERES), o, d), _hits(bvh, o, d)
    for one, seen in zip(alone, walked, strict=True):
        there = ~np.isnan(one[:, 0])
        assert (~np.isnan(seen[:, 0])).sum() == 6 * there.sum()
        expected = sorted(
            (t, instance, primitive + (len(triangle) if instance >= 0 else 0))
            for t, _, primitive in one[there]
            for instance in range(-1, 5)
        )
        np.testing.assert_array_equal(seen[~np.isnan(seen[:, 0])], np.array(expected).reshape(-1, 3))


def test_spheres_are_hit_twice_even_if_coincident() -> None:
    rng = np.random.default_rng(13)
    o, d = _rays(rng)
    sphere = np.array([(30, -20, 10, 1.0), (30, -20, 10, 1.0), (30, -20, 10, 0.5)], np.float32)
    empty = np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)
    walked = _hits(build(*empty, sphere), o, d)
    oc = o.astype(np.float64) - (30, -20, 10)
    b = (oc * d).sum(axis=1)
    for radius, numbers in ((1.0, {0, 1}), (0.5, {2})):
        crossed = b * b - (oc * oc).sum(axis=1) + radius**2 > 1e-6
        for number in numbers:
            assert ((walked[crossed, :, 2] == number).sum(axis=1) == 2).all()
    distances = walked[:, :, 0]
    assert not (np.diff(distances, axis=1) < 0).any()


def test_grouped_rays_break_ties_like_single_rays() -> None:
    rng = np.random.default_rng(14)
    position, triangle = _layers(1, rng, 0.0)
    copies = np.concatenate([triangle] * 40)
    o, d = _rays(rng)
    bvh = build(position, copies, NO_SPHERES)
    alone, together = trace(bvh, o, d), closest_together(still(bvh), o, d)
    hit = alone.primitive >= 0
    assert hit.mean() > 0.5
    assert (alone.primitive[hit] < len(triangle)).all()
    np.testing.assert_array_equal(together.primitive, alone.primitive)
