"""Tests that mesh attributes with non-finite values are dropped with a count, in every format."""

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from renderer.scene.load import read

PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
property float nx
property float ny
property float nz
element face 1
property list uchar int vertex_indices
end_header
0 0 0 0 0 1
1 0 0 0 nan 1
0 1 0 0 0 1
3 0 1 2
"""
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 inf\nf 1//1 2//1 3//1\n"


@pytest.mark.parametrize(("name", "text"), [("a.ply", PLY), ("a.obj", OBJ)])
def test_nonfinite_normals_are_omitted(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    description = read(tmp_path, name)
    assert all(mesh.normals is None or np.isfinite(mesh.normals).all() for mesh in description.meshes)
    assert sum(len(description.meshes[each.mesh].triangles) for each in description.instances) == 1


def test_nonfinite_usd_normals_are_omitted(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    mesh = UsdGeom.Mesh.Define(stage, "/m")
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreateNormalsAttr([(0, 0, 1), (0, float("nan"), 1), (0, 0, 1)])
    stage.GetRootLayer().Save()
    description = read(tmp_path, "a.usda")
    assert description.meshes[0].normals is None or np.isfinite(description.meshes[0].normals).all()
    assert any("left out (1)" in warning for warning in description.warnings)
