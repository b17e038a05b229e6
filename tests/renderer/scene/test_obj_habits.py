"""Tests of OBJ files as programs really write them: smoothing groups, partial colours, lost normals, comments."""

import numpy as np
import pytest

QUAD = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\n"


def column(count, sides, lids="s off"):
    turn = np.arange(count) * 2 * np.pi / count
    ring = "".join(f"v {np.cos(a)} {y} {np.sin(a)}\n" for y in (0, 2) for a in turn)
    walls = "".join(f"f {i + 1} {i + count + 1} {(i + 1) % count + count + 1} {(i + 1) % count + 1}\n" for i in range(count))
    low = "f " + " ".join(str(i + 1) for i in range(count)) + "\n"
    high = "f " + " ".join(str(2 * count - i) for i in range(count)) + "\n"
    return f"{ring}{sides}\n{walls}{lids}\n{low}{high}"


def bends(mesh):
    """Returns the angles (T, 3) in degrees between the face normal and the vertex normals of each triangle; 0 without normals."""
    corners = mesh.positions[mesh.triangles].astype(float)
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    if mesh.normals is None:
        return np.zeros((len(face), 3))
    own = mesh.normals[mesh.triangles]
    own = own / np.linalg.norm(own, axis=2, keepdims=True)
    return np.degrees(np.arccos(np.clip(np.einsum("tc,tkc->tk", face, own), -1, 1)))


@pytest.mark.parametrize("sides", ["s 1", "s 7 # round"])
def test_smoothing_group_is_smooth_within_and_sharp_at_borders(scene, sides):
    found = bends(scene("a.obj", column(8, sides)).meshes[0])
    np.testing.assert_allclose(found[:16], 22.5, atol=0.01)
    np.testing.assert_allclose(found[16:], 0, atol=0.05)


@pytest.mark.parametrize("sides", ["s off", "s 0", "s"])
def test_faces_without_a_group_are_flat(scene, sides):
    np.testing.assert_allclose(bends(scene("a.obj", column(12, sides, "s 1")).meshes[0]), 0, atol=0.05)


def test_edges_between_groups_and_objects_are_sharp(scene):
    fold = "v 0 0 0\nv 1 0 0\nv 1 1 0.3\nv 0 1 0.3\nv 0 -1 0.3\nv 1 -1 0.3\n"
    for between, is_smooth in (("s 1", True), ("s 2", False), ("o other", False), ("g other", True), ("usemtl other", True)):
        description = scene("a.obj", f"{fold}o one\ns 1\nf 1 2 3 4\n{between}\nf 5 6 2 1\n")
        widest = max(bends(mesh).max() for mesh in description.meshes)
        assert widest == pytest.approx(16.7 if is_smooth else 0, abs=0.05), between


def test_default_smoothing_by_crease_angle(scene):
    assert bends(scene("a.obj", column(12, "", "")).meshes[0])[:24].min() == pytest.approx(15, abs=0.05)
    assert bends(scene("a.obj", column(8, "", "")).meshes[0]).max() == pytest.approx(0, abs=0.05)


def test_sphere_of_two_materials_has_no_seam(scene):
    count = 16
    turn = np.arange(count) * 2 * np.pi / count
    rings = [(np.cos(h), np.sin(h)) for h in np.radians((-67.5, -45, -22.5, 0, 22.5, 45, 67.5))]
    points = [(r * np.cos(a), y, -r * np.sin(a)) for r, y in rings for a in turn]
    faces = [
        [
            [k * count + i, k * count + (i + 1) % count, (k + 1) * count + (i + 1) % count, (k + 1) * count + i]
            for i in range(count)
        ]
        for k in range(6)
    ]
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in points)
    for k, belt in enumerate(faces):
        text += f"usemtl {'ab'[k >= 3]}\n" + "".join("f " + " ".join(str(c + 1) for c in face) + "\n" for face in belt)
    low, high = scene("a.obj", text).meshes
    seam = [{tuple(p.round(5)): n for p, n in zip(m.positions, m.normals, strict=True) if abs(p[1]) < 1e-6} for m in (low, high)]
    assert len(seam[0]) == count == len(seam[1])
    for place, normal in seam[0].items():
        np.testing.assert_array_equal(normal, seam[1][place])
        np.testing.assert_allclose(normal, place, atol=1e-3)


def test_vertices_without_a_colour_are_white(scene):
    text = "".join(f"{line} 1 0 0\n" for line in QUAD.splitlines()) + "f 1 2 3 4\n" + QUAD.replace(" 0\n", " 3\n") + "f 5 6 7 8\n"
    description = scene("a.obj", text)
    colors = description.meshes[0].colors
    assert sorted(map(tuple, colors.tolist())) == [(1, 0, 0, 1)] * 4 + [(1, 1, 1, 1)] * 4
    assert any("4 of 8 vertices have no colour" in w for w in description.warnings)


@pytest.mark.parametrize("most", [255, 65535])
def test_integer_vertex_colors_are_scaled(scene, most):
    text = "".join(f"{line} {most} {most // 2} 0\n" for line in QUAD.splitlines()) + "f 1 2 3 4\n"
    description = scene("a.obj", text)
    np.testing.assert_allclose(description.meshes[0].colors[0], (1, 0.2122, 0, 1), atol=2e-3)
    assert any(f"divided by {most}" in w for w in description.warnings)


