"""Tests of building trees: for any input, each primitive is in the tree once, and all boxes above it enclose it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from renderer.bvh.build import build
from renderer.bvh.layout import MAX_LEVELS, ROW_CHILD, ROW_PRIMITIVE, SPHERES, STACK_SIZE, TRIANGLES, WIDTH
from renderer.bvh.top import part_size
from renderer.threads import Team
from tests.renderer.bvh.rays import NO_SPHERES, trace, without_a_tree

NONE = np.zeros((0, 3), np.float32)
NO_TRIANGLES = np.zeros((0, 3), np.int32)


def leaves(bvh):
    """Returns (primitive number, triangle corners or sphere, enclosing boxes) of each primitive in the tree's leaves.

    Asserts that the tree's structure is valid.
    """
    child = bvh.node[:, ROW_CHILD].view(np.int32)
    number = bvh.packet[:, ROW_PRIMITIVE].view(np.int32)
    nodes, packets, deepest = set(), set(), 0
    pending = [(0, [])]
    while pending:
        node, boxes = pending.pop()
        assert node not in nodes
        nodes.add(node)
        deepest = max(deepest, len(boxes))
        for lane in range(WIDTH):
            lower, upper = bvh.node[node, 0:6:2, lane], bvh.node[node, 1:6:2, lane]
            if np.isposinf(lower).all():
                assert np.isneginf(upper).all()
                continue
            here = [*boxes, (lower, upper)]
            if child[node, lane] >= 0:
                pending.append((child[node, lane], here))
                continue
            packet, kind = divmod(~child[node, lane], 4)
            is_sphere = kind == SPHERES
            assert kind in (TRIANGLES, SPHERES)
            assert packet not in packets
            packets.add(packet)
            for k in np.flatnonzero(~np.isnan(bvh.packet[packet, 0])):
                cells = bvh.packet[packet, :, k]
                yield number[packet, k], (cells[:4] if is_sphere else cells[:9].reshape(3, 3)), here, bool(is_sphere)
    assert len(nodes) == len(bvh.node)
    assert len(packets) == len(bvh.packet)
    assert (deepest + 1) * (WIDTH - 1) < STACK_SIZE
    assert deepest < MAX_LEVELS


def assert_whole(position, triangle, sphere, team=None):
    bvh = build(position, triangle, sphere, team=team)
    seen = []
    for primitive, shape, boxes, is_sphere in leaves(bvh):
        seen.append(primitive)
        assert is_sphere == (primitive >= len(triangle))
        if is_sphere:
            np.testing.assert_array_equal(shape, sphere[primitive - len(triangle)])
            low, high = shape[:3] - abs(shape[3]), shape[:3] + abs(shape[3])
        else:
            np.testing.assert_array_equal(shape, position[triangle[primitive]])
            low, high = shape.min(0), shape.max(0)
        for lower, upper in boxes:
            assert (lower <= low).all()
            assert (high <= upper).all()
    assert sorted(seen) == list(range(len(triangle) + len(sphere)))
    return bvh


def _arrays(bvh):
    return bvh.node, bvh.packet, bvh.instance_root, bvh.to_local


coordinate = st.sampled_from([0.0, -0.0, 1.0, -1.0, 0.5, 1e-30, 1e-3, 1e3, 1e15, -1e15, 1 / 3]) | st.floats(-10, 10, width=32)


@given(st.data())
@hypothesis_settings(deadline=None)
def test_any_primitives_make_a_valid_tree(data):
    """Each primitive is in the tree once, inside all its boxes, also if it is coincident, a sliver, degenerate, huge or tiny."""
    points = data.draw(st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=1, max_size=30))
    corner = st.integers(0, len(points) - 1)
    triangle = data.draw(st.lists(st.tuples(corner, corner, corner), max_size=60))
    sphere = data.draw(st.lists(st.tuples(coordinate, coordinate, coordinate, coordinate.map(abs)), max_size=20))
    assert_whole(
        np.array(points, np.float32), np.array(triangle, np.int32).reshape(-1, 3), np.array(sphere, np.float32).reshape(-1, 4)
    )


def test_random_primitives_make_a_valid_reproducible_tree():
    rng = np.random.default_rng(0)
    position = rng.standard_normal((3000, 3)).astype(np.float32)
    triangle = rng.integers(0, 3000, (2000, 3)).astype(np.int32)
    sphere = np.abs(rng.standard_normal((50, 4))).astype(np.float32)
    one, two = assert_whole(position, triangle, sphere), build(position, triangle, sphere)
    assert one.node.tobytes() == two.node.tobytes()
    assert one.packet.tobytes() == two.packet.tobytes()
    assert not one.node.flags.writeable
    assert not one.packet.flags.writeable


def soup():
    """Returns triangles and spheres of all sizes, including a cluster of identical ones that no plane separates."""
    rng = np.random.default_rng(4)
    position = rng.standard_normal((3000, 3)).astype(np.float32)
    triangle = rng.integers(0, 3000, (6000, 3)).astype(np.int32)
    triangle[1000:3000] = triangle[0]
    sphere = np.abs(rng.standard_normal((700, 4))).astype(np.float32)
    return position, triangle, sphere


@pytest.mark.long
def test_tree_of_small_parts_is_valid_for_any_number_of_threads(monkeypatch):
    monkeypatch.setattr("renderer.bvh.top.LEAST_PART", 16)
    built = []
    for threads in (1, 2, 3):
        with Team(threads) as team:
            built.append(assert_whole(*soup(), team))
    for array, second, third in zip(*(_arrays(bvh) for bvh in built), strict=True):
        assert array.tobytes() == second.tobytes() == third.tobytes()


def test_distant_dense_cluster_is_divided(monkeypatch):
    """A dense cluster of primitives far from the others is itself divided into parts, for parallel construction.

    All primitives but one are in one cell of the first grid, and all but one of those are in one cell of the second.
    """
    monkeypatch.setattr("renderer.bvh.top.LEAST_PART", 16)
    rng = np.random.default_rng(6)
    corner = np.concatenate([rng.uniform(0, 1e-4, (3000, 3)), [(1, 1, 1), (1, 1, 2), (2, 1, 1)], [(1e4, 0, 0)] * 3])
    with Team(2) as team:
        assert_whole(corner.astype(np.float32), np.arange(len(corner), dtype=np.int32).reshape(-1, 3), NO_SPHERES, team)


@pytest.mark.long
def test_tree_of_several_parts_does_not_depend_on_threads():
    count = 90_000
    assert part_size(count) < count / 2
    rng = np.random.default_rng(5)
    position = np.repeat(rng.uniform(-1, 1, (count, 3)), 3, axis=0) + rng.normal(0, 0.01, (3 * count, 3))
    triangle = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    built = []
    for threads in (1, 2, 3):
        with Team(threads) as team:
            built.append(build(position.astype(np.float32), triangle, NO_SPHERES, team=team))
    for array, second, third in zip(*(_arrays(bvh) for bvh in built), strict=True):
        assert array.tobytes() == second.tobytes() == third.tobytes()
    numbers = built[0].packet[:, ROW_PRIMITIVE][~np.isnan(built[0].packet[:, 0])].view(np.int32)
    assert sorted(numbers) == list(range(count))


def test_equal_primitives_do_not_deepen_the_tree():
    position = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32)
    assert_whole(position, np.zeros((500, 3), np.int32) + np.arange(3, dtype=np.int32), NO_SPHERES)
    assert_whole(NONE, NO_TRIANGLES, np.ones((300, 4), np.float32))


def test_geometric_series_of_sizes_fits_the_stack():
    """A tree over primitives each half the size of the previous one, the worst case of binning by centroids, fits the stack."""
    scale = 2.0 ** -np.arange(120)
    position = (np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)])[None] * scale[:, None, None] + scale[:, None, None]).reshape(-1, 3)
    assert_whole(position.astype(np.float32), np.arange(360, dtype=np.int32).reshape(-1, 3), NO_SPHERES)


def test_empty_tree_has_no_hits():
    bvh = build(NONE, NO_TRIANGLES, NO_SPHERES)
    hits = trace(bvh, np.zeros(3), np.eye(3))
    assert not hits.shadow.any()
    assert (hits.primitive == -1).all()
    assert np.isposinf(hits.t).all()


def test_degenerate_triangles_are_never_hit():
    position = np.array([(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (-9, -9, 1), (27, -9, 1), (-9, 27, 1)], np.float32)
    dots_and_slivers = [(0, 0, 0), (0, 1, 2), (0, 1, 1), (3, 3, 0)]
    triangle = np.array([*dots_and_slivers, (4, 5, 6)], np.int32)
    rng = np.random.default_rng(1)
    target = np.column_stack([rng.uniform(0, 2, (3000, 1)), np.zeros((3000, 2))])
    target[:4] = position[:4]
    o = np.array((0.3, 0.1, -2), np.float32)
    hits = trace(build(position, triangle, NO_SPHERES), o, target - o)
    assert (hits.primitive == 4).all()
    expected = without_a_tree(position, triangle[4:], NO_SPHERES, o, target - o)
    np.testing.assert_array_equal(hits.t, expected.t)


@pytest.mark.parametrize(
    ("position", "triangle", "sphere", "sentence"),
    [
        ([(np.nan, 0, 0)], [(0, 0, 0)], [], "not finite"),
        ([(0, 0, 0)], [(0, 0, 0)], [(0, 0, np.inf, 1)], "not finite"),
        ([(0, 0, 0)], [(0, 0, 1)], [], "outside 0 ... 0"),
        ([(0, 0, 0)], [(0, -1, 0)], [], "outside 0 ... 0"),
    ],
)
def test_invalid_geometry_is_rejected(position, triangle, sphere, sentence):
    with pytest.raises(ValueError, match=sentence):
        build(np.array(position, np.float32), np.array(triangle, np.int32), np.array(sphere, np.float32).reshape(-1, 4))
