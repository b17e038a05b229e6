"""Tests that a polygon of any shape is triangulated: the triangles' areas sum to the polygon's."""

import numpy as np
import pytest

from renderer.scene.normals import face_normals
from renderer.scene.polygons import triangulate

SQUARE = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
HOLE = [(-0.5, -0.5), (-0.5, 0.5), (0.5, 0.5), (0.5, -0.5)]
TURN = np.arange(10) * np.pi / 5 + np.pi / 2
STAR = np.column_stack([np.cos(TURN), np.sin(TURN)]) * np.where(np.arange(10) % 2, 0.4, 1)[:, None]
COMB = [
    *((-1, -1), (1, -1), (1, 1), (0.6, 1), (0.6, -0.6), (0.2, -0.6), (0.2, 1), (-0.2, 1), (-0.2, -0.6), (-0.6, -0.6), (-0.6, 1)),
    (-1, 1),
]
SHAPES = {
    "star": (STAR, 1.1755705),
    "comb": (COMB, 2.72),
    "L": ([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], 3),
    "keyhole": ([SQUARE[0], *HOLE, HOLE[0], *SQUARE], 3),
    "duplicates": (np.repeat(STAR, 2, axis=0), 1.1755705),
    "collinear": (np.stack([STAR, (STAR + np.roll(STAR, -1, axis=0)) / 2], axis=1).reshape(-1, 2), 1.1755705),
    "touching": ([(0, 0), (2, 0), (2, 2), (1, 0), (0, 2)], 2),
    "spike": ([(-1, -1), (1, -1), (1, 1), (0, 0), (1, 1), (-1, 1)], 4),
    "flat": ([(0, 0), (1, 0), (2, 0), (3, 0), (1.5, 0)], 0),
}


def areas(points, cut):
    return np.linalg.norm(face_normals(np.asarray(points, np.float64), cut.triangles), axis=1) / 2


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("first", [0, 3])
def test_triangle_areas_sum_to_the_polygon(name, first):
    flat, area = SHAPES[name]
    turned = np.linalg.qr(np.random.default_rng(len(name)).normal(size=(3, 3)))[0]
    points = np.column_stack([np.roll(np.asarray(flat, float), first, axis=0), np.zeros(len(flat))]) @ turned
    cut = triangulate(np.array([len(points)]), np.arange(len(points)), points)
    assert len(cut.triangles) == len(points) - 2
    assert areas(points, cut).sum() == pytest.approx(area, abs=1e-6)


def test_random_star_polygons():
    rng = np.random.default_rng(5)
    for _ in range(60):
        count = rng.integers(5, 40)
        turn, far = np.sort(rng.random(count)) * 2 * np.pi, rng.uniform(0.1, 1, count)
        points = np.column_stack([far * np.cos(turn), far * np.sin(turn), np.zeros(count)])
        cut = triangulate(np.array([count]), np.arange(count), points)
        signed = (np.roll(points, -1, axis=0)[:, 1] * points[:, 0] - np.roll(points, -1, axis=0)[:, 0] * points[:, 1]).sum() / 2
        if np.diff(turn, append=turn[0] + 2 * np.pi).max() < np.pi:  # otherwise the shape may intersect itself
            assert areas(points, cut).sum() == pytest.approx(signed, abs=1e-9)


def test_convex_polygons_become_fans():
    points = np.array([(0, 0, 0), (2, 0, 0), (2, 2, 0), (1, 3, 0), (0, 2, 0), (9, 9, 9), (0.5, 0.5, 0)], float)
    cut = triangulate(np.array([4, 2, 3, 5, 4]), np.array([0, 1, 2, 4, 0, 1, 0, 1, 2, 0, 1, 2, 3, 4, 6, 1, 0, 4]), points)
    assert cut.face.tolist() == [0, 0, 2, 3, 3, 3, 4, 4]
    assert cut.triangles.tolist() == [
        *([0, 1, 2], [0, 2, 3], [6, 7, 8], [9, 10, 11], [9, 11, 12], [9, 12, 13]),
        *([14, 15, 16], [14, 16, 17]),
    ]
    assert cut.unfilled == 0


def test_concave_quad_uses_the_other_diagonal():
    points = np.array([(0, 0, 0), (0.4, 0.4, 0), (1, 0, 0), (0, 1, 0)], float)[[0, 2, 1, 3]]
    for first in range(4):
        at = np.roll(points, first, axis=0)
        assert areas(at, triangulate(np.array([4]), np.arange(4), at)).sum() == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.obj", "{v}f {n1}\n"),
        ("a.off", "OFF\n{count} 1 0\n{p}{count} {n0}\n"),
        (
            "a.ply",
            "ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\n"
            "element face 1\nproperty list uchar int vertex_indices\nend_header\n{p}{count} {n0}\n",
        ),
    ],
)
@pytest.mark.parametrize("shape", ["star", "comb", "keyhole", "collinear"])
def test_every_reader_fills_concave_polygons(scene, name, text, shape):
    flat, area = SHAPES[shape]
    rows = [f"{x} {y} 0" for x, y in np.asarray(flat).tolist()]
    count = len(rows)
    values = {
        "count": count,
        "v": "".join(f"v {row}\n" for row in rows),
        "p": "".join(f"{row}\n" for row in rows),
        "n0": " ".join(map(str, range(count))),
        "n1": " ".join(map(str, range(1, count + 1))),
    }
    mesh = scene(name, text.format(**values)).meshes[0]
    found = np.linalg.norm(face_normals(mesh.positions, mesh.triangles), axis=1).sum() / 2
    assert found == pytest.approx(area, abs=1e-5)
