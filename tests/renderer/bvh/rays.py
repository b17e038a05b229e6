"""Traces many rays through a tree, and computes reference hits with NumPy without a tree."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.bvh.build import build
from renderer.bvh.layout import Bvh
from renderer.bvh.traverse import any_hit, closest_hit, new_stack
from renderer.jit import entry, subroutine
from renderer.reference import Packed, by_reference
from tests.renderer.builders import still

NO_SPHERES = np.zeros((0, 4), np.float32)


class Hits(NamedTuple):
    t: np.ndarray  # (n,) f32; t_max where nothing is hit
    primitive: np.ndarray  # (n,) i32; -1 where nothing is hit
    uv: np.ndarray  # (n, 2) f32
    shadow: np.ndarray  # (n,) bool, by any_hit
    instance: np.ndarray  # (n,) i32; -1 for a hit outside instances


@subroutine
def _trace_all(bvh, stack, o, d, t_max, t, primitive, uv, shadow, instance):
    for i in range(len(o)):
        origin = (o[i, 0], o[i, 1], o[i, 2])
        direction = (d[i, 0], d[i, 1], d[i, 2])
        hit = closest_hit(bvh, stack, origin, direction, t_max[i], None)
        t[i], primitive[i], uv[i, 0], uv[i, 1], instance[i] = hit.t, hit.primitive, hit.u, hit.v, hit.instance
        shadow[i] = any_hit(bvh, stack, origin, direction, t_max[i], None)


@entry
def _trace(bvh, stack, o, d, t_max, t, primitive, uv, shadow, instance):
    _trace_all(by_reference(bvh), stack, o, d, t_max, t, primitive, uv, shadow, instance)


def trace(bvh: Bvh, o: object, d: object, t_max: object = np.inf) -> Hits:
    """Returns the hits of rays from o (n, 3) or (3,) in directions d (n, 3), which need not be normalised."""
    d = np.ascontiguousarray(d, np.float32).reshape(-1, 3)
    n = len(d)
    # Writable copies: read-only arrays have another type, for which the kernel would be compiled again.
    o, limit = (np.array(np.broadcast_to(each, shape), np.float32, order="C") for each, shape in ((o, (n, 3)), (t_max, (n,))))
    hits = Hits(
        np.empty(n, np.float32), np.empty(n, np.int32), np.empty((n, 2), np.float32), np.empty(n, np.bool_), np.empty(n, np.int32)
    )
    _trace(Packed(still(bvh)), new_stack(), o, d, limit, *hits)
    return hits


def without_a_tree(position: np.ndarray, triangle: np.ndarray, sphere: np.ndarray, o: object, d: object) -> Hits:
    """Returns the nearest hits among all primitives, which are tested eight at a time in trees of a single leaf."""
    nearest: Hits | None = None
    for first in range(0, len(triangle), 8):
        hits = trace(build(position, triangle[first : first + 8], NO_SPHERES), o, d)
        nearest = _nearer(nearest, hits, first)
    for first in range(0, len(sphere), 8):
        hits = trace(build(position, triangle[:0], sphere[first : first + 8]), o, d)
        nearest = _nearer(nearest, hits, len(triangle) + first)
    assert nearest is not None
    return nearest


def _nearer(a: Hits | None, b: Hits, first: int) -> Hits:
    b = b._replace(primitive=np.where(b.primitive >= 0, b.primitive + first, -1))
    if a is None:
        return b
    take = b.t < a.t
    return Hits(
        np.where(take, b.t, a.t),
        np.where(take, b.primitive, a.primitive),
        np.where(take[:, None], b.uv, a.uv),
        a.shadow | b.shadow,
        a.instance,
    )


def triangles_by_numpy(position: np.ndarray, triangle: np.ndarray, o: np.ndarray, d: np.ndarray, slack: float) -> np.ndarray:
    """Returns hit distances (rays, triangles), computed in float64; inf for a miss.

    slack: barycentric coordinates down to -slack count as hits, which widens each triangle.
    """
    a, b, c = (position[triangle[:, k]].astype(np.float64) for k in range(3))
    o, d = np.asarray(o, np.float64).reshape(-1, 1, 3), np.asarray(d, np.float64)[:, None]
    e1, e2 = b - a, c - a
    p = np.cross(d, e2)
    with np.errstate(all="ignore"):
        inverse = 1 / (e1 * p).sum(-1)
        s = o - a
        u = (s * p).sum(-1) * inverse
        q = np.cross(s, e1)
        v = (d * q).sum(-1) * inverse
        t = (e2 * q).sum(-1) * inverse
        hit = (u >= -slack) & (v >= -slack) & (u + v <= 1 + slack) & (t > 0) & np.isfinite(inverse)
    return np.where(hit, t, np.inf)


def spheres_by_numpy(sphere: np.ndarray, o: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Returns hit distances (rays, spheres), computed in float64; inf for a miss."""
    f = np.asarray(o, np.float64).reshape(-1, 1, 3) - sphere[:, :3].astype(np.float64)
    d = np.asarray(d, np.float64)[:, None]
    a, b = (d * d).sum(-1), -(f * d).sum(-1)
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b * b - a * ((f * f).sum(-1) - sphere[:, 3].astype(np.float64) ** 2))
        near, far = (b - root) / a, (b + root) / a
        return np.where(near > 0, near, np.where(far > 0, far, np.inf))
