"""Tests of how finely fibres are divided into lines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.scene.curve_meshes import with_tubes
from renderer.scene.description import Instance, Material, SceneDescription
from renderer.scene.frame_reuse import ShotCache
from renderer.scene.readers.curve_files import mesh_of_curves
from renderer.scene.readers.polylines import by_stride
from renderer.scene.readers.strands import Strand, strands_mesh
from renderer.scene.readers.tubes import BASES, MAX_STEPS, curve_segments, curve_weights, elliptic, varying_values
from tests.helpers import code_of


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
    bent = elliptic(replace(flat, normals=np.zeros_like(flat.normals)), 12, 0.5)
    assert bent.normals is not None and bent.uvs1 is not None
    assert np.isfinite(bent.normals).all() and np.isfinite(bent.uvs1).all(), "normals without a direction"


def test_curves_that_are_no_fibres_become_tubes() -> None:
    """Their tubes are as wide on average, are fibres where the material is hair that shines, and follow their colours."""
    line = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0)], float)
    mesh = strands_mesh([Strand(line, np.full(3, 0.1), steps=1)], fibres=True)
    mesh.colors = np.ones((3, 4), np.float32)
    looks = [Material(kind="hair"), Material(kind="hair", emission=(1, 1, 1)), Material()]
    made = SceneDescription(meshes=[mesh], instances=[Instance(0, material=k) for k in range(3)], materials=looks)
    cache = ShotCache()
    found = with_tubes(made, cache)
    assert [each.mesh for each in found.instances] == [0, 1, 1]
    tube = found.meshes[1]
    edge = tube.positions.reshape(2, 2, 6, 3)[0]
    around = np.linalg.norm(np.roll(edge, 1, axis=1) - edge, axis=2).sum(axis=1)
    np.testing.assert_allclose(around, 0.2 * np.pi, rtol=1e-5)
    assert tube.diameters is not None, "transmitted rays start beyond the far side"
    np.testing.assert_allclose(tube.diameters / 2, np.linalg.norm(edge[0, 0] - line[0]), rtol=1e-5)
    made.meshes[0] = replace(mesh, colors=np.zeros((3, 4), np.float32))
    colors = with_tubes(made, cache).meshes[1].colors
    assert colors is not None and not colors.any(), "of another frame"


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


@pytest.mark.parametrize("fibres", [False, True])
def test_too_many_points_are_refused_before_they_take_time(fibres: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Curves of different lengths take a step for each point, those of equal length one together; all take memory."""
    one = Strand(np.zeros((MAX_STEPS + 1, 3)), np.ones(MAX_STEPS + 1))
    with pytest.raises(SceneError) as refusal:
        strands_mesh([one], fibres)
    assert code_of(refusal.value) == "curves-too-many" and str(MAX_STEPS + 1) in str(refusal.value)
    strands = [Strand(line, np.full(13, 0.02), steps=6) for line in arcs([3.0] * 3)]
    most = 3 * 13 * (1 if fibres else 12)
    monkeypatch.setattr("renderer.scene.readers.strands.MAX_VERTICES", most)
    assert len(strands_mesh(strands, fibres).positions) >= most
    with pytest.raises(SceneError):
        strands_mesh([*strands, strands[0]], fibres)


@pytest.mark.parametrize("line", ["0 0 nan 1", "0 0 0 inf", "0 0 0", "0 x 0 1", "\0\x01"])
def test_curve_file_with_a_malformed_point_is_refused(line: str) -> None:
    whole = "0 0 0 1\n0 1 0 -1\n\n\n"
    mesh = mesh_of_curves("linear", (whole + whole.replace(" ", ",")).encode(), "h.txt", np.eye(4))
    assert len(mesh.triangles) == 2 * (2 * 12 + 2 * 10) and np.isfinite(mesh.positions).all()
    with pytest.raises(SceneError, match="line 5") as refusal:
        mesh_of_curves("linear", (whole + line).encode(), "h.txt", np.eye(4))
    assert code_of(refusal.value) == "curve-point-invalid"


@pytest.mark.parametrize("basis", ["linear", *BASES])
@pytest.mark.parametrize("wrap", ["nonperiodic", "pinned", "periodic"])
def test_sizes_of_curves_are_those_of_their_weights(basis: str, wrap: str) -> None:
    for count in range(10):
        points, ends = curve_weights(count, basis, wrap)
        assert ends.length == varying_values(count, basis, wrap)
        if basis != "linear":
            assert max(points.samples - 1, 0) == 6 * curve_segments(count, basis, wrap)
