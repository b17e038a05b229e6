"""Tests that a scene far from the origin has the same shape and picture as at the origin.

Its bounds, cameras and paths are still reported in the file's coordinates.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.film import POSITION, SAMPLES, mean
from renderer.render import render_frame, replay
from renderer.scene.compile import compile_scene, summarise
from renderer.scene.description import Instance, Light, Material, Mesh, SceneDescription, Sphere
from renderer.scene.frame_reuse import ShotCache
from renderer.scene.load import read
from renderer.scene.origin import in_exact_type, origin_of
from renderer.scene.readers.shapes import cube
from renderer.settings import RenderSettings, View

FARS = [(447612.4, 5411234.7, 312.8), (4075580.1, 931.25, -4801568.9)]
STEPS = np.array([(x, y, z) for x in (0.0, 0.05, 1.0) for y in (0.0, 0.45, 1.0) for z in (0.0, 0.15, 1.0)])


def _rows(points: np.ndarray, head: str) -> str:
    return "".join(f"{head}{x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in points)


def _triangles() -> list[tuple[int, int, int]]:
    return [(i, i + 1, i + 3) for i in range(len(STEPS) - 3)]


def _obj(points):
    return _rows(points, "v ") + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in _triangles())


def _ply(points):
    head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\nproperty double x\nproperty double y\nproperty double z\n"
    faces = f"element face {len(_triangles())}\nproperty list uchar int vertex_indices\nend_header\n"
    return head + faces + _rows(points, "") + "".join(f"3 {a} {b} {c}\n" for a, b, c in _triangles())


def _off(points):
    faces = _triangles()
    return f"OFF\n{len(points)} {len(faces)} 0\n" + _rows(points, "") + "".join(f"3 {a} {b} {c}\n" for a, b, c in faces)


def _stl(points):
    facets = [f"facet normal 0 0 0\nouter loop\n{_rows(points[list(t)], 'vertex ')}endloop\nendfacet\n" for t in _triangles()]
    return "solid a\n" + "".join(facets) + "endsolid a\n"


def _yaml(points):
    rows = ", ".join(f"[{x:.4f}, {y:.4f}, {z:.4f}]" for x, y, z in points)
    return f"shapes:\n- {{type: faces, positions: [{rows}], faces: {[list(t) for t in _triangles()]}}}\n"


def _pbrt(points):
    numbers = " ".join(f"{c:.4f}" for p in points for c in p)
    corners = " ".join(str(c) for t in _triangles() for c in t)
    return f'WorldBegin\nShape "trianglemesh" "point3 P" [{numbers}] "integer indices" [{corners}]\n'


FORMATS = {"a.obj": _obj, "a.ply": _ply, "a.off": _off, "a.stl": _stl, "a.rayfarm.yaml": _yaml, "a.pbrt": _pbrt}


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("far", FARS)
def test_far_shapes_are_precise_in_every_format(name, far, tmp_path):
    def edges(points) -> np.ndarray:
        (tmp_path / name).write_text(FORMATS[name](points))
        compiled = compile_scene(read(tmp_path, name))
        corners = compiled.position[compiled.triangle[:, :3]].astype(np.float64)
        return np.sort(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2), axis=None)

    np.testing.assert_allclose(edges(STEPS + far), edges(STEPS), atol=1e-6)


def _scene(place) -> SceneDescription:
    ball = cube("body")
    transform = np.eye(4)
    transform[:3, 3] = np.add(place, (0.5, 0.25, 0.0))
    x, y, z = np.add(place, (2.0, 3.0, 4.0)).tolist()
    a, b, c = np.add(place, (-1.5, 0.125, 0.0)).tolist()
    return SceneDescription(
        meshes=[ball],
        instances=[Instance(0, transform)],
        spheres=[Sphere((a, b, c), 0.75)],
        lights=[Light("point", (80.0, 80.0, 80.0), (x, y, z))],
        materials=[Material()],
    )


def _settings(place) -> RenderSettings:
    eye, target = np.add(place, (1.0, 2.0, 7.0)).tolist(), np.add(place, (-0.25, 0.0, 0.0)).tolist()
    return RenderSettings(32, 24, View(tuple(eye), tuple(target)))


@pytest.mark.parametrize("far", FARS)
def test_translated_scene_renders_the_same_picture(far):
    here, there = (render_frame(compile_scene(_scene(p)), _settings(p), 16) for p in ((0.0, 0.0, 0.0), far))
    near, away = (mean(sums, 24) for sums in (here, there))
    assert near.mean() > 0.01
    assert np.abs(away - near).mean() < 1e-3 * near.mean()
    hit = here[POSITION].any(axis=0) & (here[3] > 0)
    places = mean(there, 24, POSITION)[hit].astype(np.float64) - far
    whole = np.abs(places).max(axis=1) < 4  # pixels at edges hold means of hits and misses
    assert whole.mean() > 0.7
    np.testing.assert_allclose(places[whole], mean(here, 24, POSITION)[hit][whole], atol=0.5)  # float32 has a step of 0.5 there
    exact_places = there[POSITION, 12, 16] / there[SAMPLES, 12, 16] * 2.0**-24 - far
    np.testing.assert_allclose(exact_places, here[POSITION, 12, 16] / here[SAMPLES, 12, 16] * 2.0**-24, atol=1e-3)


def test_bounds_cameras_and_paths_use_file_coordinates():
    far = FARS[0]
    description = _scene(far)
    compiled = compile_scene(description)
    summary = summarise(description, compiled)
    np.testing.assert_allclose(summary["bounds"], np.add([(-2.25, -0.75, -1.0), (1.5, 1.25, 1.0)], far), atol=1e-6)
    assert np.linalg.norm(np.subtract(summary["cameras"][-1]["view"]["target"], far)) < 3
    vertex = replay(compiled, _settings(far), 16, 12, 0).vertices[0]
    assert vertex.point is not None and np.abs(np.subtract(vertex.point, far)).max() < 3


def test_near_scene_keeps_its_coordinates_exactly():
    description = _scene((15.0, 3.0, -20.0))
    assert not origin_of(description).any()
    compiled = compile_scene(description)
    assert compiled.sphere[0].tolist() == [13.5, 3.125, -20.0, 0.75]
    points = np.array([(0.1, 0.2, 0.3), (1.0, 20.0, 7.0)])
    assert in_exact_type(points).dtype == np.float32
    assert in_exact_type(points + 1e6).dtype == np.float64


def test_stray_vertex_at_the_origin_does_not_reduce_precision():
    points = np.concatenate([np.zeros((3, 3)), STEPS + FARS[0]])
    triangles = np.array([(0, 1, 2), *_triangles()] + [(i + 3, i + 4, i + 6) for i in range(20)], np.int32)
    triangles[1 : len(_triangles()) + 1] += 3
    description = SceneDescription(
        meshes=[Mesh("a", in_exact_type(points), triangles)], instances=[Instance(0)], materials=[Material()]
    )
    assert np.abs(origin_of(description) - FARS[0]).max() < 2


def test_origin_is_independent_of_moving_objects():
    first = _scene(FARS[0])
    place = np.array(first.instances[0].transform)
    place[0, 3] += 40.0
    first.instances.append(Instance(0, np.array(first.instances[0].transform), moves=True))
    second = replace(first, instances=[first.instances[0], replace(first.instances[1], transform=place)])
    kept = ShotCache()
    one, two = compile_scene(first, shot_cache=kept).origin.copy(), compile_scene(second, shot_cache=kept).origin
    np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(two, compile_scene(second).origin)
