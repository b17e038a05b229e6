import numpy as np

from renderer.scene.readers import shapes
from renderer.scene.watertight import is_closed


def test_meshes_with_seam_vertices_are_closed():
    for mesh in (shapes.cube("c"), shapes.lathe("l", [(0, -1), (1, -0.5), (1, 0.5), (0, 1)], 24)):
        assert is_closed(mesh.positions, mesh.triangles)
        assert not is_closed(mesh.positions, mesh.triangles[1:])


def test_sheets_and_empty_meshes_are_not_closed():
    for mesh in (shapes.quad("q"), shapes.disk("d"), shapes.lathe("t", [(1, -1), (1, 1)], 24)):
        assert not is_closed(mesh.positions, mesh.triangles)
    assert not is_closed(np.zeros((3, 3), np.float32), np.zeros((0, 3), np.int32))


def test_reversed_face_makes_a_mesh_open():
    mesh = shapes.cube("c")
    mesh.triangles[0] = mesh.triangles[0, ::-1]
    assert not is_closed(mesh.positions, mesh.triangles)


def test_triangles_without_area_do_not_affect_closedness():
    mesh = shapes.cube("c")
    assert is_closed(mesh.positions, np.concatenate([mesh.triangles, [[0, 0, 5]]]).astype(np.int32))
