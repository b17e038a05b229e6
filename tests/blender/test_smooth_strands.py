"""Tests that hair follows the curves through its points."""

from __future__ import annotations

import numpy as np

from blender.rayfarm_addon.scene.smooth_strands import MOST_LINES, divided, lines_per_segment


def test_strands_follow_catmull_rom_curves() -> None:
    """Straight strands keep their points; bent ones pass through theirs, and as Cycles' curves in the middle between them."""
    bent = np.array([(0, 0, 5), (1, 0, 5), (1, 1, 5), (2, 1, 5)], np.float32)
    points = np.concatenate([bent, [(0, 0, k) for k in range(3)], [(9, 9, 9)]]).astype(np.float32)
    radii, first = np.full(8, 0.05, np.float32), np.array([0, 4, 7, 8], np.int32)
    lines = lines_per_segment(points, radii, first, 100)
    assert lines.tolist() == [4, 1, 1]
    made, widths, ends = divided(points, radii, first, lines)
    assert ends.tolist() == [0, 13, 16, 17]
    np.testing.assert_allclose(made[:13:4], bent, atol=1e-6)
    np.testing.assert_allclose(made[[2, 6]], [(0.5, -1 / 16, 5), (1, 0.5, 5)], atol=1e-6)
    np.testing.assert_array_equal(made[13:], points[4:])
    np.testing.assert_allclose(widths, 0.05, rtol=1e-6)
    assert lines_per_segment(points, radii, first, 14).tolist() == [3, 1, 1]
    assert lines_per_segment(points, radii / 20, first, 100).tolist() == [MOST_LINES, 1, 1]
    assert lines_per_segment(points, radii * 20, first, 100).tolist() == [1, 1, 1]
