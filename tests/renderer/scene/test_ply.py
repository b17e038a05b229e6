"""Tests of PLY files: vertex attributes besides positions, under the names that programs use."""

import struct

import numpy as np
import pytest

from renderer.scene import load
from renderer.scene.readers import points

HEAD = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
RGB = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
FACES = "element face 2\nproperty list uchar int vertex_indices\n"
CORNERS = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"]
COLORS = ["255 0 0", "0 128 0", "0 0 255", "255 255 255"]


def linear(byte):
    return ((byte / 255 + 0.055) / 1.055) ** 2.4


def test_vertex_colors_are_linear(scene):
    rows = [f"{p} {c}" for p, c in zip(CORNERS, COLORS, strict=True)]
    text = HEAD + RGB + FACES + "end_header\n" + "\n".join([*rows, "3 0 1 2", "3 0 2 3"]) + "\n"
    description = scene("a.ply", text)
    mesh = description.meshes[0]
    at = {tuple(p): c for p, c in zip(mesh.positions.tolist(), mesh.colors.tolist(), strict=True)}
    np.testing.assert_allclose(at[1, 0, 0], (0, linear(128), 0, 1), atol=1e-6)
    np.testing.assert_allclose(at[0, 1, 0], (1, 1, 1, 1))
    assert description.materials[mesh.material].base_color == (1, 1, 1)


def test_face_colors_split_vertices(scene):
    text = HEAD + FACES + RGB + "end_header\n" + "\n".join([*CORNERS, "3 0 1 2 255 0 0", "3 0 2 3 0 0 128"]) + "\n"
    mesh = scene("a.ply", text).meshes[0]
    colors = mesh.colors[mesh.triangles]
    np.testing.assert_allclose(colors[0], [(1, 0, 0, 1)] * 3)
    np.testing.assert_allclose(colors[1], [(0, 0, linear(128), 1)] * 3, atol=1e-6)
    np.testing.assert_array_equal(mesh.positions[mesh.triangles[1]], [(0, 0, 0), (1, 1, 0), (0, 1, 0)])
    np.testing.assert_allclose(mesh.normals, [(0, 0, 1)] * 6, atol=1e-6)


def test_missing_colors(scene):
    text = HEAD + FACES + "end_header\n" + "\n".join([*CORNERS, "3 0 1 2", "3 0 2 3"]) + "\n"
    description = scene("a.ply", text)
    assert description.meshes[0].colors is None
    assert description.materials[0].base_color == (0.8, 0.8, 0.8)


def test_points_become_spheres_of_their_color(scene):
    rows = [f"{p} {c}" for p, c in zip(CORNERS, COLORS, strict=True)]
    description = scene("a.ply", HEAD + RGB + "end_header\n" + "\n".join(rows) + "\n")
    (mesh,) = description.meshes
    assert len(mesh.triangles) == 4 * 320
    center = mesh.positions.reshape(4, -1, 3).mean(axis=1)
    np.testing.assert_allclose(center, [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(mesh.positions.reshape(4, -1, 3) - center[:, None], axis=2), 1, rtol=1e-5)
    np.testing.assert_allclose(mesh.colors.reshape(4, -1, 4)[2], [(0, 0, 1, 1)] * 162)
    a, b, c = (mesh.positions[mesh.triangles[:, k]] for k in range(3))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), mesh.normals[mesh.triangles[:, 0]]) > 0).all()
    assert any("4 of 4 points are shown as spheres of radius 1" in w for w in description.warnings)


def test_many_points_are_subsampled(scene, monkeypatch):
    monkeypatch.setattr(points, "MOST_POINTS", 2)
    description = scene("a.ply", HEAD + "end_header\n" + "\n".join(CORNERS) + "\n")
    assert len(description.meshes[0].triangles) == 2 * 320
    assert any("2 of 4 points" in w for w in description.warnings)


WITH_NAMES = "element vertex 4\nproperty {0} x\nproperty {0} y\nproperty {0} z\n"
POINTS = np.array([[float(c) for c in row.split()] for row in CORNERS])


