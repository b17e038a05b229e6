"""Tests of OFF files with all header prefixes and with face colours."""

import numpy as np
import pytest

from renderer.errors import SceneError

RED = (1, 0, 0, 1)


@pytest.mark.parametrize(
    ("head", "rest", "red"),
    [
        ("COFF", "255 0 0 255", RED),
        ("COFF", "1 0 0 1", RED),
        ("COFF", "1.0 0.0 0.0", RED),
        ("CNOFF", "0 0 1 255 0 0 255", RED),
        ("STCNOFF", "0 0 1 255 0 0 255 0.5 0.25", RED),
        ("OFF", "255 0 0 255", RED),
    ],
)
def test_colours_of_vertices(scene, head, rest, red):
    description = scene("a.off", f"{head}\n# a comment\n3 1 0\n0 0 0 {rest}\n1 0 0 {rest} # red\n0 1 0 {rest}\n3 0 1 2\n")
    mesh = description.meshes[0]
    np.testing.assert_allclose(mesh.colors, [red] * 3)
    assert description.materials[0].base_color == (1, 1, 1)
    if head.startswith("ST"):
        np.testing.assert_allclose(mesh.uvs, [(0.5, 0.75)] * 3)


def test_texture_coordinates_and_normals(scene):
    mesh = scene("a.off", "STOFF\n3 1 0\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n").meshes[0]
    np.testing.assert_allclose(mesh.uvs, [(0, 1), (1, 1), (0, 0)])
    mesh = scene("b.off", "NOFF\n3 1 0\n0 0 0 0 0 2\n1 0 0 0 1 0\n0 1 0 0 0 1\n3 0 1 2\n").meshes[0]
    np.testing.assert_allclose(mesh.normals, [(0, 0, 2), (0, 1, 0), (0, 0, 1)])


@pytest.mark.parametrize(("red", "blue"), [("255 0 0", "0 0 255 255"), ("1.0 0.0 0.0 1.0", "0.0 0.0 1.0")])
def test_colours_of_faces(scene, red, blue):
    text = f"OFF 4 3 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 {red}\n3 0 2 3 {blue}\n4 0 1 2 3\n"
    description = scene("a.off", text)
    mesh = description.meshes[0]
    np.testing.assert_allclose(mesh.colors[mesh.triangles[:, 0]], [RED, (0, 0, 1, 1), (1, 1, 1, 1), (1, 1, 1, 1)])
    assert any("1 of 3 faces have no colour" in w for w in description.warnings)


def test_omitted_content_is_named(scene):
    description = scene("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 7\n")
    assert any("1 faces have colours from a colour map, which are left out" in w for w in description.warnings)
    for head in ("4OFF", "nOFF", "OFF BINARY"):
        with pytest.raises(SceneError, match="which is not supported; export it as plain OFF text"):
            scene("b.off", f"{head}\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")


def test_points_without_faces_become_spheres(scene):
    description = scene("a.off", "COFF\n2 0 0\n0 0 0 255 0 0\n1 0 0 0 0 255\n")
    assert any("2 of 2 points are shown as spheres" in w for w in description.warnings)
    assert {tuple(c) for c in description.meshes[0].colors.tolist()} == {RED, (0, 0, 1, 1)}
