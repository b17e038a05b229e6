import numpy as np

from renderer.scene.readers import shapes
from renderer.scene.watertight import is_closed


def test_cubes_and_lathes_are_closed_though_their_seams_have_double_vertices():
    for mesh in (shapes.cube("c"), shapes.lathe("l", [(0, -1), (1, -0.5), (1, 0.5), (0, 1)], 24)):
        assert is_closed(mesh.positions, mesh.triangles)
        assert not is_closed(mesh.positions, mesh.triangles[1:])


def test_sheets_are_not_and_neither_is_nothing():
    for mesh in (shapes.quad("q"), shapes.disk("d"), shapes.lathe("t", [(1, -1), (1, 1)], 24)):
        assert not is_closed(mesh.positions, mesh.triangles)
    assert not is_closed(np.zeros((3, 3), np.float32), np.zeros((0, 3), np.int32))


def test_a_face_turned_around_opens_it():
    mesh = shapes.cube("c")
    mesh.triangles[0] = mesh.triangles[0, ::-1]
    assert not is_closed(mesh.positions, mesh.triangles)


def test_triangles_without_area_change_nothing():
    mesh = shapes.cube("c")
    assert is_closed(mesh.positions, np.concatenate([mesh.triangles, [[0, 0, 5]]]).astype(np.int32))
