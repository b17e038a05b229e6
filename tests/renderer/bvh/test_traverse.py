"""Tests of traversal: against brute force, against NumPy, and for rays through edges and vertices."""

import numpy as np
import pytest

from renderer.bvh.build import build
from renderer.bvh.traverse import NO_PRIMITIVE
from tests.renderer.builders import box, icosphere
from tests.renderer.bvh.rays import NO_SPHERES, spheres_by_numpy, trace, triangles_by_numpy, without_a_tree

EPSILON = 2.0**-24
FACING = 2.0**-20  # relative bias of hit distances: front faces are nearer, back faces farther (renderer/bvh/packet.py)
AT_ORIGIN = 2.0**-22  # the same bias, relative to the origin's largest coordinate


def directions(rng, n):
    d = rng.standard_normal((n, 3))
    return (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)


def random_primitives(rng, triangles, spheres, size=0.3):
    center = rng.uniform(-1, 1, (triangles, 1, 3))
    position = (center + size * rng.standard_normal((triangles, 3, 3))).reshape(-1, 3).astype(np.float32)
    triangle = np.arange(3 * triangles, dtype=np.int32).reshape(-1, 3)
    sphere = np.column_stack([rng.uniform(-1, 1, (spheres, 3)), size * rng.uniform(0.1, 1, spheres)]).astype(np.float32)
    return position, triangle, sphere


def assert_same(found, expected):
    np.testing.assert_array_equal(found.t, expected.t)
    np.testing.assert_array_equal(found.shadow, expected.shadow)
    other = found.primitive != expected.primitive  # of two hits at the same distance either may be returned
    assert not (found.primitive[other] < 0).any()
    same = ~other
    np.testing.assert_array_equal(found.uv[same], expected.uv[same])
    assert other.mean() < 0.01


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize(("triangles", "spheres"), [(1, 0), (0, 1), (7, 0), (9, 9), (300, 60), (0, 100), (500, 0)])
def test_tree_hits_equal_brute_force(triangles, spheres, scale):
    rng = np.random.default_rng(triangles + 7 * spheres)
    position, triangle, sphere = random_primitives(rng, triangles, spheres, 0.3 if triangles + spheres < 100 else 0.1)
    position *= np.float32(scale)
    sphere *= np.float32(scale)
    o = (rng.uniform(-1.5, 1.5, (3000, 3)) * scale).astype(np.float32)
    d = directions(rng, 3000)
    found = trace(build(position, triangle, sphere), o, d)
    assert_same(found, without_a_tree(position, triangle, sphere, o, d))
    assert (found.shadow == (found.primitive != NO_PRIMITIVE)).all()
    assert 0 < found.shadow.mean() < 1


def test_hits_are_those_of_double_precision():
    rng = np.random.default_rng(3)
    position, triangle, sphere = random_primitives(rng, 200, 40, 0.2)
    o = rng.uniform(-1.5, 1.5, (4000, 3)).astype(np.float32)
    d = directions(rng, 4000)
    found = trace(build(position, triangle, sphere), o, d)
    balls = spheres_by_numpy(sphere, o, d)
    sure = np.concatenate([triangles_by_numpy(position, triangle, o, d, -1e-3), balls], axis=1)
    possible = np.concatenate([triangles_by_numpy(position, triangle, o, d, 1e-3), balls], axis=1)
    assert (found.t <= sure.min(1) * (1 + 1e-4) + 1e-6).all()
    assert (found.t >= possible.min(1) * (1 - 1e-4) - 1e-6).all()
    hit = found.primitive >= 0
    at = possible[np.flatnonzero(hit), found.primitive[hit]]  # the reported primitive is hit at the reported distance
    assert np.isfinite(at).all()
    np.testing.assert_allclose(found.t[hit], at, rtol=1e-3, atol=1e-5)
    # Barycentric coordinates reproduce the hit point on the triangle.
    on = hit & (found.primitive < 200)
    a, b, c = (position[triangle[found.primitive[on], k]] for k in range(3))
    u, v = found.uv[on, :1], found.uv[on, 1:]
    np.testing.assert_allclose((1 - u - v) * a + u * b + v * c, o[on] + found.t[on, None] * d[on], atol=2e-4)


