"""Tests of instances: rays have the same hits as with the instances' triangles copied to world space, for any transforms."""

import numpy as np
import pytest

from renderer.bvh.build import build
from renderer.bvh.instances import Instances
from renderer.bvh.layout import ROW_CHILD
from renderer.bvh.transforms import invert_transforms
from tests.grids import grid
from tests.renderer.builders import icosphere
from tests.renderer.bvh.rays import NO_SPHERES, trace, triangles_by_numpy


def transforms(rng, n, spread=3.0, mirror=True):
    """Returns (n, 3, 4) transforms that rotate, scale by up to 4 and translate; some also mirror."""
    matrix = np.linalg.qr(rng.standard_normal((n, 3, 3)))[0] @ (np.exp(rng.uniform(-0.7, 0.7, (n, 3)))[:, :, None] * np.eye(3))
    if not mirror:
        matrix *= np.sign(np.linalg.det(matrix))[:, None, None]
    return np.concatenate([matrix, rng.uniform(-spread, spread, (n, 3, 1))], axis=2)


def directions(rng, n):
    d = rng.standard_normal((n, 3))
    return (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)


def forest(rng, instances=40):
    """Returns (position, triangle, sphere, Instances): world primitives, and many instances of two triangle trees."""
    center = rng.uniform(-0.7, 0.7, (130, 1, 3))
    position = (center + 0.2 * rng.standard_normal((130, 3, 3))).reshape(-1, 3).astype(np.float32)
    triangle = np.arange(390, dtype=np.int32).reshape(-1, 3)
    sphere = np.column_stack([rng.uniform(-3, 3, (9, 3)), rng.uniform(0.1, 0.4, 9)]).astype(np.float32)
    tree = rng.integers(0, 2, instances)
    return position, triangle, sphere, Instances(np.array([30, 100, 130]), tree, transforms(rng, instances))


def copied(position, triangle, instances):
    """Returns the same geometry as world-space triangles in float64: corners (n, 3, 3), primitive (n,), instance (n,)."""
    first = instances.first
    corners, primitive, instance = [position[triangle[: first[0]]].astype(float)], [np.arange(first[0])], [np.full(first[0], -1)]
    for i, (tree, m) in enumerate(zip(instances.tree, instances.to_world, strict=True)):
        which = np.arange(first[tree], first[tree + 1])
        corners.append(position[triangle[which]].astype(float) @ m[:, :3].T + m[:, 3])
        primitive.append(which)
        instance.append(np.full(len(which), i))
    return np.concatenate(corners), np.concatenate(primitive), np.concatenate(instance)


@grid("scale", [1e-3, 1.0, 1e3], ordinary=(1e3,))
def test_instance_hits_equal_those_of_copies(scale):
    rng = np.random.default_rng(1)
    position, triangle, _, instances = forest(rng)
    instances.to_world[:] *= scale
    position[:90] *= np.float32(scale)
    bvh = build(position, triangle, NO_SPHERES, instances)
    o = (rng.uniform(-4, 4, (1000, 3)) * scale).astype(np.float32)
    d = directions(rng, 1000)
    found = trace(bvh, o, d)
    corners, primitive, instance = copied(position, triangle, instances)
    flat = corners.reshape(-1, 3)
    every = np.arange(len(flat)).reshape(-1, 3)
    sure = triangles_by_numpy(flat, every, o, d, -1e-3)
    possible = triangles_by_numpy(flat, every, o, d, 1e-3)
    assert (found.t <= sure.min(1) * (1 + 1e-4) + 1e-6 * scale).all()
    assert (found.t >= possible.min(1) * (1 - 1e-4) - 1e-6 * scale).all()
    hit = found.primitive >= 0
    assert 0.2 < hit.mean() < 1
    assert (found.shadow == hit).all()
    assert (found.instance[~hit] == -1).all()
    row = [
        np.flatnonzero((primitive == p) & (instance == i))[0]
        for p, i in zip(found.primitive[hit], found.instance[hit], strict=True)
    ]
    np.testing.assert_allclose(found.t[hit], possible[np.flatnonzero(hit), row], rtol=1e-3, atol=1e-5 * scale)
    u, v = found.uv[hit, :1], found.uv[hit, 1:]
    a, b, c = corners[row].transpose(1, 0, 2)
    np.testing.assert_allclose((1 - u - v) * a + u * b + v * c, o[hit] + found.t[hit, None] * d[hit], atol=3e-4 * scale)


