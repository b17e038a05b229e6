"""Tests of how finely fibres are divided into lines."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.scene.readers.polylines import by_stride
from renderer.scene.readers.strands import Strand, strands_mesh


def arcs(bends: list[float], points: int = 13) -> np.ndarray:
    """Returns (N, points, 3) arcs of unit length that turn by these angles."""
    share = np.linspace(0, 1, points)
    return np.stack([np.column_stack([np.sin(b * share), 1 - np.cos(b * share), 0 * share]) / b for b in bends])


def test_fibres_keep_the_points_by_which_they_bend() -> None:
    """Each strand keeps the fewest points that leave it within the tolerance, a quarter of its radius."""
    bends = [1e-3, 0.5, 1.1, 1.6, 3.0, 0.5]
    lines, radii = arcs(bends), np.full((6, 13), 0.02)
    radii[5] *= 100
    found = {int(n): kept.step for k, kept in by_stride(lines, radii, 6, 0.25, 6) for n in k}
    for n, bend in enumerate(bends):  # the sagitta of a chord of the arc's nth part
        sagittas = {stride: (1 - np.cos(bend * stride / 24)) / bend for stride in (6, 3, 2, 1)}
        assert found[n] == next(s for s, far in sagittas.items() if s == 1 or far <= 0.25 * radii[n, 0])
    assert {*found.values()} == {6, 3, 2, 1}
    capped = {int(n): kept.step for k, kept in by_stride(lines, radii, 6, 0.25, 3) for n in k}
    (whole,) = by_stride(lines, radii, 6, None, 3)
    assert whole[0].tolist() == list(range(6)) and whole[1].step == 2
    assert capped == {n: max(step, 2) for n, step in found.items()}


def test_only_hair_is_thinned() -> None:
    strands = [Strand(line, np.full(13, 0.02), steps=6) for line in arcs([1e-3, 0.25, 3.0])]
    fibres, wires = strands_mesh(strands, fibres=True), strands_mesh(strands)
    assert len(fibres.triangles) == 2 * 12 * (2 + 4 + 12)
    assert len(wires.triangles) == 3 * (2 * 12 * 12 + 2 * 10)
    assert len(strands_mesh([Strand(*strand[:2]) for strand in strands], fibres=True).triangles) == 2 * 12 * 36
    assert fibres.diameters is not None
    np.testing.assert_allclose(fibres.diameters, 0.04 * np.pi / 12 / np.sin(np.pi / 12))
    ends = [np.linalg.norm(fibres.positions - strand.points[-1], axis=1).min() for strand in strands]
    assert ends == pytest.approx([fibres.diameters[0] / 2] * 3, rel=1e-4)
