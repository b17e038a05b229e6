"""Joint traversal of many rays: each has the same hit as alone, to the bit."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from renderer.bvh.build import build
from renderer.bvh.layout import Bvh
from renderer.bvh.simd import load_int
from renderer.bvh.traverse import any_hit, new_stack
from renderer.jit import entry
from renderer.kernel import vec
from renderer.kernel.pool.lists import ENDED, LIST_SIZE, LISTS, NODES, append, clear, eight, length, pad
from renderer.kernel.pool.rows import HIT, RAY, ROW, ROWS, SHADOW, at, line_floats, read, write
from renderer.kernel.pool.shade import walk_in_shade
from renderer.kernel.pool.walk import walk
from renderer.kernel.pool.ways import BEST, BLOCKED, new_ways, set_out
from renderer.wide.values import as_floats, as_wide, nil
from tests.renderer.builders import icosphere, still
from tests.renderer.bvh.rays import Hits, trace
from tests.renderer.bvh.test_instances import directions, forest

_INF = np.float32(np.inf)
_NOBODY = np.uint32(0xFFFFFFFF)


@entry
def _together(bvh, alone, stack, pool, lists, count, out):
    clear(lists, NODES)
    clear(lists, ENDED)
    for k in range(count):
        append(lists, NODES, k)
    for k in range(0, pad(lists, NODES), 8):
        rows = eight(lists, NODES, k)
        ray = read(pool, rows, RAY)
        none = nil(ray[0])
        set_out(pool, rows, (ray[0], ray[1], ray[2]), (ray[3], ray[4], ray[5]), none + _INF, none)
        nobody = as_floats(as_wide(_NOBODY, none))
        write(pool, rows, HIT, (none, none, none, nobody, nobody, none, none, none))
    walk(bvh, None, alone, pool, stack, lists)
    for k in range(count):
        out[k, 0] = pool[at(k, BEST)]
        out[k, 1] = pool[at(k, HIT + np.uintp(1))]
        out[k, 2] = pool[at(k, HIT + np.uintp(2))]
        out[k, 3] = load_int(pool, at(k, HIT + np.uintp(3)))
        out[k, 4] = load_int(pool, at(k, HIT + np.uintp(4)))
    return length(lists, ENDED)


@entry
def _in_shade(bvh, alone, stack, pool, lists, count, out):
    clear(lists, NODES)
    clear(lists, ENDED)
    for k in range(count):
        append(lists, NODES, k)
    for k in range(0, pad(lists, NODES), 8):
        rows = eight(lists, NODES, k)
        ends = read(pool, rows, SHADOW)
        start = (ends[0], ends[1], ends[2])
        none = nil(ends[0])
        set_out(pool, rows, start, vec.sub((ends[3], ends[4], ends[5]), start), none, none)
    walk_in_shade(bvh, None, alone, pool, stack, lists)
    for k in range(count):
        out[k] = pool[at(k, BLOCKED)]
    return length(lists, ENDED)


@entry
def _one_by_one(bvh, stack, start, end, out):
    for i in range(len(start)):
        o, e = (start[i, 0], start[i, 1], start[i, 2]), (end[i, 0], end[i, 1], end[i, 2])
        out[i] = any_hit(bvh, stack, o, vec.sub(e, o), np.float32(1.0), None)


NAMES = ["instances", "a mesh", "triangles and spheres", "one packet", "nothing", "boundless boxes"]


class _Room:
    """The memory that is reused from batch to batch."""

    def __init__(self) -> None:
        self.alone, self.stack = new_stack(), new_ways()
        self.pool, self.lists = line_floats(ROWS * int(ROW)), np.zeros(LISTS * LIST_SIZE, np.uint32)

    def batches(self, column: int, values: np.ndarray, kernel: object, bvh: Bvh, out: np.ndarray) -> None:
        """Traces all rays (n, 6), in batches of as many as there are rows, and fewer."""
        rows = self.pool.reshape(ROWS, int(ROW))
        first, turn = 0, 0
        while first < len(values):
            count = min((ROWS, 1, 9, ROWS - 1)[turn % 4], len(values) - first)
            rows[:count, column : column + 6] = values[first : first + count]
            part = out[first : first + count]
            assert kernel(bvh, self.alone, self.stack, self.pool, self.lists, count, part) == count  # type: ignore[operator]
            first, turn = first + count, turn + 1


def closest_together(bvh: Bvh, o: np.ndarray, d: np.ndarray) -> Hits:
    out = np.zeros((len(o), 5), np.float32)
    _Room().batches(int(RAY), np.hstack([o, d]), _together, bvh, out)
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
    """Rays from outside and inside, some along axes, some invalid."""
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
def test_rays_meet_together_what_they_meet_alone(name: str) -> None:
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
def test_shadows_fall_together_where_they_fall_alone(name: str) -> None:
    bvh = _scenes()[name]
    o, d = _rays(3000)
    end = o + 2 * d
    alone, together = np.zeros(len(o), np.bool_), np.zeros(len(o), np.float32)
    _one_by_one(bvh, new_stack(), o, end, alone)
    _Room().batches(int(SHADOW), np.hstack([o, end]), _in_shade, bvh, together)
    assert name == "nothing" or 0.01 < alone.mean() < 0.99
    np.testing.assert_array_equal(together != 0, alone)