def in_bytes(vertex, rows, faces="", more=b"", order="<"):
    """Returns a binary PLY file with the rows of a structured array as its vertices."""
    way = "little" if order == "<" else "big"
    head = f"ply\r\nformat binary_{way}_endian 1.0\r\n{vertex}{faces}end_header\r\n".replace("\r\n", "\n")
    return head.encode() + rows.tobytes() + more


def test_number_types_and_scanner_names(scene):
    names = ["diffuse_red", "diffuse_green", "diffuse_blue", "scalar_Intensity"]
    kind = [*((n, ">f8") for n in "xyz"), *((n, ">u1") for n in names[:3]), (names[3], ">f4")]
    rows = np.zeros(4, kind)
    for k, n in enumerate("xyz"):
        rows[n] = POINTS[:, k]
    rows["diffuse_green"] = 128
    head = WITH_NAMES.format("double") + "".join(f"property uchar {n}\n" for n in names[:3]) + f"property float {names[3]}\n"
    faces = "element face 2\nproperty uchar flags\nproperty list uint8 uint32 vertex_index\n"
    corners = b"".join(struct.pack(">BB3I", 1, 3, *face) for face in ((0, 1, 2), (0, 2, 3)))
    (mesh,) = scene("a.ply", in_bytes(head, rows, faces, corners, ">")).meshes
    np.testing.assert_array_equal(mesh.positions[mesh.triangles], POINTS[[(0, 1, 2), (0, 2, 3)]])
    np.testing.assert_allclose(mesh.colors[0], (0, linear(128), 0, 1), atol=1e-6)


def test_triangle_strips_alternate_winding(scene):
    rows = POINTS[[0, 1, 3, 2]].astype("<f4")
    strips = "element tristrips 1\nproperty list int int vertex_indices\n"
    data = in_bytes(WITH_NAMES.format("float"), rows, strips, struct.pack("<9i", 8, 0, 1, 2, 3, -1, 2, 1, 3))
    (mesh,) = scene("a.ply", data).meshes
    assert len(mesh.triangles) == 3
    a, b, c = (mesh.positions[mesh.triangles[:, k]] for k in range(3))
    np.testing.assert_array_equal(np.cross(b - a, c - a)[:, 2], [1, 1, 1])


def test_corner_uvs_and_texture_in_a_comment(scene, png):
    rows = POINTS.astype("<f4")
    faces = "element face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n"
    uvs = [(0, 0, 1, 0, 1, 1), (0.5, 0, 1, 1, 0, 1)]
    body = b"".join(struct.pack("<B3iB6f", 3, *f, 6, *uv) for f, uv in zip([(0, 1, 2), (0, 2, 3)], uvs, strict=True))
    data = in_bytes("comment TextureFile skin.png\n" + WITH_NAMES.format("float"), rows, faces, body)
    description = scene("a.ply", data, {"skin.png": png(255, 0, 0)})
    (mesh,) = description.meshes
    found = mesh.uvs[mesh.triangles].astype(float)
    np.testing.assert_array_equal(found, np.array(uvs).reshape(2, 3, 2) * (1, -1) + (0, 1))
    assert len(mesh.positions) == 5  # the first vertex has two texture coordinates, so it is split
    assert description.materials[mesh.material].base_color_texture is not None


def test_far_survey_keeps_its_shape(scene):
    far = np.add(POINTS, (4_500_000.25, 5_300_000.5, 100))
    text = HEAD + FACES + "end_header\n" + "\n".join(" ".join(f"{c:.3f}" for c in p) for p in far) + "\n3 0 1 2\n3 0 2 3\n"
    description = scene("a.ply", text)
    (mesh,) = description.meshes
    np.testing.assert_allclose(mesh.positions - mesh.positions[0], POINTS - POINTS[0], atol=1e-6)
    np.testing.assert_allclose(mesh.positions[0], far[0], atol=1e-6)


