"""Tests of OBJ and MTL as exporters write them."""

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.scene.warning_list import MOST_WARNINGS

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def test_polygon_fans_and_negative_indices(scene):
    description = scene("a.obj", "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 1 3 0\nv 0 2 0\nf -5 -4 -3 -2 -1\n")
    mesh = description.meshes[0]
    corners = mesh.positions[mesh.triangles]
    expected = [[(0, 0, 0), (2, 0, 0), (2, 2, 0)], [(0, 0, 0), (2, 2, 0), (1, 3, 0)], [(0, 0, 0), (1, 3, 0), (0, 2, 0)]]
    np.testing.assert_array_equal(corners, expected)


def test_uvs_are_flipped_and_normals_kept(scene):
    text = TRIANGLE + "vt 0 0\nvt 1 0.25 0\nvt 0 1\nvn 0 0 2\nf 1/1/1 2/2/1 3/3/1\n"
    mesh = scene("a.obj", text).meshes[0]
    np.testing.assert_array_equal(mesh.uvs[mesh.triangles[0]], [(0, 1), (1, 0.75), (0, 0)])
    np.testing.assert_array_equal(mesh.normals, [(0, 0, 2)] * 3)


def test_computed_normals_of_sphere_and_box(scene):
    turn = np.radians(np.arange(0, 360, 15))
    ring = "".join(f"v {np.cos(a)} {np.sin(a)} {z}\n" for z in (0, 1) for a in turn)
    faces = "".join(f"f {i + 1} {(i + 1) % 24 + 1} {(i + 1) % 24 + 25} {i + 25}\n" for i in range(24))
    lids = "f " + " ".join(str(i) for i in range(24, 0, -1)) + "\nf " + " ".join(str(i) for i in range(25, 49)) + "\n"
    mesh = scene("drum.obj", ring + faces + lids).meshes[0]
    normals = mesh.normals[mesh.triangles].reshape(-1, 3)
    positions = mesh.positions[mesh.triangles].reshape(-1, 3)
    side = np.abs(normals[:, 2]) < 0.5
    np.testing.assert_allclose(normals[side, :2], positions[side, :2], atol=1e-5)  # the side is round, so normals are radial
    np.testing.assert_allclose(normals[~side], [(0, 0, 1 if z == 1 else -1) for z in positions[~side, 2]], atol=1e-6)


def test_materials_and_names_with_spaces(scene, png):
    mtl = """
newmtl dark red paint
Kd 0.5 0.1 0.1
map_Kd -s 1 1 1 C:\\Users\\me\\Textures\\My Paint.PNG
newmtl lamp
Kd 0 0 0
Ke 4 3 2
newmtl polished
Kd 0.2 0.2 0.2
Ks 0.9 0.9 0.9
Ns 96
newmtl window
illum 4
Ni 1.45
newmtl chrome
illum 3
Kd 0 0 0
Ks 0.9 0.8 0.7
"""
    text = TRIANGLE + "mtllib My Materials.mtl\n"
    text += "".join(f"usemtl {m}\nf 1 2 3\n" for m in ("dark red paint", "lamp", "polished", "window", "chrome"))
    description = scene("a.obj", text, {"My Materials.mtl": mtl, "maps/my paint.png": png(9, 8, 7)})
    paint, lamp, polished, window, chrome = (description.materials[m.material] for m in description.meshes)
    assert paint.base_color == (0.5, 0.1, 0.1)
    image = description.images[description.textures[paint.base_color_texture].image]
    assert image.pixels[0, 0, :3].tolist() == [9, 8, 7]
    assert lamp.emission == (4, 3, 2)
    assert polished.kind == "metallic_roughness"
    assert polished.roughness == pytest.approx((2 / 98) ** 0.25)
    assert (window.kind, window.ior) == ("glass", 1.45)
    assert (chrome.kind, chrome.base_color) == ("mirror", (0.9, 0.8, 0.7))


def test_missing_texture_is_named(scene):
    mtl = "newmtl m\nKd 0.2 0.3 0.4\nmap_Kd textures/bark.jpg\n"
    description = scene("a.obj", f"mtllib a.mtl\n{TRIANGLE}usemtl m\nf 1 2 3\n", {"a.mtl": mtl})
    assert any("bark.jpg" in w for w in description.warnings)
    assert description.materials[0].base_color == (0.2, 0.3, 0.4)
    assert description.materials[0].base_color_texture is None


def test_missing_material_file_is_named(scene):
    description = scene("a.obj", f"mtllib gone.mtl\n{TRIANGLE}usemtl m\nf 1 2 3\n")
    assert any("gone.mtl" in w for w in description.warnings)