@pytest.mark.parametrize("face", ["f 1//1 2//1 3//1 4//1", "f 1/1 2/1 3/1 4/1", "f 1//-1 2//-1 3//-1 4//-1", "f 1/9/9 2 3 4/0/0"])
def test_missing_normals_and_uvs_are_omitted_and_counted(scene, face):
    description = scene("a.obj", f"{QUAD}{face}\n")
    mesh = description.meshes[0]
    assert len(mesh.triangles) == 2
    assert mesh.uvs is None
    np.testing.assert_allclose(mesh.normals, [(0, 0, 1)] * 4)
    assert any(
        "corners of faces refer to normals or texture coordinates that are missing or not finite" in w
        for w in description.warnings
    )


@pytest.mark.parametrize("word", ["nan", "-nan(ind)", "1.#QNAN", "inf", "1e99"])
def test_faces_with_nonfinite_vertices_are_dropped(scene, word):
    description = scene("a.obj", f"{QUAD}v {word} 0 0\nf 1 2 3 4\nf 1 2 5\n")
    assert len(description.meshes[0].triangles) == 2
    assert any("1 vertices have positions that are not finite; 1 faces" in w for w in description.warnings)


def test_nonfinite_normal_is_recomputed(scene):
    description = scene("a.obj", f"{QUAD}vn 0 0 1\nvn nan 0 0\nf 1//1 2//1 3//2 4//1\n")
    np.testing.assert_allclose(description.meshes[0].normals, [(0, 0, 1)] * 4)
    assert any("1 corners of faces refer to normals" in w for w in description.warnings)


def test_trailing_comments_are_removed(scene):
    mtl = "newmtl a # hello\nKd 1 0 0 # red\nnewmtl Material #25\nKd 0 1 0\nnewmtl Material #26\nKd 0 0 1\n"
    text = "mtllib m.mtl # the library\n" + QUAD + "usemtl a # red\nf 1 2 3 4 # a quad\n"
    text += "usemtl Material #25\nf 1 2 3\nusemtl Material #26\nf 1 3 \\\n4\n"
    description = scene("a.obj", text, {"m.mtl": mtl})
    found = [(m.name, description.materials[m.material].base_color, len(m.triangles)) for m in description.meshes]
    assert found == [("a", (1, 0, 0), 2), ("Material #25", (0, 1, 0), 1), ("Material #26", (0, 0, 1), 1)]


LOST = "mtllib lost.mtl\n"


@pytest.mark.parametrize(("said", "there"), [(LOST, "a.mtl"), ("", "a.mtl"), (LOST, "A.MTL"), (LOST, "other.mtl")])
def test_mtl_of_the_same_name_replaces_a_missing_one(scene, said, there):
    description = scene("a.obj", said + QUAD + "usemtl red\nf 1 2 3 4\n", {there: "newmtl red\nKd 1 0 0\n"})
    assert description.materials[0].base_color == (1, 0, 0)
    assert any(f"{there} is used instead" in w for w in description.warnings)


def test_several_libraries_in_one_statement_and_in_several(scene):
    files = {"a.mtl": "newmtl a\nKd 1 0 0\n", "b.mtl": "newmtl b\nKd 0 1 0\n", "c d.mtl": "newmtl c\nKd 0 0 1\n"}
    text = "mtllib a.mtl b.mtl\nmtllib c d.mtl\n" + QUAD + "usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\nusemtl c\nf 1 2 4\n"
    description = scene("x.obj", text, files)
    assert [description.materials[m.material].base_color for m in description.meshes] == [(1, 0, 0), (0, 1, 0), (0, 0, 1)]


@pytest.mark.parametrize(
    ("said", "file", "transform", "wrap"),
    [
        ("t.png -s 2 2 2", "t.png", (2, 0, 0, 0, 2, -1), "repeat"),
        ("-s 2 2 t.png -o 0.5 0 0 # tiled", "t.png", (2, 0, 0.5, 0, 2, -1), "repeat"),
        ("t.png -clamp on", "t.png", (1, 0, 0, 0, 1, 0), "clamp"),
        ("t -s 2.png", "t -s 2.png", (1, 0, 0, 0, 1, 0), "repeat"),
        ("my #1.png", "my #1.png", (1, 0, 0, 0, 1, 0), "repeat"),
        ("t.png # the bark", "t.png", (1, 0, 0, 0, 1, 0), "repeat"),
        ("-o 0,5 0,25 0 t.png", "t.png", (1, 0, 0.5, 0, 1, -0.25), "repeat"),
    ],
)
def test_map_options_before_or_after_the_file_name(scene, png, said, file, transform, wrap):
    text = "mtllib m.mtl\n" + QUAD + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3 4/4\n"
    description = scene("a.obj", text, {"m.mtl": f"newmtl a\nmap_Kd {said}\n", file: png(255, 0, 0)})
    assert description.materials[0].base_color == (1, 1, 1)  # without Kd the map is unscaled
    texture = description.textures[description.materials[0].base_color_texture]
    assert (texture.transform, texture.wrap_s) == (transform, wrap)


def test_map_channel_option(scene, png):
    text = "mtllib m.mtl\n" + QUAD + "vt 0 0\nusemtl a\nf 1/1 2/1 3/1 4/1\n"
    description = scene("a.obj", text, {"m.mtl": "newmtl a\nmap_Kd -imfchan g t.png\n", "t.png": png(255, 100, 0)})
    image = description.images[description.textures[description.materials[0].base_color_texture].image]
    assert image.pixels[0, 0].tolist() == [100, 100, 100, 255]


def test_decimal_commas_of_a_material_are_read_and_counted(scene):
    description = scene("a.obj", "mtllib m.mtl\n" + QUAD + "usemtl a\nf 1 2 3 4\n", {"m.mtl": "newmtl a\nKd 0,5 1 0,25\n"})
    assert description.materials[0].base_color == (0.5, 1, 0.25)
    assert any("1 statements have decimal commas" in w for w in description.warnings)