def test_gaussians_become_colored_points(scene):
    rows = np.column_stack([POINTS, np.full((4, 3), [1.0, 0.0, -1.0])]).astype("<f4")
    head = WITH_NAMES.format("float") + "".join(f"property float f_dc_{k}\n" for k in range(3))
    colors = scene("a.ply", in_bytes(head, rows)).meshes[0].colors
    np.testing.assert_allclose(colors[0, :3], [linear(round(255 * (0.5 + c * 0.28209479))) for c in (1, 0, -1)], atol=1e-6)


@pytest.mark.parametrize(("asked", "up"), [(None, "-y"), ("y", "y")])
def test_gaussians_have_minus_y_up_by_default(tmp_path, asked, up):
    rows = np.column_stack([POINTS, np.zeros((4, 3))]).astype("<f4")
    head = WITH_NAMES.format("float") + "".join(f"property float f_dc_{k}\n" for k in range(3))
    (tmp_path / "a.ply").write_bytes(in_bytes(head, rows))
    found = load.read(tmp_path, "a.ply", up=asked)
    assert found.up_axis == up
    assert np.sign(found.instances[0].transform[1, 1]) == (-1 if up == "-y" else 1)


WEDGES = "property list uchar float texcoord\nproperty {kind} texnumber\n"


@pytest.mark.parametrize("kind", ["int", "uchar", "short"])
@pytest.mark.parametrize("of_vertices", [False, True])
def test_texture_per_face(scene, png, kind, of_vertices):
    head = "ply\nformat ascii 1.0\ncomment TextureFile a.png\ncomment TextureFile b.png\nelement vertex 8\n"
    head += "property float x\nproperty float y\nproperty float z\n"
    square = ("0 0 0", "1 0 0", "1 1 0", "0 1 0")
    if of_vertices:
        head += f"property float s\nproperty float t\nproperty {kind} texnumber\n"
        rows = "".join(f"{row} 0 0 {k}\n" for k in (0, 1) for row in square)
        head += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
        faces = "4 0 1 2 3\n4 4 5 6 7\n"
    else:
        rows = "".join(f"{row}\n" for _ in (0, 1) for row in square)
        head += "element face 2\nproperty list uchar int vertex_indices\n" + WEDGES.format(kind=kind) + "end_header\n"
        faces = "4 0 1 2 3 8 0 0 1 0 1 1 0 1 1\n4 4 5 6 7 8 0 0 1 0 1 1 0 1 0\n"
    description = scene("a.ply", head + rows + faces, {"a.png": png(255, 0, 0), "b.png": png(0, 0, 255)})
    found = [
        (description.images[description.textures[description.materials[m.material].base_color_texture].image].name)
        for m in description.meshes
    ]
    assert found == ["a.png", "b.png"]
    assert [len(m.triangles) for m in description.meshes] == [2, 2]
    assert [m.uvs is not None for m in description.meshes] == [True, True]


def test_surplus_numbers_in_rows_are_dropped(scene):
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n"
    head += "property list uchar int vertex_indices\nend_header\n"
    text = head + "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 9 9\n3 0 2 3 9\n"
    description = scene("a.ply", text)
    assert len(description.meshes[0].triangles) == 2
    assert any("2 rows have more numbers" in w for w in description.warnings)


@pytest.mark.parametrize(("first", "last"), [("\n", "\r\n"), ("\r\n", "\n"), ("\r\n", "\r\n"), ("\n", "\n"), ("\r", "\r")])
def test_header_line_ends(scene, first, last):
    lines = ["ply", "format binary_little_endian 1.0", "element vertex 3", *(f"property float {c}" for c in "xyz")]
    lines += ["element face 1", "property list uchar int vertex_indices"]
    head = first.join([*lines, "end_header"]) + last
    data = np.array([(10, 0, 0), (1, 0, 0), (0, 1, 0)], "<f4").tobytes() + b"\3" + np.arange(3, dtype="<i4").tobytes()
    assert len(scene("a.ply", head.encode() + data).meshes[0].triangles) == 1
