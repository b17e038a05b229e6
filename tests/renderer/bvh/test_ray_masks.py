"""Tests of trees in which some primitives are hidden from some kinds of rays.

Their hits equal those of trees built without the hidden primitives.
"""

from __future__ import annotations

import numpy as np
import pytest

from renderer.bvh.build import build
from renderer.bvh.layout import PAGE, Bvh
from renderer.bvh.motion_bvh import keyed_tree
from renderer.bvh.ray_masks import exclude_primitives
from renderer.bvh.subtrees import NODE_BYTES, PACKET_BYTES, AssembledBvh
from renderer.bvh.traverse import any_hit, camera_root, closest_hit, new_stack, shadow_root
from renderer.jit import entry, subroutine
from renderer.reference import Packed, by_reference
from renderer.threads import Team
from tests.renderer.builders import kept


@subroutine
def _trace_all(bvh, stack, o, d, time, met, blocked):
    for i in range(len(o)):
        origin, direction = (o[i, 0], o[i, 1], o[i, 2]), (d[i, 0], d[i, 1], d[i, 2])
        met[i, 0] = closest_hit(bvh, stack, origin, direction, np.float32(1e6), time[i]).primitive
        met[i, 1] = closest_hit(bvh, stack, origin, direction, np.float32(1e6), time[i], camera_root(bvh)).primitive
        blocked[i] = any_hit(bvh, stack, origin, direction, np.float32(1e6), time[i], shadow_root(bvh))


@entry
def _trace(bvh, stack, o, d, time, met, blocked):
    _trace_all(by_reference(bvh), stack, o, d, time, met, blocked)


def trace(bvh: Bvh, rays: tuple[np.ndarray, np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Traces each ray as an ordinary, a camera and a shadow ray.

    Returns the primitives hit by the first two, (n, 2) int32, and whether the shadow ray is occluded, (n,) bool.
    """
    met, blocked = np.empty((len(rays[0]), 2), np.int32), np.empty(len(rays[0]), np.bool_)
    _trace(Packed(kept(bvh)), new_stack(), *rays, met, blocked)
    return met, blocked


def rays(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(7)
    return (
        random.uniform(-1.5, 1.5, (count, 3)).astype(np.float32),
        random.standard_normal((count, 3)).astype(np.float32),
        random.random(count).astype(np.float32),
    )


def laid(bvh: Bvh) -> AssembledBvh:
    nodes, packets = len(bvh.node), len(bvh.packet)
    return AssembledBvh(bvh, (0, 0, nodes, nodes, nodes), (0, 0, packets, packets, packets), (bvh, ()))


def world(seed: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns random triangles and spheres as (positions, triangles, spheres)."""
    random = np.random.default_rng(seed)
    middle = random.uniform(-1, 1, (300, 1, 3))
    position = (middle + random.uniform(-0.2, 0.2, (300, 3, 3))).astype(np.float32).reshape(-1, 3)
    triangle = np.arange(900, dtype=np.int32).reshape(-1, 3)
    sphere = random.uniform(-1, 1, (40, 4)).astype(np.float32)
    sphere[:, 3] = abs(sphere[:, 3]) * 0.1
    for array in (position, triangle, sphere):
        array.flags.writeable = False
    return position, triangle, sphere


@pytest.mark.parametrize("share", [0.01, 0.3, 1.0])
def test_rays_from_special_roots_skip_hidden_primitives(share: float) -> None:
    position, triangle, sphere = world()
    bvh = build(position, triangle, sphere)
    random = np.random.default_rng(1)
    unseen, shadeless = random.random((2, 340)) < share
    unseen[5] = shadeless[320] = True
    grown = exclude_primitives(laid(bvh), unseen, shadeless).bvh
    asked = rays(3000)
    met, blocked = trace(grown, asked)
    assert (met[:, 0] == trace(bvh, asked)[0][:, 0]).all()  # ordinary rays are unaffected
    assert (met[:, 0] != met[:, 1]).any()
    for left_out, found in ((unseen, met[:, 1] >= 0), (shadeless, blocked)):
        fewer = triangle[~left_out[:300]], sphere[~left_out[300:]]
        for array in fewer:
            array.flags.writeable = False
        if len(fewer[0]) + len(fewer[1]):
            expected = trace(build(position, *fewer), asked)[0][:, 0] >= 0
            assert (found == expected).all()
        else:
            assert not found.any()


def test_appended_rows_start_at_a_page_boundary() -> None:
    bvh = build(*world())
    unseen = np.arange(340) == 17
    found = exclude_primitives(laid(bvh), unseen, ~unseen & False)
    for places, rows, size in ((found.node, found.bvh.node, NODE_BYTES), (found.packet, found.bvh.packet, PACKET_BYTES)):
        assert places[2] == places[3]
        assert places[3] * size % PAGE == 0
        assert places[4] == len(rows) > places[3]


def test_trees_without_hidden_primitives_are_unchanged() -> None:
    given = laid(build(*world()))
    none = np.zeros(340, np.bool_)
    assert exclude_primitives(given, none, none) is given


def test_hidden_moving_primitives_are_skipped_at_all_times() -> None:
    random = np.random.default_rng(5)
    position, triangle, sphere = world()
    moved = np.stack([position, position + random.uniform(-0.3, 0.3, position.shape).astype(np.float32), position])
    balls = np.stack([sphere] * 3)
    unseen = random.random(340) < 0.2
    seen = np.flatnonzero(~unseen[:300])

    def keyed(rows: np.ndarray, balls: np.ndarray) -> Bvh:
        with Team(1) as team:
            node, packet = keyed_tree(moved, rows, balls, len(rows), team)
        return Bvh(node, packet, np.zeros(0, np.int32), np.zeros((0, 3, 4)), keyed_packets=np.array([0, 3], np.int32))

    asked = rays(3000)
    found = trace(exclude_primitives(laid(keyed(triangle, balls)), unseen, unseen).bvh, asked)
    expected = trace(keyed(triangle[seen], balls[:, ~unseen[300:]]), asked)[0][:, 0] >= 0
    assert (found[0][:, 0] >= 0).sum() > expected.sum() > 500
    assert ((found[0][:, 1] >= 0) == expected).all()
    assert (found[1] == expected).all()