def test_t_max_ends_a_ray():
    rng = np.random.default_rng(4)
    position, triangle, sphere = random_primitives(rng, 100, 20)
    bvh = build(position, triangle, sphere)
    o, d = rng.uniform(-1.5, 1.5, (2000, 3)), directions(rng, 2000)
    full = trace(bvh, o, d)
    hit = full.primitive >= 0
    margin = 2 * (FACING * full.t[hit] + AT_ORIGIN * np.abs(o[hit]).max(axis=1))
    beyond = trace(bvh, o[hit], d[hit], full.t[hit] + margin)
    np.testing.assert_array_equal(beyond.t, full.t[hit])
    assert beyond.shadow.all()
    short = trace(bvh, o[hit], d[hit], full.t[hit] - margin)
    assert not short.shadow.any()
    assert (short.primitive == NO_PRIMITIVE).all()


def test_hits_do_not_depend_on_direction_length():
    rng = np.random.default_rng(5)
    position, triangle, sphere = random_primitives(rng, 100, 20)
    bvh = build(position, triangle, sphere)
    o, d = rng.uniform(-1.5, 1.5, (2000, 3)), directions(rng, 2000)
    unit, long = trace(bvh, o, d), trace(bvh, o, d * np.float32(1024))
    np.testing.assert_array_equal(unit.primitive, long.primitive)
    np.testing.assert_allclose(unit.t, long.t * 1024, rtol=1e-6)


CLOSED = {"icosphere": icosphere(3), "box": box(0)}


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("name", ["icosphere", "box"])
def test_no_ray_leaves_a_closed_mesh(name, scale):
    """Rays from inside hit a closed mesh, also if aimed exactly at vertices, edge points or triangle centres."""
    rng = np.random.default_rng(6)
    position = (CLOSED[name].positions * scale).astype(np.float32)
    triangle = CLOSED[name].triangles
    bvh = build(position, triangle, NO_SPHERES)
    corners = position[triangle]
    edges = np.concatenate([corners + f * (np.roll(corners, 1, axis=1) - corners) for f in (0.25, 0.5, 0.9)]).reshape(-1, 3)
    targets = np.concatenate([position, edges, corners.mean(1)])
    for origin in (np.zeros(3), np.array((0.1, 0.2, 0.3)) * scale, np.array((0.5, 0, 0)) * scale):
        aimed = targets - origin.astype(np.float32)
        for d in (aimed, aimed / np.linalg.norm(aimed, axis=1, keepdims=True), directions(rng, 20000)):
            hits = trace(bvh, origin, d)
            assert hits.shadow.all()
            assert (hits.primitive >= 0).all()


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_axis_aligned_rays_hit_grid_edges_and_vertices(axis, scale):
    """Rays along an axis hit a flat grid, whose boxes have no thickness, in every lattice point."""
    side = np.arange(9) * 0.125 - 0.5
    u, v = np.meshgrid(side, side, indexing="ij")
    position = np.zeros((81, 3))
    others = [k for k in range(3) if k != axis]
    position[:, others[0]], position[:, others[1]] = u.ravel(), v.ravel()
    position = (position * scale).astype(np.float32)
    i = (np.arange(8)[:, None] * 9 + np.arange(8)).ravel()
    triangle = np.concatenate([np.stack([i, i + 9, i + 10], 1), np.stack([i, i + 10, i + 1], 1)]).astype(np.int32)
    bvh = build(position, triangle, NO_SPHERES)
    fine = np.arange(129) / 128 - 0.5  # vertices, edges, diagonals and interiors
    o = np.zeros((129, 129, 3))
    o[..., others[0]], o[..., others[1]] = np.meshgrid(fine, fine, indexing="ij")
    for sign in (1.0, -1.0):
        o[..., axis] = -2 * sign
        d = np.zeros(3)
        d[axis] = sign
        hits = trace(bvh, (o * scale).reshape(-1, 3), np.broadcast_to(d, (129 * 129, 3)))
        assert hits.shadow.all()
        np.testing.assert_allclose(hits.t, np.float32(2 * scale), rtol=FACING + AT_ORIGIN + 4 * EPSILON)
        for zero in (-0.0, 1e-30, -1e-42):  # components that are almost zero
            tilted = np.full(3, zero)
            tilted[axis] = sign
            inside = (np.abs(o[..., others]) < 0.5).all(-1).ravel()
            assert trace(bvh, (o * scale).reshape(-1, 3), np.broadcast_to(tilted, (129 * 129, 3))).shadow[inside].all()