def test_t_max_applies_within_instances():
    rng = np.random.default_rng(2)
    position, triangle, sphere, instances = forest(rng)
    bvh = build(position, triangle, sphere, instances)
    o, d = rng.uniform(-4, 4, (3000, 3)).astype(np.float32), directions(rng, 3000) * np.float32(2.5)
    full = trace(bvh, o, d)
    hit = full.instance >= 0
    assert hit.mean() > 0.2
    beyond, short = (trace(bvh, o[hit], d[hit], full.t[hit] * np.float32(f)) for f in (1 + 1e-4, 1 - 1e-4))
    np.testing.assert_array_equal(beyond.t, full.t[hit])
    assert beyond.shadow.all()
    assert short.shadow.mean() < 0.001  # t equals the distance to the triangle up to rounding


def test_identity_instance_equals_its_mesh():
    rng = np.random.default_rng(3)
    mesh = icosphere(3)
    identity = np.eye(4)[None, :3]
    one = build(mesh.positions, mesh.triangles, NO_SPHERES, Instances(np.array([0, 1280]), np.zeros(1, int), identity))
    flat = build(mesh.positions, mesh.triangles, NO_SPHERES)
    o, d = rng.uniform(-2, 2, (5000, 3)).astype(np.float32), directions(rng, 5000)
    a, b = trace(one, o, d), trace(flat, o, d)
    for name in ("t", "primitive", "uv", "shadow"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert (a.instance[a.primitive >= 0] == 0).all()
    assert (b.instance == -1).all()


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_no_ray_leaves_a_closed_instance(scale):
    """No ray leaves a rotated, scaled or mirrored closed instance from inside, also towards vertices and edges."""
    rng = np.random.default_rng(4)
    mesh = icosphere(2)
    corners = mesh.positions[mesh.triangles]
    targets = np.concatenate([mesh.positions, (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3) / 2])
    for m in transforms(rng, 6, 1.0) * scale:
        bvh = build(mesh.positions, mesh.triangles, NO_SPHERES, Instances(np.array([0, 320]), np.zeros(1, int), m[None]))
        for origin in ((0, 0, 0), (0.3, -0.2, 0.1)):
            o = (m[:, :3] @ origin + m[:, 3]).astype(np.float32)
            aimed = ((targets @ m[:, :3].T + m[:, 3]) - o).astype(np.float32)
            for d in (aimed, directions(rng, 10_000)):
                hits = trace(bvh, o, d)
                assert hits.shadow.all()
                assert (hits.primitive >= 0).all()


def test_shared_tree_is_stored_once():
    rng = np.random.default_rng(5)
    mesh = icosphere(4)
    single = build(mesh.positions, mesh.triangles, NO_SPHERES)
    places = transforms(rng, 500, 50.0)
    many = build(mesh.positions, mesh.triangles, NO_SPHERES, Instances(np.array([0, 5120]), np.zeros(500, int), places))
    assert len(many.packet) == len(single.packet)
    assert len(many.node) < len(single.node) + 500
    assert (many.instance_root == many.instance_root[0]).all()
    child = many.node[: many.instance_root[0], ROW_CHILD].view(np.int32)
    named = ~child[(child < 0)]
    assert sorted(named >> 2) == list(range(500))
    assert (named & 3 == 2).all()
    again = invert_transforms(many.to_local)
    np.testing.assert_allclose(again, places, atol=1e-9)


@pytest.mark.parametrize("instanced", [False, True])
def test_infinite_boxes_do_not_change_hits(instanced):
    rng = np.random.default_rng(6)
    position, triangle, sphere, instances = forest(rng, 6)
    if not instanced:
        instances = None
    o, d = rng.uniform(-3, 3, (2000, 3)).astype(np.float32), directions(rng, 2000)
    d[:20] = np.eye(3, dtype=np.float32)[np.arange(20) % 3]
    with_tree, brute = (trace(build(position, triangle, sphere, instances, b), o, d) for b in (False, True))
    np.testing.assert_array_equal(with_tree.t, brute.t)
    np.testing.assert_array_equal(with_tree.shadow, brute.shadow)
    np.testing.assert_array_equal(with_tree.primitive, brute.primitive)
    np.testing.assert_array_equal(with_tree.instance, brute.instance)


def test_tree_without_triangles_has_no_hits():
    position = np.zeros((0, 3))
    triangle = np.zeros((0, 3), np.int32)
    bvh = build(
        position, triangle, NO_SPHERES, Instances(np.array([0, 0]), np.zeros(2, int), transforms(np.random.default_rng(7), 2))
    )
    hits = trace(bvh, np.zeros(3), np.eye(3))
    assert not hits.shadow.any()
    assert (hits.primitive == -1).all()
