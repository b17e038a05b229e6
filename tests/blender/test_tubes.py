"""Tests that hair is exported as tubes."""

from __future__ import annotations

import numpy as np

from blender.rayfarm_addon.scene.tubes import SIDES, WIDENED, tubes


def test_strand_has_an_outward_ring_at_each_point() -> None:
    points = np.array([(0, 0, 0), (0, 0, 1), (0.2, 0, 2), (5, 0, 0), (5, 1, 0.5)], np.float32)
    radii = np.array([0.1, 0.1, 0.05, 0.2, 0.0], np.float32)
    positions, normals, triangles, fibres = tubes(points, radii, np.array([0, 3, 5], np.int32))
    assert len(positions) == 5 * SIDES
    assert len(triangles) == (2 + 1) * SIDES * 2, "no tube from one strand to the next"
    rings = positions.reshape(5, SIDES, 3)
    np.testing.assert_allclose(rings.mean(axis=1), points, atol=1e-6)
    np.testing.assert_allclose(
        np.linalg.norm(rings - points[:, None], axis=2), WIDENED * np.repeat(radii[:, None], SIDES, 1), atol=1e-6
    )
    np.testing.assert_allclose(fibres[0], (0, 0, 1, 0.2 * WIDENED), atol=1e-6)
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    facing = np.cross(b - a, c - a)
    solid = np.linalg.norm(facing, axis=1) > 1e-9
    assert ((facing * normals[triangles[:, 0]]).sum(axis=1)[solid] > 0).all()
    across = np.tile(np.array((0, 3, 0.1), np.float32), (5, 1))
    across[1] = np.inf
    turned = tubes(points, radii, np.array([0, 3, 5], np.int32), across).normals.reshape(5, SIDES, 3)
    np.testing.assert_allclose(turned[0, 0], (0, 1, 0), atol=1e-6)
    np.testing.assert_allclose(turned[1], normals.reshape(5, SIDES, 3)[1], atol=1e-6)