def test_rays_in_box_planes_terminate_without_edge_on_hits():
    position = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], np.float32)
    bvh = build(position, np.array([(0, 1, 2), (1, 3, 2)], np.int32), NO_SPHERES)
    o = np.array([(-1, 0.25, 0), (-1, 0, 0), (0.25, -1, 0), (2, 0.5, 0)], np.float32)
    d = np.array([(1, 0, 0), (1, 0, 0), (0, 1, 0), (-1, 0, 0)], np.float32)
    assert not trace(bvh, o, d).shadow.any()


@pytest.mark.parametrize("zero", [0.0, -0.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_ray_in_the_plane_of_a_box_face_hits_the_triangle(side, zero):
    position = np.array([(0, 0, 0), (0, 1, 0.5), (side, 0.5, 0.25)], np.float32)
    bvh = build(position, np.array([(0, 1, 2)], np.int32), NO_SPHERES)
    hits = trace(bvh, np.array([(zero, 0.5, -1), (-zero, 0.5, -1)], np.float32), np.array([(zero, 0, 1)] * 2, np.float32))
    assert hits.shadow.all()
    np.testing.assert_allclose(hits.t, 1.25, rtol=1e-5)


def test_axis_parallel_rays_match_brute_force():
    rng = np.random.default_rng(8)
    position, triangle, sphere = random_primitives(rng, 200, 40, 0.2)
    o = np.round(rng.uniform(-1.5, 1.5, (6000, 3)) * 4) / 4
    d = rng.integers(-1, 2, (6000, 3)).astype(np.float32)
    keep = d.any(1)
    assert_same(
        trace(build(position, triangle, sphere), o[keep], d[keep]), without_a_tree(position, triangle, sphere, o[keep], d[keep])
    )


@pytest.mark.parametrize(
    "bad", [(np.nan, 0, 1), (0, 0, np.nan), (np.nan,) * 3, (np.inf, 0, 0), (0, 0, 0), (np.inf, -np.inf, np.nan)]
)
def test_invalid_ray_hits_nothing(bad):
    """Invalid rays (zero or not finite) hit nothing and do not overrun the stack, in a tree whose nodes have empty lanes."""
    bvh = build(*random_primitives(np.random.default_rng(9), 9, 9))
    assert not trace(bvh, np.zeros(3), np.array([bad])).shadow.any()
    if not np.isfinite(bad).all():
        assert (trace(bvh, np.array(bad), np.array([(0, 0, 1)])).primitive == NO_PRIMITIVE).all()


def test_large_sphere_hit_distance_is_precise():
    """Hit distances on a sphere of radius 1e5 are exact to float32 resolution, for rays from just above its surface."""
    sphere = np.array([(0, -1e5, 0, 1e5)], np.float32)
    rng = np.random.default_rng(10)
    d = directions(rng, 5000)
    d[:, 1] = -np.abs(d[:, 1]) - np.float32(0.01)
    o = np.array((0.3, 1.5, -0.2), np.float32)
    hits = trace(build(np.zeros((0, 3)), np.zeros((0, 3), np.int32), sphere), o, d)
    assert hits.shadow.all()
    np.testing.assert_allclose(hits.t, spheres_by_numpy(sphere, o, d)[:, 0], rtol=4 * EPSILON)


def test_sphere_is_hit_from_inside():
    sphere = np.array([(1, 2, 3, 0.5)], np.float32)
    d = directions(np.random.default_rng(11), 1000)
    hits = trace(build(np.zeros((0, 3)), np.zeros((0, 3), np.int32), sphere), np.array((1, 2, 3)), d)
    np.testing.assert_allclose(hits.t * np.linalg.norm(d, axis=1), 0.5, rtol=1e-6)
