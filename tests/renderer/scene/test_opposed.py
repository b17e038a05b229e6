"""Faces back to back, and decals: what a viewer sees of surfaces that nearly coincide."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from renderer.film import mean
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Instance, Material, SceneDescription
from renderer.scene.opposed import set_apart
from renderer.scene.readers.shapes import quad
from renderer.settings import RenderSettings, View

RED, GREEN, BLUE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def _turned(z: float) -> np.ndarray:
    place = np.eye(4)
    place[2, 3] = z
    return place


def _seen(quads, eye, at=(0.0, 0.0, 0.0), moves=False, ground=0.0) -> np.ndarray:
    """The mean colour of a picture of quads: each a material and a place."""
    description = SceneDescription(environment=Environment((0.0, 0.0, 0.0)))
    for material, place in [*quads, *([(Material(kind="unlit"), _ground(ground))] if ground else [])]:
        mesh = quad("quad")
        if material.name == "back":
            mesh.triangles, mesh.normals = np.ascontiguousarray(mesh.triangles[:, ::-1]), -mesh.normals
        mesh.material = len(description.materials)
        description.materials.append(material)
        description.meshes.append(mesh)
        whole = place.copy()
        whole[:3, 3] += at
        description.instances.append(Instance(mesh.material, whole, name="one", moves=moves))
    place = tuple(np.add(eye, at).tolist()), tuple(map(float, at))
    return mean(render_frame(compile_scene(description), RenderSettings(16, 16, View(*place, fov=12.0)), 4), 24).mean(axis=(0, 1))


def _ground(size: float) -> np.ndarray:
    place = np.diag([size, size, 1.0, 1.0])
    place[2, 3] = -50.0
    return place


def _unlit(color, name="front") -> Material:
    return Material(name, kind="unlit", base_color=color)


@pytest.mark.parametrize("order", list(permutations(range(2))))
@pytest.mark.parametrize(("eye", "color"), [((0.3, 0.2, 4.0), RED), ((0.3, 0.2, -4.0), BLUE), ((1.0, 0.5, 9.0), RED)])
def test_of_faces_back_to_back_the_one_that_faces_the_viewer_is_seen(order, eye, color):
    faces = [(_unlit(RED), _turned(0.0)), (_unlit(BLUE, "back"), _turned(0.0))]
    np.testing.assert_allclose(_seen([faces[k] for k in order], eye), color, atol=1e-6)


@pytest.mark.parametrize("order", list(permutations(range(2))))
@pytest.mark.parametrize("scale", [1.0, 3.7])
@pytest.mark.parametrize(("eye", "color"), [((0.3, 0.2, 4.0), RED), ((3.0, 0.5, -1.5), BLUE)])
def test_of_faces_back_to_back_cut_differently_the_one_that_faces_the_viewer_is_seen(order, scale, eye, color):
    """Other diagonals, and one of the two in a space of its own."""
    description = SceneDescription(environment=Environment((0.0, 0.0, 0.0)))
    for which in order:
        mesh = quad("quad")
        mesh.material = len(description.materials)
        description.meshes.append(mesh)
        description.materials.append(_unlit((RED, BLUE)[which]))
        place = np.eye(4)
        if which == 1:
            corners = sorted(range(4), key=lambda k: np.arctan2(*mesh.positions[k, 1::-1]))
            first, second, third, fourth = corners
            if {first, third} == set(mesh.triangles[0].tolist()) & set(mesh.triangles[1].tolist()):  # the other diagonal
                first, second, third, fourth = second, third, fourth, first
            mesh.triangles = np.array([(third, second, first), (fourth, third, first)], np.int32)
            mesh.normals = -mesh.normals
            mesh.positions = (mesh.positions / scale).astype(np.float32)
            place[:3, :3] *= scale
        description.instances.append(Instance(mesh.material, place, name="one", moves=which == 1 and scale != 1.0))
    view = View(eye, (0.0, 0.0, 0.0), fov=12.0)
    picture = mean(render_frame(compile_scene(description), RenderSettings(16, 16, view), 4), 24)
    np.testing.assert_allclose(picture.mean(axis=(0, 1)), color, atol=1e-6)


def test_faces_of_one_look_or_of_different_spaces_stay_where_they_are():
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)] * 2, np.float32)
    triangles = np.array([(0, 1, 2), (3, 5, 4)], np.int32)
    alike, unlike = np.array([0, 0], np.int32), np.array([0, 1], np.int32)
    assert set_apart(corners, triangles, alike, ()) is corners
    assert set_apart(corners, triangles, unlike, (), [1]) is corners
    same_side = np.array([(0, 1, 2), (3, 4, 5)], np.int32)
    assert set_apart(corners, same_side, unlike, ()) is corners
    moved = set_apart(corners, triangles, unlike, ())
    np.testing.assert_allclose(moved[:3, 2], 2.0**-17, rtol=1e-6)
    np.testing.assert_allclose(moved[3:, 2], -(2.0**-17), rtol=1e-6)
    paint = np.repeat(np.array([(1, 0, 0, 1), (0, 0, 1, 1)], np.float32), 3, axis=0)
    assert (set_apart(corners, triangles, alike, (paint,)) == moved).all()


@pytest.mark.parametrize(
    ("at", "gap"),
    [
        ((0.0, 0.0, 0.0), 1e-4),
        ((100.0, 0.0, 100.0), 1e-4),
        ((50.0, 30.0, 40.0), 1e-4),
        ((300.0, 0.0, 300.0), 1e-4),
        ((1000.0, 50.0, 1000.0), 1e-3),
    ],
)
@pytest.mark.parametrize("layers", [1, 5])
def test_behind_a_decal_that_lets_all_through_the_wall_is_seen(at, gap, layers):
    decal = Material(opacity=0.0, alpha_mode="blend", double_sided=True)
    decals = [(decal, _turned(gap * (k + 1))) for k in range(layers)]
    quads = [(_unlit(GREEN), _turned(0.0)), *decals, (_unlit(RED), _turned(-3.0))]
    np.testing.assert_allclose(_seen(quads, (0.3, 0.2, 6.0), at, ground=3.0 * max(100.0, at[0])), GREEN, atol=1e-6)
