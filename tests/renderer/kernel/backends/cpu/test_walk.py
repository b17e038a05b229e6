"""Tests of traversing a tree with many rays together: each ray has the same hit, to the bit, as if it were traced alone."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from renderer.bvh.build import build
from renderer.bvh.layout import Bvh
from renderer.bvh.simd import load_int
from renderer.bvh.traverse import any_hit, new_stack
from renderer.jit import entry, subroutine
from renderer.kernel import vec
from renderer.kernel.backends.cpu.lists import ENDED, LIST_SIZE, LISTS, NODES, append, clear, eight_rows, length, pad
from renderer.kernel.backends.cpu.rows import ROW, ROWS, Outcome, RowHit, at, column, gather, line_floats, scatter
from renderer.kernel.backends.cpu.traversal_state import BEST, OCCLUDED, new_stacks, start_traversal
from renderer.kernel.backends.cpu.walk import CLOSEST, traverse_rays
from renderer.kernel.steps.state import Ray
from renderer.reference import Packed, by_reference
from renderer.wide.values import as_wide, zero_like
from tests.renderer.builders import icosphere, still
from tests.renderer.bvh.rays import Hits, trace
from tests.renderer.bvh.test_instances import directions, forest

_INF = np.float32(np.inf)
_NO_PRIMITIVE, _ROOT, _NO_OBJECT = np.uint32(0xFFFFFFFF), np.uint32(0), np.uint32(0)
_U, _V, _PRIMITIVE, _INSTANCE = (column(RowHit, field) for field in ("u", "v", "primitive", "instance"))


@subroutine
def _traverse_together(bvh, alone, stack, pool, lists, count, out):
    clear(lists, NODES)
    clear(lists, ENDED)
    for k in range(count):
        append(lists, NODES, k)
    for k in range(0, pad(lists, NODES), 8):
        rows = eight_rows(lists, NODES, k)
        ray = gather(pool, rows, Ray)
        none = zero_like(ray.pdf)
        start_traversal(pool, rows, ray.o, ray.d, none + _INF, as_wide(_ROOT, none))
        nothing, number = as_wide(_NO_PRIMITIVE, none), as_wide(_NO_OBJECT, none)
        scatter(pool, rows, RowHit(none, none, none, nothing, nothing, none, number, none))
    traverse_rays(bvh, None, alone, pool, stack, lists, CLOSEST)
    for k in range(count):
        out[k, 0] = pool[at(k, BEST)]
        out[k, 1] = pool[at(k, _U)]
        out[k, 2] = pool[at(k, _V)]
        out[k, 3] = load_int(pool, at(k, _PRIMITIVE))
        out[k, 4] = load_int(pool, at(k, _INSTANCE))
    return length(lists, ENDED)


@entry
def _together(bvh, alone, stack, pool, lists, count, out):
    return _traverse_together(by_reference(bvh), alone, stack, pool, lists, count, out)


@subroutine
def _traverse_in_shade(bvh, alone, stack, pool, lists, count, out):
    clear(lists, NODES)
    clear(lists, ENDED)
    for k in range(count):
        append(lists, NODES, k)
    for k in range(0, pad(lists, NODES), 8):
        rows = eight_rows(lists, NODES, k)
        ray = gather(pool, rows, Outcome)
        none = zero_like(ray.survival)
        start_traversal(pool, rows, ray.start, vec.sub(ray.end, ray.start), none, as_wide(_ROOT, none))
    traverse_rays(bvh, None, alone, pool, stack, lists, None)
    for k in range(count):
        out[k] = pool[at(k, OCCLUDED)]
    return length(lists, ENDED)


@entry
def _in_shade(bvh, alone, stack, pool, lists, count, out):
    return _traverse_in_shade(by_reference(bvh), alone, stack, pool, lists, count, out)


@subroutine
def _traverse_one_by_one(bvh, stack, start, end, out):
    for i in range(len(start)):
        o, e = (start[i, 0], start[i, 1], start[i, 2]), (end[i, 0], end[i, 1], end[i, 2])
        out[i] = any_hit(bvh, stack, o, vec.sub(e, o), np.float32(1.0), None)


@entry
def _one_by_one(bvh, stack, start, end, out):
    _traverse_one_by_one(by_reference(bvh), stack, start, end, out)


NAMES = ["instances", "a mesh", "triangles and spheres", "one packet", "nothing", "boundless boxes"]


class _Room:
    """Scratch memory of the traversal, reused from batch to batch."""

    def __init__(self) -> None:
        self.alone, self.stack = new_stack(), new_stacks()
        self.pool, self.lists = line_floats(ROWS * int(ROW)), np.zeros(LISTS * LIST_SIZE, np.uint32)

    def batches(self, column: int, values: np.ndarray, kernel: object, bvh: Bvh, out: np.ndarray) -> None:
        """Traces the rays `values` (n, 6), origins and directions, in full and partial batches; writes the results to `out`.

        column: the first column of the rays in the path pool. kernel: the function that traces one batch.
        """
        rows = self.pool.reshape(ROWS, int(ROW))
        packed = Packed(bvh)
        first, turn = 0, 0
        while first < len(values):
            count = min((ROWS, 1, 9, ROWS - 1)[turn % 4], len(values) - first)
            rows[:count, column : column + 6] = values[first : first + count]
            part = out[first : first + count]
            assert kernel(packed, self.alone, self.stack, self.pool, self.lists, count, part) == count  # type: ignore[operator]
            first, turn = first + count, turn + 1


def closest_together(bvh: Bvh, o: np.ndarray, d: np.ndarray) -> Hits:
    out = np.zeros((len(o), 5), np.float32)
    _Room().batches(int(column(Ray, "o")), np.hstack([o, d]), _together, bvh, out)
    return Hits(out[:, 0], out[:, 3].astype(np.int32), out[:, 1:3], np.zeros(0, bool), out[:, 4].astype(np.int32))


@cache
def _scenes() -> dict[str, Bvh]:
    rng = np.random.default_rng(4)
    position, triangle, sphere, instances = forest(rng)
    ball = icosphere(4)
    few = np.arange(9, dtype=np.int32).reshape(3, 3)
    none = np.zeros((0, 4), np.float32)
    made = {
        "instances": build(position, triangle, sphere, instances),
        "a mesh": build(ball.positions, ball.triangles, none),
        "triangles and spheres": build(position, triangle[:30], sphere),
        "one packet": build(rng.uniform(-3, 3, (9, 3)).astype(np.float32), few, none),
        "nothing": build(position[:0], triangle[:0], none),
        "boundless boxes": build(position, triangle[:100], sphere, brute=True),
    }
    return {name: still(bvh) for name, bvh in made.items()}


def _rays(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns origins and directions of rays from outside and inside, some along axes, some invalid."""
    rng = np.random.default_rng(5)
    o = rng.uniform(-2.5, 2.5, (count, 3)).astype(np.float32)
    d = directions(rng, count) * np.float32(1.7)
    d[::17] = np.eye(3, dtype=np.float32)[rng.integers(0, 3, len(d[::17]))]
    d[5::41] = 0
    o[7::43, 1] = np.nan
    d[9::47, 2] = np.nan
    o[11::53, 0] = np.inf
    return o, d


@pytest.mark.parametrize("name", NAMES)
def test_grouped_rays_have_the_hits_of_single_rays(name: str) -> None:
    bvh = _scenes()[name]
    o, d = _rays(3000)
    alone, together = trace(bvh, o, d), closest_together(bvh, o, d)
    hit = alone.primitive >= 0
    assert name == "nothing" or hit.mean() > 0.01
    np.testing.assert_array_equal(together.primitive, alone.primitive)
    np.testing.assert_array_equal(together.instance, alone.instance)
    np.testing.assert_array_equal(together.t, alone.t)
    np.testing.assert_array_equal(together.uv, alone.uv)


@pytest.mark.parametrize("name", NAMES)
def test_grouped_shadow_rays_match_single_ones(name: str) -> None:
    bvh = _scenes()[name]
    o, d = _rays(3000)
    end = o + 2 * d
    alone, together = np.zeros(len(o), np.bool_), np.zeros(len(o), np.float32)
    _one_by_one(Packed(bvh), new_stack(), o, end, alone)
    _Room().batches(int(column(Outcome, "start")), np.hstack([o, end]), _in_shade, bvh, together)
    assert name == "nothing" or 0.01 < alone.mean() < 0.99
    np.testing.assert_array_equal(together != 0, alone)