def test_single_image_beside_an_obj_is_its_texture(scene, png):
    text = TRIANGLE + "vt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    description = scene("spot/a.obj", text, {"spot/a_texture.png": png(1, 2, 3)})
    assert description.materials[0].base_color_texture == 0
    assert any("a_texture.png" in w for w in description.warnings)


def test_two_images_beside_an_obj_are_ignored(scene, png):
    text = TRIANGLE + "vt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    description = scene("a.obj", text, {"a.png": png(1, 2, 3), "b.png": png(1, 2, 3)})
    assert description.materials[0].base_color_texture is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("f 1 2 3\n", "a face refers to vertex 3, but there are 0"),
        (TRIANGLE + "f 1 2 9\n", "a face refers to vertex 9, but there are 3"),
        (TRIANGLE + "f 1 2 -9\n", ", line 4: a face refers to element -9, but 3"),
        (TRIANGLE + "f 1 2 0\n", "line 4"),
        (TRIANGLE + "f 1 2 x\n", ", line 4: 'x' is not a corner of a face; write it as v/vt/vn"),
        ("v 0 0\nf 1 1 1\n", "'v 0 0' does not contain 3 numbers; export the file again"),
        ("v 0 0 nan\nf 1 1 1\n", "not finite"),
        ("v 0 0 1e99\nf 1 1 1\n", "not finite"),
        (TRIANGLE, "no surface"),
        ("", "no surface"),
    ],
)
def test_faults_are_reported(scene, text, said):
    with pytest.raises(SceneError) as caught:
        scene("a.obj", text)
    assert said in str(caught.value)
    assert str(caught.value).startswith("a.obj")


def test_numbers_in_every_notation(scene):
    words = [
        "1",
        "-1",
        "+2",
        ".5",
        "-.25",
        "3.",
        "1e3",
        "1E-3",
        "-2.5e+2",
        "0.1234567890123456789012",
        "123456789012345678901",
        "1e-60",
    ]
    text = "".join(f"v {w} 0 0\n" for w in words) + "v 0 1 0\nv 0 0 1\n"
    text += "".join(f"f {i + 1} {len(words) + 1} {len(words) + 2}\n" for i in range(len(words)))
    mesh = scene("a.obj", text).meshes[0]
    np.testing.assert_array_equal(np.unique(mesh.positions[:, 0]), np.unique(np.float32([*map(float, words), 0])))


def test_random_numbers_are_parsed_exactly(scene):
    rng = np.random.default_rng(4)
    values = (rng.normal(size=(300, 3)) * 10.0 ** rng.integers(-8, 8, (300, 3))).astype(np.float32)
    text = "".join("v " + " ".join(repr(float(c)) for c in row) + "\n" for row in values)
    text += "".join(f"f {i} {i + 1} {i + 2}\n" for i in range(1, 299))
    mesh = scene("a.obj", text).meshes[0]
    np.testing.assert_array_equal(mesh.positions[mesh.triangles], values[np.arange(298)[:, None] + np.arange(3)])


