"""Tests of USD: subdivision surfaces, curves and points."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, Vt

from renderer.scene.readers.usd.meshes import UsedPrimvars, read_mesh
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.subdivision.catmull_clark import Cage, limit, refined
from renderer.scene.subdivision.polygons import Faces
from tests.renderer.scene.usd_files import CUBE, QUADS, TYPES, cube, mesh, read, stage, world

NONE = np.zeros((0, 2), np.int64), np.zeros(0), np.zeros(0, np.int64), np.zeros(0)


def cage(points=CUBE, counts=(4,) * 6, corners=QUADS, sharp=NONE):
    return Cage(np.array(points, float), Faces(np.array(counts), np.array(corners)), *sharp)


def test_catmull_clark_level_of_a_cube():
    finer, _, parent = refined(cage(), [])
    np.testing.assert_allclose(np.abs(finer.points[:8]), 5 / 9)
    np.testing.assert_allclose(sorted(np.abs(finer.points[8])), (0, 0.75, 0.75))
    np.testing.assert_allclose(finer.points[20:], [CUBE[QUADS[4 * f : 4 * f + 4]].mean(axis=0) for f in range(6)])
    assert np.bincount(parent).tolist() == [4] * 6


def test_limit_equals_many_levels():
    rng = np.random.default_rng(2)
    edges = np.array([(0, 1), (1, 2), (2, 3), (3, 0)])
    start = cage(CUBE + rng.normal(size=CUBE.shape) * 0.2, sharp=(edges, np.full(4, 10.0), np.array([6]), np.array([10.0])))
    first, _, _ = refined(start, [])
    fine = first
    for _ in range(4):
        fine, _, _ = refined(fine, [])
    deep, near = limit(fine)[: len(first.points)], limit(first)
    np.testing.assert_allclose(deep, near, atol=1e-9)
    assert np.abs(fine.points[: len(first.points)] - near).max() < 0.01


OCTAHEDRON = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], float)
EIGHT = np.array([(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]).reshape(-1)


@pytest.mark.parametrize("is_smooth, share", [(False, 0.5), (True, 0.94)])
def test_smooth_triangle_subdivision_rule(is_smooth, share):
    made = Usd.Stage.CreateInMemory()
    one = mesh(made, "/m", OCTAHEDRON, [3] * 8, EIGHT.tolist(), scheme="catmullClark")
    one.CreateTriangleSubdivisionRuleAttr("smooth" if is_smooth else "catmullClark")
    start = replace(cage(OCTAHEDRON, (3,) * 8, EIGHT), has_smooth_triangles=is_smooth)
    finer = refined(start, [])[0]
    # The mean of both ends is (1/2, 1/2, 0), that of both face centres (1/3, 1/3, 0).
    np.testing.assert_allclose(np.abs(finer.points[6:18]).max(axis=1), 1 / 2 - share / 6)
    deep = limit(refined(finer, [])[0])
    found = read_mesh(one.GetPrim(), [UsedPrimvars()], None, Usd.TimeCode(0), Notes())[0]
    np.testing.assert_allclose(np.sort(found.positions, axis=0), np.sort(deep, axis=0), atol=1e-6)


def test_loop_level_of_an_octahedron():
    finer, _, parent = refined(replace(cage(OCTAHEDRON, (3,) * 8, EIGHT), is_loop=True), [])
    # At valence 4 each neighbour has weight (5/8 - (3/8)^2) / 4, and neighbours sum to 0; an edge point is 3/8 of both ends and
    # 1/8 of both opposite vertices.
    np.testing.assert_allclose(finer.points[:6], OCTAHEDRON * (1 - (5 / 8 - 9 / 64)))
    np.testing.assert_allclose(np.sort(np.abs(finer.points[6:]), axis=1), [(0, 3 / 8, 3 / 8)] * 12)
    assert np.bincount(parent).tolist() == [4] * 8
    a, b, c = finer.points[finer.faces.corners.reshape(-1, 3)].transpose(1, 0, 2)
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) > 0).all()


def test_loop_limit_equals_many_levels():
    rng = np.random.default_rng(3)
    edges = np.array([(0, 2), (2, 1), (1, 3), (3, 0)])
    for sharp in ((edges, np.full(4, 10.0), np.array([4]), np.array([10.0])), NONE):
        start = replace(cage(OCTAHEDRON + rng.normal(size=(6, 3)) * 0.2, (3,) * 8, EIGHT, sharp), is_loop=True)
        fine = start
        for _ in range(5):
            fine, _, _ = refined(fine, [])
        np.testing.assert_allclose(limit(fine)[:6], limit(start), atol=1e-9)
        assert 1e-6 < np.abs(fine.points[:6] - limit(start)).max() < 0.01


def test_loop_meshes_with_uvs_and_non_triangles(tmp_path):
    made = stage(tmp_path / "a.usda")
    points = [(x + 0.2 * np.sin(2 * y), y + 0.1 * x * x, 0) for y in range(4) for x in range(4)]
    corners = [4 * y + x + v for y in range(3) for x in range(3) for v in (0, 1, 5, 0, 5, 4)]
    one = mesh(made, "/m", points, [3] * 18, corners, scheme="loop")
    uvs = UsdGeom.PrimvarsAPI(one).CreatePrimvar("st", TYPES.TexCoord2fArray, "faceVarying")
    uvs.Set([Gf.Vec2f(*map(float, points[v][:2])) for v in range(16)])
    uvs.SetIndices(corners)
    found, uvs = refined_uvs(one)
    np.testing.assert_allclose(uvs, found, atol=1e-5)
    assert len(found) == 13 * 13
    # Inside, at valence 6, the limit is half the point and a twelfth of each neighbour.
    ring = np.array(points)[[5, 0, 1, 4, 6, 9, 10]][:, :2]
    assert np.linalg.norm(found - (ring[0] / 2 + ring[1:].sum(axis=0) / 12), axis=1).min() < 1e-6

    mesh(made, "/quad", scheme="loop")
    made.GetRootLayer().Save()
    description = read(tmp_path / "a.usda")
    assert [len(m.triangles) for m in description.meshes] == [18 * 16, 2]
    assert [w for w in description.warnings if "Loop" in w and "/quad" in w and "/m" not in w]


def test_semi_sharp_creases_are_refined():
    sharp = np.array([(0, 1), (1, 2), (2, 3), (3, 0)]), np.full(4, 2.5), np.zeros(0, np.int64), np.zeros(0)
    one, deep = cage(sharp=sharp), cage(sharp=sharp)
    for _ in range(2):
        one = refined(one, [])[0]
    for _ in range(5):
        deep = refined(deep, [])[0]
    np.testing.assert_allclose(limit(one), limit(deep)[: len(one.points)], atol=1e-6)


def test_crease_sharpness():
    edges = np.unique(
        np.sort(np.array([(QUADS[4 * f + k], QUADS[4 * f + (k + 1) % 4]) for f in range(6) for k in range(4)]), 1), axis=0
    )

    def corner(sharpness, levels=4):
        found = cage(sharp=(edges, np.full(len(edges), sharpness), *NONE[2:]))
        for _ in range(levels):
            found, _, _ = refined(found, [])
        return np.abs(found.points[:8]).mean()

    assert corner(10.0) == 1
    assert [corner(s) for s in (0.0, 0.5, 1.0, 2.0)] == sorted(corner(s) for s in (0.0, 0.5, 1.0, 2.0))
    assert corner(2.0) < 1


@pytest.mark.parametrize("scheme", ["catmullClark", "none", None])
def test_default_subdivision_scheme(tmp_path, scheme):
    made = stage(tmp_path / "a.usda")
    for name in ("bare", "normals"):
        box = cube(made, f"/{name}", scheme=scheme or "none")
        if scheme is None:
            box.GetSubdivisionSchemeAttr().Clear()
        if name == "normals":
            box.CreateNormalsAttr(Vt.Vec3fArray([Gf.Vec3f(*map(float, p)) for p in CUBE]))
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    counts = [len(found.meshes[i.mesh].triangles) for i in found.instances]
    assert counts == {"catmullClark": [192, 192], "none": [12, 12], None: [192, 12]}[scheme]
    if scheme != "none":
        smooth = found.meshes[0]
        outward = smooth.positions / np.linalg.norm(smooth.positions, axis=1, keepdims=True)
        unit = smooth.normals / np.linalg.norm(smooth.normals, axis=1, keepdims=True)
        assert (outward * unit).sum(axis=1).min() > 0.9


def test_boundary_corner_rules(tmp_path):
    made = stage(tmp_path / "a.usda")
    for name in ("edgeAndCorner", "edgeOnly"):
        mesh(made, f"/{name}", scheme="catmullClark").CreateInterpolateBoundaryAttr(name)
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    spans = [np.ptp(world(found, k).reshape(-1, 3)[:, :2], axis=0) for k in (0, 1)]
    np.testing.assert_allclose(spans[0], 1, atol=1e-6)
    np.testing.assert_allclose(spans[1], 11 / 12, atol=1e-6)  # a closed cubic B-spline around a square


def de_boor(points, u):
    return (np.array([(1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3]) / 6) @ points


@pytest.mark.parametrize(("kind", "basis", "wrap"), [("linear", "bezier", "nonperiodic"), ("cubic", "bezier", "nonperiodic"),
                                                      ("cubic", "bspline", "nonperiodic"), ("cubic", "catmullRom", "pinned"),
                                                      ("cubic", "bspline", "periodic")])  # fmt: skip
def test_curves_become_tubes(tmp_path, kind, basis, wrap):
    made = stage(tmp_path / "a.usda")
    rng = np.random.default_rng(4)
    points = rng.normal(size=(2, 4, 3)).astype(np.float32)
    curves = UsdGeom.BasisCurves.Define(made, "/c")
    curves.CreateTypeAttr(kind)
    curves.CreateBasisAttr(basis)
    curves.CreateWrapAttr(wrap)
    curves.CreateCurveVertexCountsAttr([4, 4])
    curves.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.reshape(-1, 3)))
    curves.CreateWidthsAttr([0.02])
    curves.SetWidthsInterpolation("constant")
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda").meshes[0]
    p = points[1].astype(float)
    through = {
        "linear": list(p),
        "bezier": [p[0], p[3], (p[0] + 3 * p[1] + 3 * p[2] + p[3]) / 8],
        "bspline": [de_boor(p, 0.0), de_boor(p, 0.5)] if wrap == "nonperiodic" else [de_boor(np.roll(p, -2, 0), 0.5)],
        "catmullRom": list(p),
    }["linear" if kind == "linear" else basis]
    for place in through:
        away = np.linalg.norm(found.positions - place, axis=1)
        assert away.min() == pytest.approx(0.01, abs=1e-4)
        assert (away < 0.0101).sum() >= 12
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1, atol=1e-5)


def test_curve_widths_and_ribbons(tmp_path):
    made = stage(tmp_path / "a.usda")
    curves = UsdGeom.BasisCurves.Define(made, "/c")
    curves.CreateTypeAttr("cubic")
    curves.CreateBasisAttr("bspline")
    curves.CreateCurveVertexCountsAttr([4, 5])
    curves.CreatePointsAttr([(x, float(y), 0) for x, count in ((0, 4), (5, 5)) for y in range(count)])
    curves.CreateWidthsAttr([0.2, 0.4, 0.6, 0.8, 1.0])
    curves.SetWidthsInterpolation("varying")
    curves.CreateNormalsAttr([(0, 1, 1)] * 9)
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    x, y, z = found.meshes[0].positions.T
    np.testing.assert_allclose(z, 0, atol=1e-6)  # flat, and facing across the curve
    np.testing.assert_allclose(found.meshes[0].normals, [(0, 0, 1)] * len(x), atol=1e-6)
    p = found.meshes[0].positions[found.meshes[0].triangles]
    assert (np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])[:, 2] > 0).all()
    for middle, ends in ((0, (0.2, 0.4)), (5, (0.6, 1.0))):
        own = np.abs(x - middle) < 2
        low, high = y[own].min(), y[own].max()
        got = [np.ptp(x[own & (np.abs(y - end) < 0.01)]) for end in (low, high)]
        np.testing.assert_allclose(got, ends, atol=1e-4)
    curves.GetWidthsAttr().Set([0.2, 0.4, 0.6])
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    assert np.ptp(found.meshes[0].positions[found.meshes[0].positions[:, 0] < 2, 0]) == pytest.approx(0.2, abs=1e-4)
    assert any("number of widths is wrong" in each for each in found.warnings)


@pytest.mark.parametrize(("wrap", "fits"), [("nonperiodic", (4, 7)), ("pinned", (4, 7)), ("periodic", (3, 6))])
def test_surplus_points_of_curves_are_counted(tmp_path, wrap, fits):
    made = stage(tmp_path / "a.usda")
    curves = UsdGeom.BasisCurves.Define(made, "/c")
    curves.CreateWrapAttr(wrap)
    counts = [*fits, fits[0] + 1, fits[1] + 2]
    curves.CreateCurveVertexCountsAttr(counts)
    curves.CreatePointsAttr([(x, float(y), 0) for x, count in enumerate(counts) for y in range(count)])
    made.GetRootLayer().Save()
    assert any(each.startswith("2 Bezier curves have points beyond") for each in read(tmp_path / "a.usda").warnings)
    curves.GetBasisAttr().Set("bspline")
    made.GetRootLayer().Save()
    assert not any("Bezier" in each for each in read(tmp_path / "a.usda").warnings)


def test_curves_of_many_lengths_are_left_out_beyond_the_limit(tmp_path, monkeypatch):
    made = stage(tmp_path / "a.usda")
    curves = UsdGeom.BasisCurves.Define(made, "/c")
    curves.CreateBasisAttr("bspline")
    curves.CreateCurveVertexCountsAttr([9, 4, 4])
    curves.CreatePointsAttr([(0, float(y), 0) for y in range(17)])
    made.GetRootLayer().Save()
    whole = read(tmp_path / "a.usda")
    monkeypatch.setattr("renderer.scene.readers.usd.curves.MAX_STEPS", 6 + 6 * 6 - 1)
    found = read(tmp_path / "a.usda")
    assert len(found.meshes[0].positions) == 2 * (7 + 2) * 12 < len(whole.meshes[0].positions)
    assert any("beyond the limit" in each for each in found.warnings)


def lattice(made, how, split=False):
    """Adds a flat mesh of 3 x 3 quads to the stage, as a Catmull-Clark surface whose UVs equal its points; returns the mesh.

    how: the interpolation of the UVs. split: moves the UVs of one column of faces away from the others.
    """
    points = [(x + 0.2 * np.sin(2 * y), y + 0.1 * x * x, 0) for y in range(4) for x in range(4)]
    corners = [v for y in range(3) for x in range(3) for v in (4 * y + x, 4 * y + x + 1, 4 * y + x + 5, 4 * y + x + 4)]
    moved = [10 * (split and k // 4 % 3 == 2) for k in range(len(corners))]
    values = [(points[v][0] + m, points[v][1]) for v, m in zip(corners, moved, strict=True)]
    kinds = sorted(set(values))
    one = mesh(made, "/m", points, [4] * 9, corners, scheme="catmullClark")
    one.CreateFaceVaryingLinearInterpolationAttr(how)
    uvs = UsdGeom.PrimvarsAPI(one).CreatePrimvar("st", TYPES.TexCoord2fArray, "faceVarying")
    uvs.Set([Gf.Vec2f(*map(float, v)) for v in kinds])
    uvs.SetIndices([kinds.index(v) for v in values])
    return one


def refined_uvs(prim):
    found = read_mesh(prim.GetPrim(), [UsedPrimvars(("st",))], None, Usd.TimeCode(0), Notes())[0]
    return found.positions[:, :2], found.uvs * (1, -1) + (0, 1)


@pytest.mark.parametrize("how", ["cornersOnly", "cornersPlus1", "cornersPlus2", "none"])
def test_shared_uvs_are_refined_like_points(how):
    made = Usd.Stage.CreateInMemory()
    points, uvs = refined_uvs(lattice(made, how))
    np.testing.assert_allclose(uvs, points, atol=1e-5)


def test_uv_borders_and_linear_uvs():
    made = Usd.Stage.CreateInMemory()
    points, uvs = refined_uvs(lattice(made, "cornersPlus1", split=True))
    # Along the cut the border is a cubic B-spline of its points: at the second the limit is (a + 4 b + c) / 6.
    a, b, c = (np.array((2 + 0.2 * np.sin(2 * y), y + 0.4)) for y in range(3))
    for own in ((a + 4 * b + c) / 6, (a + 4 * b + c) / 6 + (10, 0)):
        assert np.linalg.norm(uvs - own, axis=1).min() < 1e-5
    points, uvs = refined_uvs(lattice(made, "all"))
    for corner in (np.array((1 + 0.2 * np.sin(2.0), 1.1)), np.array((2 + 0.2 * np.sin(2.0), 1.4))):
        assert np.linalg.norm(uvs - corner, axis=1).min() < 1e-5
    assert np.abs(uvs - points).max() > 0.01


def test_uninterpolated_border_has_no_faces():
    made = Usd.Stage.CreateInMemory()
    prim = lattice(made, "all")
    inside, _ = refined_uvs(prim)
    prim.CreateInterpolateBoundaryAttr("none")
    kept, _ = refined_uvs(prim)
    assert np.ptp(kept[:, 0]) < np.ptp(inside[:, 0]) / 2


def test_points_become_spheres_by_width_and_color(tmp_path):
    made = stage(tmp_path / "a.usda", "Z", 0.5)
    points = UsdGeom.Points.Define(made, "/p")
    points.CreatePointsAttr([(0, 0, 0), (1, 2, 3), (4, 5, 6)])
    points.CreateWidthsAttr([1.0, 2.0, 4.0])
    points.CreateDisplayColorPrimvar("vertex").Set([(1, 0, 0), (0, 1, 0), (1, 0, 0)])
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    assert [s.radius for s in found.spheres] == [0.25, 0.5, 1]
    np.testing.assert_allclose(found.spheres[1].center, (0.5, 1.5, -1), atol=1e-6)
    assert [found.materials[s.material].base_color for s in found.spheres] == [(1, 0, 0), (0, 1, 0), (1, 0, 0)]
