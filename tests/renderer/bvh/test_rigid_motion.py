"""Tests of the keys of moving rigid bodies and of their interpolated transforms."""

import math

import numpy as np
import pytest

from renderer.bvh.layout import KEY_COLUMNS
from renderer.bvh.motion import ANGLE, PLACE, POINT, STRETCH, TURN, inverse_of, transform_at
from renderer.bvh.rigid_motion import largest_rotation, motion_keys, polar
from renderer.jit import entry


@entry
def _places(keys, time, out):
    for i in range(len(time)):
        out[i, 0], out[i, 1], out[i, 2] = transform_at(keys, 0, len(keys), time[i])


@entry
def _inverses(keys, time, out):
    for i in range(len(time)):
        out[i, 0], out[i, 1], out[i, 2] = inverse_of(transform_at(keys, 0, len(keys), time[i]))


def _filled(kernel, keys, time):
    time = np.atleast_1d(np.asarray(time, np.float32))
    out = np.empty((len(time), 3, 4))
    kernel(np.ascontiguousarray(keys), time, out)
    return out


def places(keys, time):
    """Returns the transforms interpolated between keys at the given shutter times."""
    return _filled(_places, keys, time)


def inverses(keys, time):
    """Returns the inverses of the transforms interpolated between keys at the given shutter times."""
    return _filled(_inverses, keys, time)


def about(axis, angle):
    """Returns the matrix of a rotation about an axis, by Rodrigues' formula."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def placed(matrix, offset):
    return np.concatenate([matrix, np.reshape(offset, (3, 1))], axis=1)


@pytest.mark.parametrize("squeeze", [1.0, 1e-3, 1e5])
def test_polar_decomposition_of_a_matrix(squeeze):
    random = np.random.default_rng(1)
    matrix = random.normal(size=(50, 3, 3)) @ np.diag([squeeze, 1, 1])
    turn, stretch = polar(matrix)
    np.testing.assert_allclose(turn @ turn.transpose(0, 2, 1), np.broadcast_to(np.eye(3), turn.shape), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(turn), 1, atol=1e-9)
    np.testing.assert_allclose(turn @ stretch, matrix, atol=1e-9 * max(squeeze, 1))
    np.testing.assert_array_equal(stretch, stretch.transpose(0, 2, 1))
    values = np.linalg.eigvalsh(stretch)
    assert ((values > 0).all(axis=1) | (values < 0).all(axis=1)).all(), "what mirrors has a stretch that does"


@pytest.mark.long
def test_rotation_about_a_distant_axis_between_keys():
    """A body that rotates about an axis away from the origin does so between its keys as well.

    It makes 3/4 of a turn in four keys, and is also mirrored and scaled.
    """
    axis, through, shape = (1, 2, -0.5), np.array([3.0, -1.0, 2.0]), np.diag([1.0, -2.0, 0.5])

    def at(share):
        turn = about(axis, 1.5 * math.pi * share)
        return placed(turn @ shape, through - turn @ through)

    keys = motion_keys(np.array([[at(k / 3) for k in range(4)]]))[0]
    assert largest_rotation(keys[None]) == pytest.approx(math.pi / 2)
    time = np.linspace(0, 1, 41)
    found, back = places(keys, time), inverses(keys, time)
    np.testing.assert_allclose(found, [at(float(np.float32(t))) for t in time], atol=1e-6)
    whole = np.concatenate([found, np.broadcast_to([[[0, 0, 0, 1]]], (41, 1, 4))], axis=1)
    np.testing.assert_allclose(back, np.linalg.inv(whole)[:, :3], atol=1e-9)


@pytest.mark.long
def test_spinning_body_translates_along_its_centre():
    def at(share):
        return placed(about((0, 0, 1), 2 * math.pi * share), (4 * share, 0, 1))

    keys = motion_keys(np.array([[at(k / 8) for k in range(9)]]))[0]
    np.testing.assert_allclose(keys[:, POINT : POINT + 3], 0, atol=1e-6)
    time = np.linspace(0, 1, 33)
    np.testing.assert_allclose(places(keys, time), [at(float(np.float32(t))) for t in time], atol=1e-6)


def test_two_keys_move_the_origin_in_a_straight_line():
    first, last = placed(np.eye(3), (0, 0, 0)), placed(3 * about((0, 1, 0), 2.0), (2, 0, 0))
    keys = motion_keys(np.array([[first, last]]))[0]
    assert keys.shape == (2, KEY_COLUMNS)
    assert keys[0, ANGLE] == pytest.approx(1.0)
    (found,) = places(keys, 0.5)
    np.testing.assert_allclose(found, placed(2 * about((0, 1, 0), 1.0), (1, 0, 0)), atol=1e-9)


def test_transform_at_keys_is_exact():
    random = np.random.default_rng(2)
    given = random.normal(size=(20, 5, 3, 4))
    for keys, expected in zip(motion_keys(given), given, strict=True):
        found = places(keys, np.linspace(0, 1, 5))
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-7)
        turns = keys[:, TURN : TURN + 4]
        assert ((turns[1:] * turns[:-1]).sum(axis=1) >= 0).all(), "the shorter way"
        assert np.isfinite(keys[:, PLACE : STRETCH + 6]).all()
