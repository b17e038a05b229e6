"""Tests of how finely fibres are divided into lines."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.scene.readers.polylines import by_stride
from renderer.scene.readers.strands import Strand, strands_mesh
from renderer.scene.readers.tubes import BASES, curve_weights


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
    assert len(fibres.triangles) == 2 + 4 + 12
    assert (fibres.triangles[:, 1] == fibres.triangles[:, 2]).all() and (np.diff(fibres.triangles[:, :2]) == 1).all()
    assert len(wires.triangles) == 3 * (2 * 12 * 12 + 2 * 10)
    assert len(strands_mesh([Strand(*strand[:2]) for strand in strands], fibres=True).triangles) == 36
    assert fibres.diameters is not None
    np.testing.assert_allclose(fibres.diameters, 0.04)
    ends = [np.linalg.norm(fibres.positions - strand.points[-1], axis=1).min() for strand in strands]
    assert ends == pytest.approx([0] * 3, abs=1e-6)


def test_elliptic_fibres_have_the_ellipses_axes_and_normals() -> None:
    """Rings lie on ellipses of the aspect ratio, as wide on average as the smooth one, and the second UVs are their normals."""
    strands = [Strand(line, np.linspace(0.03, 0.01, 13), steps=6) for line in arcs([0.25, 3.0])]
    round_ones, flat = strands_mesh(strands, fibres=True), strands_mesh(strands, fibres=True, aspect=0.5)
    assert flat.uvs1 is not None and flat.normals is not None and flat.tangents is not None and flat.diameters is not None
    rings, middle = flat.positions.reshape(-1, 12, 3).astype(float), round_ones.positions[:, None].astype(float)
    major = (rings[:, :1] - middle) / np.linalg.norm(rings[:, :1] - middle, axis=2, keepdims=True)
    minor = np.cross(flat.tangents.reshape(-1, 12, 4)[:, :1, :3], major)
    x, y = ((rings - middle) * major).sum(axis=2), ((rings - middle) * minor).sum(axis=2)
    radii = flat.diameters.reshape(-1, 12) / 2
    np.testing.assert_allclose(np.hypot(x, y / 0.5), radii, rtol=1e-3)
    lengths = np.linalg.norm(np.roll(rings, 1, axis=1) - rings, axis=2).sum(axis=1)
    assert round_ones.diameters is not None
    circumference = 4.844224110  # of the ellipse with the radii 1 and 1/2
    np.testing.assert_allclose(lengths, circumference * round_ones.diameters / 2, rtol=1e-3)
    normals = np.stack([x, y / 0.25], axis=2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    np.testing.assert_allclose(flat.uvs1.reshape(-1, 12, 2), normals, atol=2e-3)
    np.testing.assert_allclose(flat.normals.reshape(-1, 12, 3), normals[..., :1] * major + normals[..., 1:] * minor, atol=2e-3)


@pytest.mark.parametrize("basis", ["linear", *BASES])
@pytest.mark.parametrize("wrap", ["nonperiodic", "pinned", "periodic"])
def test_curves_may_have_many_points(basis: str, wrap: str) -> None:
    """Control points at even distances on a line make a curve along it, whose memory is in proportion to their number."""
    count = 10_000
    points, ends = curve_weights(count, basis, wrap)
    for weights in (points, ends):
        inner = weights.interpolate(np.arange(weights.length, dtype=float)[None, :, None])[0, 20:-20, 0]
        np.testing.assert_allclose(np.diff(inner), inner[1] - inner[0], rtol=1e-6)
        assert weights.which.shape[1] <= 4
