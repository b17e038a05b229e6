"""PLY: colours of vertices and of faces."""

import numpy as np

from renderer.scene.readers import other

HEAD = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
RGB = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
FACES = "element face 2\nproperty list uchar int vertex_indices\n"
CORNERS = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"]
COLORS = ["255 0 0", "0 128 0", "0 0 255", "255 255 255"]


def linear(byte):
    return ((byte / 255 + 0.055) / 1.055) ** 2.4


def test_colours_of_vertices_are_linear_and_multiply_white(scene):
    rows = [f"{p} {c}" for p, c in zip(CORNERS, COLORS, strict=True)]
    text = HEAD + RGB + FACES + "end_header\n" + "\n".join([*rows, "3 0 1 2", "3 0 2 3"]) + "\n"
    description = scene("a.ply", text)
    mesh = description.meshes[0]
    at = {tuple(p): c for p, c in zip(mesh.positions.tolist(), mesh.colors.tolist(), strict=True)}
    np.testing.assert_allclose(at[1, 0, 0], (0, linear(128), 0, 1), atol=1e-6)
    np.testing.assert_allclose(at[0, 1, 0], (1, 1, 1, 1))
    assert description.materials[mesh.material].base_color == (1, 1, 1)


def test_faces_of_two_colours_share_no_vertex(scene):
    text = HEAD + FACES + RGB + "end_header\n" + "\n".join([*CORNERS, "3 0 1 2 255 0 0", "3 0 2 3 0 0 128"]) + "\n"
    mesh = scene("a.ply", text).meshes[0]
    colors = mesh.colors[mesh.triangles]
    np.testing.assert_allclose(colors[0], [(1, 0, 0, 1)] * 3)
    np.testing.assert_allclose(colors[1], [(0, 0, linear(128), 1)] * 3, atol=1e-6)
    np.testing.assert_array_equal(mesh.positions[mesh.triangles[1]], [(0, 0, 0), (1, 1, 0), (0, 1, 0)])
    np.testing.assert_allclose(mesh.normals, [(0, 0, 1)] * 6, atol=1e-6)


def test_without_colours_there_are_none(scene):
    text = HEAD + FACES + "end_header\n" + "\n".join([*CORNERS, "3 0 1 2", "3 0 2 3"]) + "\n"
    description = scene("a.ply", text)
    assert description.meshes[0].colors is None
    assert description.materials[0].base_color == (0.8, 0.8, 0.8)


def test_points_without_faces_are_balls_of_their_colours(scene):
    rows = [f"{p} {c}" for p, c in zip(CORNERS, COLORS, strict=True)]
    description = scene("a.ply", HEAD + RGB + "end_header\n" + "\n".join(rows) + "\n")
    (mesh,) = description.meshes
    assert len(mesh.triangles) == 4 * 20
    center = mesh.positions.reshape(4, -1, 3).mean(axis=1)
    np.testing.assert_allclose(center, [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(mesh.positions.reshape(4, -1, 3) - center[:, None], axis=2), 1, rtol=1e-5)
    np.testing.assert_allclose(mesh.colors.reshape(4, -1, 4)[2], [(0, 0, 1, 1)] * 12)
    a, b, c = (mesh.positions[mesh.triangles[:, k]] for k in range(3))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), mesh.normals[mesh.triangles[:, 0]]) > 0).all()
    assert any("4 points are shown as balls of radius 1" in w for w in description.warnings)


def test_many_points_are_shown_in_part(scene, monkeypatch):
    monkeypatch.setattr(other, "MOST_POINTS", 2)
    description = scene("a.ply", HEAD + "end_header\n" + "\n".join(CORNERS) + "\n")
    assert len(description.meshes[0].triangles) == 2 * 20
    assert any("2 of 4 points" in w for w in description.warnings)
