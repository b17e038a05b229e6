"""Tests of binary STL: shared vertices, truncated files, and the colours of two programs."""

import struct

import numpy as np
import pytest

from renderer.errors import SceneError

SQUARE = [((0, 0, 0), (1, 0, 0), (1, 1, 0)), ((0, 0, 0), (1, 1, 0), (0, 1, 0))]


def stl(triangles=SQUARE, words=(0, 0), head=b"made by formula", said=None):
    rows = b"".join(
        struct.pack("<12fH", 0, 0, 0, *np.ravel(corners), word) for corners, word in zip(triangles, words, strict=False)
    )
    return head.ljust(80, b"\0") + struct.pack("<I", len(triangles) if said is None else said) + rows


def test_stl_vertices_are_merged_and_z_is_up(scene):
    description = scene("a.stl", stl())
    (mesh,) = description.meshes
    assert len(mesh.positions) == 4
    np.testing.assert_array_equal(mesh.positions[mesh.triangles], SQUARE)
    np.testing.assert_allclose(description.instances[0].transform[:3, :3] @ mesh.normals[0], (0, 1, 0), atol=1e-6)
    assert mesh.colors is None


@pytest.mark.parametrize("head", [b"solid but in bytes", b"COLOR=\x80\x80\x80\xff"])
def test_stl_header_text_and_trailing_bytes(scene, head):
    assert len(scene("a.stl", stl(head=head) + b"and more").meshes[0].triangles) == 2


def test_truncated_file_is_an_error(scene):
    with pytest.raises(SceneError, match="has 2 of 3 triangles"):
        scene("a.stl", stl(said=3))


@pytest.mark.parametrize(
    ("head", "words", "colors"),
    [
        (b"", (0x8000 | 31 << 10, 0), [(1, 0, 0), (1, 1, 1)]),  # VisCAM: blue lowest
        (b"COLOR=\x00\x00\xff\xff", (31, 0x8000), [(1, 0, 0), (0, 0, 1)]),  # Magics: red lowest, else the whole model's colour
    ],
)
def test_colours_of_triangles(scene, head, words, colors):
    description = scene("a.stl", stl(words=words, head=head))
    (mesh,) = description.meshes
    np.testing.assert_allclose(mesh.colors[mesh.triangles][..., :3], np.repeat(np.array(colors)[:, None], 3, axis=1), atol=1e-6)
    assert description.materials[mesh.material].base_color == (1, 1, 1)


def test_other_attribute_bytes_are_no_colors(scene):
    found = scene("a.stl", stl(words=(7, 0x8001)))
    assert found.meshes[0].colors is None
    assert any(
        "2 of 2 triangles have attributes that are not colours; they are left out" in warning for warning in found.warnings
    )
