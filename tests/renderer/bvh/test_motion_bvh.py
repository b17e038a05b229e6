"""Tests of trees over moving primitives: each box encloses its primitives during all of the time that the shutter is open."""

import numpy as np
import pytest

from renderer.bvh.layout import ROW_CHILD
from renderer.bvh.motion_bvh import keyed_tree, motion_boxes
from renderer.bvh.rigid_motion import motion_keys
from renderer.bvh.traverse import any_hit, closest_hit, new_stack
from renderer.jit import entry, subroutine
from renderer.reference import Packed, by_reference
from renderer.scene.compile import compile_scene
from renderer.threads import Team
from tests.renderer.bvh.test_rigid_motion import about, placed, places
from tests.renderer.test_motion_blur import everything, merged_over_shutter


@pytest.mark.long
@pytest.mark.parametrize("turns", [0.02, 0.3, 0.9])
def test_moving_body_stays_within_its_bounds(turns):
    random = np.random.default_rng(3)
    for _ in range(10):
        axis, shape, offsets = random.normal(size=3), random.normal(size=(3, 3)), random.normal(size=(2, 3)) * 3
        way = [placed(about(axis, 2 * np.pi * turns * k / 2) @ shape, offsets[0] + offsets[1] * k) for k in range(3)]
        (keys,) = motion_keys(np.array([way]))
        low, high = -random.random(3), random.random(3)
        box = motion_boxes(np.array([[low, high]]), keys)
        points = np.array([np.where(which, high, low) for which in np.ndindex(2, 2, 2)])
        there = places(keys, np.linspace(0, 1, 400))
        found = (points @ there[:, :, :3].transpose(0, 2, 1) + there[:, None, :, 3]).reshape(-1, 3)
        assert (found >= box[0]).all()
        assert (found <= box[1]).all()
        size = np.ptp(found, axis=0)
        assert (box[1] - box[0] <= size * 1.02 + 0.02 * size.max()).all(), "and the box is no larger than it has to be"


def test_packets_are_stored_for_each_key():
    random = np.random.default_rng(4)
    position = random.normal(size=(3, 60, 3)).astype(np.float32)
    triangle = np.arange(60, dtype=np.int32).reshape(-1, 3)
    sphere = random.random((3, 5, 4)).astype(np.float32)
    with Team(1) as team:
        node, packet = keyed_tree(position, triangle, sphere, 20, team)
    child = node[:, ROW_CHILD].view(np.int32)
    leaf = ~child[(child < 0) & (node[:, 0] <= node[:, 1])]
    assert sorted(leaf >> 2) == list(range(0, len(packet), 3))
    for first in leaf >> 2:
        for lane in np.flatnonzero(~np.isnan(packet[first, 0])):
            number = packet[first, 9, lane : lane + 1].view(np.int32)[0]
            for k in range(3):
                own = packet[first + k, :, lane]
                if number < 20:
                    np.testing.assert_array_equal(own[:9], position[k, triangle[number]].reshape(-1))
                else:
                    np.testing.assert_array_equal(own[:4], sphere[k, number - 20])


@subroutine
def _trace_all(bvh, stack, o, d, time, t, number, shadow):
    for i in range(len(o)):
        origin, direction = (o[i, 0], o[i, 1], o[i, 2]), (d[i, 0], d[i, 1], d[i, 2])
        hit = closest_hit(bvh, stack, origin, direction, np.float32(1e6), time[i])
        t[i], number[i] = hit.t, hit.primitive
        shadow[i] = any_hit(bvh, stack, origin, direction, np.float32(1e6), time[i])


@entry
def _trace(bvh, stack, o, d, time, t, number, shadow):
    _trace_all(by_reference(bvh), stack, o, d, time, t, number, shadow)


def test_hits_on_moving_primitives_match_brute_force():
    random = np.random.default_rng(5)
    count = 4000
    o = random.normal(size=(count, 3)).astype(np.float32) * 4
    d = (random.uniform(-2, 2, (count, 3)) - o).astype(np.float32)
    time = random.random(count).astype(np.float32)
    found = []
    for brute in (False, True):
        bvh = compile_scene(merged_over_shutter(everything), brute=brute).bvh
        assert len(bvh.motion) > 0
        assert bvh.keyed_packets[0] < len(bvh.packet)
        t, number, shadow = np.empty(count, np.float32), np.empty(count, np.int32), np.empty(count, bool)
        _trace(Packed(bvh), new_stack(), o, d, time, t, number, shadow)
        found.append((t, number, shadow))
    (t, number, shadow), (far, theirs, blocked) = found
    assert 0.3 < (theirs >= 0).mean() < 0.95
    np.testing.assert_array_equal(number, theirs)
    np.testing.assert_array_equal(t, far)
    np.testing.assert_array_equal(shadow, blocked)
    np.testing.assert_array_equal(shadow, number >= 0)