def test_line_continuations_comments_tabs_and_line_ends(scene):
    text = (
        "# v 9 9 9\r\nv\t0 0 0\r\nv 1 0 0 # here\r\nv 0 \\\r\n1 0\r\ncurv 1\r\n\r\nf 1//\\\n 2 \\\n\t3\r\nsomething else\r\nl 1 2"
    )
    description = scene("a.obj", text)
    mesh = description.meshes[0]
    np.testing.assert_array_equal(mesh.positions[mesh.triangles[0]], [(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    assert any("2 lines, points or curves" in w for w in description.warnings)


def test_faces_of_one_material_form_one_mesh(scene):
    text = TRIANGLE + "f 1 2 3\nusemtl a\nf 1 2 3\nf 2 3 1\nusemtl b\nf 1 2 3\nusemtl a\nf 3 1 2\n"
    meshes = scene("a.obj", text).meshes
    assert [len(m.triangles) for m in meshes] == [1, 3, 1]


def test_colours_after_positions_are_vertex_colours(scene):
    text = "v 0 0 0 1 0 0\nv 1 0 0 0 0.5 0\nv 0 1 0 0 0 1\nf 1 2 3\n"
    mesh = scene("a.obj", text).meshes[0]
    expected = [(1, 0, 0, 1), (0, ((0.5 + 0.055) / 1.055) ** 2.4, 0, 1), (0, 0, 1, 1)]
    np.testing.assert_allclose(mesh.colors[mesh.triangles[0]], expected, atol=1e-6)
    mixed = scene("b.obj", text.replace(" 0 0.5 0", " 1")).meshes[
        0
    ]  # the fourth number is a weight, and only some vertices have colours
    np.testing.assert_array_equal(mixed.colors[mixed.triangles[0]], [(1, 0, 0, 1), (1, 1, 1, 1), (0, 0, 1, 1)])


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-be", "utf-8-sig"])
def test_windows_encodings(scene, encoding):
    mark = "\ufeff" if encoding == "utf-16-be" else ""
    description = scene("a.obj", f"{mark}# ö\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".encode(encoding))
    assert len(description.meshes[0].triangles) == 1


@pytest.mark.parametrize("normal", ["nan nan nan", "-1.#IND -1.#IND -1.#IND", "-nan(ind) 0 0", "inf 0 0"])
def test_non_numeric_normals_are_ignored(scene, normal):
    description = scene("a.obj", f"v 0 0 0\nv 1 0 0\nv 0 1 0\nvn {normal}\nf 1//1 2//1 3//1\n")
    assert description.meshes[0].normals.tolist() == [[0, 0, 1]] * 3
    assert any(
        "3 corners of faces refer to normals or texture coordinates that are missing or not finite; they are read without them"
        in w
        for w in description.warnings
    )


def test_decimal_commas_and_fortrans_exponents(scene):
    mesh = scene("a.obj", "v 0,5 0 0\nv 1.5D+00 0 0\nv 0 1,25 0\nf 1 2 3\n").meshes[0]
    assert mesh.positions.tolist() == [[0.5, 0, 0], [1.5, 0, 0], [0, 1.25, 0]]


def test_non_numeric_positions_used_by_all_faces_are_errors(scene):
    with pytest.raises(SceneError, match="not finite"):
        scene("a.obj", "v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n")


@pytest.mark.parametrize(("smooth", "normals"), [("s off\n", 0), ("s 0\n", 0), ("s 1\n", 24), ("s off\nf 1 2 3\ns 1\n", 24)])
def test_smoothing_off_makes_flat_faces(scene, smooth, normals):
    turn = np.radians(np.arange(0, 360, 30))
    ring = "".join(f"v {np.cos(a)} {np.sin(a)} {z}\n" for z in (0, 1) for a in turn)
    faces = "".join(f"f {i + 1} {(i + 1) % 12 + 1} {(i + 1) % 12 + 13} {i + 13}\n" for i in range(12))
    (mesh,) = scene("a.obj", f"{ring}{smooth}{faces}").meshes
    assert (0 if mesh.normals is None else len(mesh.normals)) >= normals
    assert (mesh.normals is None) == (normals == 0)


def test_faces_of_many_materials(scene):
    text = "mtllib a.mtl\n" + "".join(f"v {i} 0 0\nv {i} 1 0\nv {i} 0 1\nusemtl m{i % 20}\nf -3 -2 -1\n" for i in range(60))
    mtl = "".join(f"newmtl m{i}\nKd 0.{i:02d} 0 0\n" for i in range(20))
    description = scene("a.obj", text, {"a.mtl": mtl})
    assert [m.name for m in description.meshes] == [f"m{i}" for i in range(20)]
    for i, mesh in enumerate(description.meshes):
        assert description.materials[mesh.material].base_color[0] == pytest.approx(i / 100)
        assert sorted(set(mesh.positions[:, 0].tolist())) == [i, i + 20, i + 40]
        np.testing.assert_array_equal(mesh.normals, [(1, 0, 0)] * 9)


def test_warnings_are_limited(scene):
    text = TRIANGLE + "mtllib a.mtl\n" + "".join(f"usemtl m{i}\nf 1 2 3\n" for i in range(MOST_WARNINGS + 50))
    warnings = scene("a.obj", text, {"a.mtl": "newmtl x\n"}).warnings
    assert f"defines m{MOST_WARNINGS - 1};" in warnings[MOST_WARNINGS - 1]
    assert warnings[MOST_WARNINGS] == f"There are more warnings: these are the first {MOST_WARNINGS}."
    assert len(warnings) <= MOST_WARNINGS + 2


def test_zbrush_vertex_colors_in_comments(scene):
    """ZBrush's #MRGB comments give each vertex's mask, red, green and blue in hexadecimal, over any number of lines.

    The material's grey does not darken these colours.
    """
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\n{}f 1 2 3\n"
    description = scene("a.obj", text.format("#MRGB ffff0000ff00ff00\n#MRGB ff0000ff\n"))
    np.testing.assert_array_equal(description.meshes[0].colors[:, :3], np.eye(3))
    assert description.materials[0].base_color == (1, 1, 1)
    assert scene("a.obj", text.format("#MRGB ffff0000\n")).meshes[0].colors is None
