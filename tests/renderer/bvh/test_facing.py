"""Tests of coincident faces with opposite normals: rays hit the face towards their origin, for any tessellation and transform."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np
import pytest

from renderer.bvh.build import build
from renderer.bvh.instances import Instances
from tests.renderer.bvh.rays import NO_SPHERES, trace

RAYS = 4000


def _square(steps: int, diagonal: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns vertices (V, 3) and triangles (T, 3) of a square, -1 to 1 in the plane z = 0, of steps x steps cells, facing +z."""
    x = np.linspace(-1, 1, steps + 1)
    position = np.array([(a, b, 0) for b in x for a in x])
    corner = np.array([j * (steps + 1) + i for j in range(steps) for i in range(steps)])[:, None]
    a, b, c, d = corner, corner + 1, corner + steps + 1, corner + steps + 2
    cuts = [[a, b, d, a, d, c], [a, b, c, b, d, c]]
    return position, np.concatenate(cuts[diagonal], axis=1).reshape(-1, 3).astype(np.int32)


def _place(turned: bool, at: tuple[float, float, float], scale: float) -> np.ndarray:
    """Returns a (3, 4) matrix that scales, optionally rotates about an oblique axis, and translates."""
    matrix = np.linalg.qr(np.array([(1.0, 2.0, 3.0), (-2.0, 1.0, 0.5), (0.3, -1.0, 2.0)]))[0] if turned else np.eye(3)
    return np.column_stack([scale * np.sign(np.linalg.det(matrix)) * matrix, at])


SPACES = ("world", "instance", "scaled", "both")
PLACES = ((0.0, 0.0, 0.0), (2.0, 1.0, -3.0), (50.0, 30.0, 40.0), (1000.0, -300.0, 2000.0))
# (steps, diagonal) of both faces.
TESSELLATIONS = (((1, 0), (1, 0)), ((1, 0), (1, 1)), ((1, 0), (4, 1)), ((3, 0), (7, 1)))


def _cases() -> Iterator[Any]:
    """Yields an orthogonal array of parameters: with --long all triples of values, always all pairs.

    Numbers of values are elements of the field of four, whose addition is the exclusive or.
    """
    for space, at, order in product(range(4), repeat=3):
        is_ordinary = order == (0, 2, 3, 1)[space] ^ (0, 3, 1, 2)[at]
        values = SPACES[space], bool(order & 1), PLACES[at], *TESSELLATIONS[space ^ at ^ order], bool(order & 2)
        yield pytest.param(*values, marks=() if is_ordinary else pytest.mark.long)


@pytest.mark.parametrize(("space", "turned", "at", "front", "back", "swapped"), list(_cases()))
def test_coincident_faces_hit_the_front_facing_one(space, turned, at, front, back, swapped):
    whole = _place(turned, at, 1.0)
    scale = 3.7 if space in ("scaled", "both") else 1.0
    parts, instanced = [], {"world": (False, False), "both": (True, True)}.get(space, (False, True))
    for (steps, diagonal), opposed, inside in zip((front, back), (False, True), instanced, strict=True):
        position, triangle = _square(steps, diagonal)
        position = position / scale if inside else position @ whole[:, :3].T + whole[:, 3]
        parts.append((inside, opposed, position.astype(np.float32), triangle[:, ::-1] if opposed else triangle))
    parts = sorted(parts[::-1] if swapped else parts, key=lambda part: part[0])
    position = np.concatenate([part[2] for part in parts])
    starts = np.cumsum([0, *(len(part[2]) for part in parts)])
    triangle = np.concatenate([part[3] + start for part, start in zip(parts, starts, strict=False)]).astype(np.int32)
    firsts = np.cumsum([0, *(len(part[3]) for part in parts)])
    shown = [n for n, part in enumerate(parts) if part[0]]
    places = np.repeat(_place(turned, at, scale)[None], len(shown), axis=0)
    first = firsts[shown[0] :] if shown else firsts[-1:]
    instances = Instances(np.asarray(first), np.arange(len(shown)), places) if shown else None
    bvh = build(position, triangle, NO_SPHERES, instances) if shown else build(position, triangle, NO_SPHERES)

    near = 4.0 if max(np.abs(at)) < 10.0 else 0.3
    rng = np.random.default_rng(3)
    side = np.where(rng.random(RAYS) < 0.5, 1.0, -1.0)
    elevation = np.radians(rng.uniform(12.0, 90.0, RAYS))
    azimuth = rng.uniform(0.0, 2 * np.pi, RAYS)
    away = np.column_stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), side * np.sin(elevation)])
    target = np.column_stack([rng.uniform(-0.99, 0.99, (RAYS, 2)), np.zeros(RAYS)])
    eye = target + away * rng.uniform(near, 5 * near, RAYS)[:, None]
    o = (eye @ whole[:, :3].T + whole[:, 3]).astype(np.float32)
    d = -(away @ whole[:, :3].T)
    found = trace(bvh, o, d)
    met = found.primitive >= 0
    assert met.mean() > 0.999
    part = np.searchsorted(firsts, found.primitive, "right") - 1
    opposed = np.array([part[1] for part in parts])[part]
    assert (opposed == (side < 0))[met].all()
