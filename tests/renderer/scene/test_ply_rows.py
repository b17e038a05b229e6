"""Tests of binary PLY with faces of different numbers of corners, as programs that preserve quads write it."""

import struct

import numpy as np
import pytest

from renderer.errors import SceneError

POINTS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (2, 1, 0)], np.float32)
FACES = [(0, 1, 2, 3), (1, 4, 2), (4, 5, 2), (0, 3, 2, 5, 4)]


def mixed(order="little", count="uchar", kind="int", faces=FACES):
    head = f"ply\nformat binary_{order}_endian 1.0\ncomment mixed\nelement vertex {len(POINTS)}\n"
    head += "".join(f"property float {name}\n" for name in "xyz")
    head += f"element face {len(faces)}\nproperty list {count} {kind} vertex_indices\nend_header\n"
    sign = "<" if order == "little" else ">"
    body = b"".join(struct.pack(f"{sign}B{len(face)}{'i' if kind == 'int' else 'H'}", len(face), *face) for face in faces)
    return head.encode() + POINTS.astype(f"{sign}f4").tobytes() + body


@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("kind", ["int", "ushort"])
def test_mixed_binary_faces_are_triangulated(scene, order, kind):
    (mesh,) = scene("a.ply", mixed(order, kind=kind)).meshes
    found = {tuple(sorted(map(tuple, mesh.positions[t].tolist()))) for t in mesh.triangles}
    wanted = [(f[0], f[k], f[k + 1]) for f in FACES for k in range(1, len(f) - 1)]
    assert found == {tuple(sorted(map(tuple, POINTS[list(t)].tolist()))) for t in wanted}


def test_damaged_mixed_faces_are_an_error(scene):
    whole = mixed()
    for cut in (3, 10, 30):
        with pytest.raises(SceneError, match=r"^a\.ply"):
            scene("a.ply", whole[:-cut])
    with pytest.raises(SceneError, match=r"^a\.ply"):
        scene("a.ply", whole.replace(b"face 4", b"face 4000000000"))
