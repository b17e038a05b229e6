"""Tests of subdivision outside of USD: in scene files, of mesh files, and of FBX."""

import json
from dataclasses import replace

import numpy as np
import pytest

from renderer.scene.deduplicate import unique_threes
from renderer.scene.load import read
from renderer.scene.readers import shapes
from renderer.scene.subdivision.meshes import quads_of, subdivided
from renderer.scene.watertight import is_closed
from tests.renderer.scene.fbx_text import TRIANGLE, fbx

CUBE = "positions: [[-1,-1,-1],[1,-1,-1],[1,1,-1],[-1,1,-1],[-1,-1,1],[1,-1,1],[1,1,1],[-1,1,1]]"
FACES = [(3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (2, 3, 7, 6), (1, 2, 6, 5), (3, 0, 4, 7)]
OBJ = "\n".join(
    [f"v {x} {y} {z}" for x, y, z in json.loads(CUBE.removeprefix("positions: "))]
    + ["f " + " ".join(str(k + 1) for k in face) for face in FACES]
)


def points_of(mesh):
    """Returns the distinct positions of a mesh, ordered."""
    first, _ = unique_threes(mesh.positions + np.float32(0))
    found = mesh.positions[first]
    return found[np.lexsort(np.round(found, 4).T)]


def test_cubes_of_all_sources_are_one_surface(tmp_path):
    """A cube as faces, as the built-in shape and as an OBJ file becomes the same surface: round, closed and smooth.

    Its corners are at the limit of Catmull and Clark's surface, which is half of the cube's there (Halstead et al. 1993).
    """
    (tmp_path / "cube.obj").write_text(OBJ)
    faces = str([list(face) for face in FACES])
    (tmp_path / "s.yaml").write_text(
        f"shapes:\n- {{type: faces, {CUBE}, faces: {faces}, subdivision: 1}}\n- {{type: cube, subdivision: 1}}\n"
        "- {type: mesh, file: cube.obj, subdivision: 1}\n"
    )
    meshes = read(tmp_path, "s.yaml").meshes
    expected = points_of(meshes[0])
    assert len(expected) == 26
    np.testing.assert_allclose(np.abs(expected).min(axis=1).max(), 0.5, atol=1e-6)
    for mesh in meshes:
        np.testing.assert_allclose(points_of(mesh), expected, atol=1e-6)
        assert is_closed(mesh.positions, mesh.triangles)
        outward = mesh.positions / np.linalg.norm(mesh.positions, axis=1, keepdims=True)
        assert (np.sum(outward * mesh.normals, axis=1) > 0.95).all()


def test_quads_of_halves():
    """Quads are found again whatever their diagonal and first corners; other triangles are no quads."""
    rng = np.random.default_rng(1)
    cube = shapes.cube("c")
    turned = np.stack([np.roll(three, rng.integers(3)) for three in cube.triangles])
    quads = quads_of(replace(cube, triangles=turned)).corners.reshape(-1, 4)
    assert {frozenset(quad) for quad in quads.tolist()} == {frozenset(range(4 * i, 4 * i + 4)) for i in range(6)}
    assert quads_of(replace(cube, triangles=cube.triangles[1:])) is None
    assert quads_of(replace(cube, triangles=cube.triangles[[0, 2, 1, 3]])) is None


def test_triangles_are_subdivided_after_loop():
    """A tetrahedron stays closed, and its corners move to the limit of Loop's surface, a fifth of their distance and more."""
    corners = np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)], np.float32)
    tetrahedron = replace(
        shapes.quad("t"), positions=corners, triangles=np.array([(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)], np.int32)
    )
    mesh = subdivided(replace(tetrahedron, uvs=None, normals=None), 2)
    assert len(mesh.triangles) == 4 * 16
    assert is_closed(mesh.positions, mesh.triangles)
    assert 0.2 < np.linalg.norm(mesh.positions, axis=1).min() < np.linalg.norm(mesh.positions, axis=1).max() < 1


def test_uvs_keep_their_borders(tmp_path):
    """Each face of the built-in cube keeps the whole texture."""
    mesh = subdivided(shapes.cube("c"), 2)
    assert mesh.uvs.min() == 0
    assert mesh.uvs.max() == 1
    assert len(mesh.triangles) == 6 * 16 * 2


FBX_CUBE = """
	Geometry: 10, "Geometry::tri", "Mesh" {
		Vertices: *24 { a: -1,-1,-1,1,-1,-1,1,1,-1,-1,1,-1,-1,-1,1,1,-1,1,1,1,1,-1,1,1 }
		PolygonVertexIndex: *24 { a: 3,2,1,-1,4,5,6,-8,0,1,5,-5,2,3,7,-7,1,2,6,-6,3,0,4,-8 }
		GeometryVersion: 124
		%s
		LayerElementMaterial: 0 {
			Version: 101
			MappingInformationType: "AllSame"
			ReferenceInformationType: "IndexToDirect"
			Materials: *1 { a: 0 }
		}
		Layer: 0 {
			Version: 100
			LayerElement:  { Type: "LayerElementMaterial" TypedIndex: 0 }
		}
	}
"""


def test_fibres_of_hair_are_not_subdivided():
    """Their vertices have diameters and tangents, with which the kernel finds the fibres."""
    cube = shapes.cube("c")
    fibres = replace(cube, diameters=np.ones(len(cube.positions), np.float32))
    assert subdivided(fibres, 1) is fibres
    assert len(subdivided(cube, 1).triangles) > len(cube.triangles)


@pytest.mark.parametrize(("smoothness", "levels", "count"), [(2, 2, 192), (2, 1, 48), (0, 2, 12), (2, 0, 12)])
def test_fbx_subdivision(tmp_path, smoothness, levels, count):
    """An FBX mesh has the levels that its file renders it with, if it is shown smooth."""
    inside = f"Smoothness: {smoothness}\n\t\tPreviewDivisionLevels: 1\n\t\tRenderDivisionLevels: {levels}"
    (tmp_path / "a.fbx").write_text(fbx("", []).replace(TRIANGLE, FBX_CUBE % inside))
    found = read(tmp_path, "a.fbx")
    mesh = found.meshes[0]
    assert len(mesh.triangles) == count
    assert not any("subdivision" in warning for warning in found.warnings)
    if levels and smoothness:
        expected = subdivided(shapes.cube("c"), levels)
        np.testing.assert_allclose(points_of(mesh), points_of(expected), atol=1e-5)
        assert np.abs(mesh.normals).max() > 0
