"""Tests of which of two nearly coincident surfaces a viewer sees: faces with opposite normals, and decals on a surface."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from renderer.film import mean
from renderer.render import render_frame
from renderer.scene.back_to_back_faces import separate_coincident
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Instance, Light, Material, Mesh, SceneDescription
from renderer.scene.readers.shapes import quad
from renderer.settings import RenderSettings, View
from tests.grids import grid

RED, GREEN, BLUE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def _turned(z: float) -> np.ndarray:
    place = np.eye(4)
    place[2, 3] = z
    return place


def _seen(quads, eye, at=(0.0, 0.0, 0.0), moves=False, ground=0.0) -> np.ndarray:
    """Returns the mean colour of a picture of quads, each given as (material, transform)."""
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
def test_coincident_faces_show_the_front_facing_one(order, eye, color):
    faces = [(_unlit(RED), _turned(0.0)), (_unlit(BLUE, "back"), _turned(0.0))]
    np.testing.assert_allclose(_seen([faces[k] for k in order], eye), color, atol=1e-6)


@pytest.mark.parametrize("order", list(permutations(range(2))))
@pytest.mark.parametrize("scale", [1.0, 3.7])
@pytest.mark.parametrize(("eye", "color"), [((0.3, 0.2, 4.0), RED), ((3.0, 0.5, -1.5), BLUE)])
def test_coincident_faces_with_different_tessellation(order, scale, eye, color):
    """If two coincident faces have opposite normals, the one that faces the camera is visible.

    This holds however the faces are split into triangles, and for any transform.
    """
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


def test_equal_looking_faces_are_not_separated():
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)] * 2, np.float32)
    triangles = np.array([(0, 1, 2), (3, 5, 4)], np.int32)
    alike, unlike = np.array([0, 0], np.int32), np.array([0, 1], np.int32)
    assert separate_coincident(corners, triangles, alike, ()) is corners
    assert separate_coincident(corners, triangles, unlike, (), [1]) is corners
    same_side = np.array([(0, 1, 2), (3, 4, 5)], np.int32)
    assert separate_coincident(corners, same_side, unlike, ()) is corners
    moved = separate_coincident(corners, triangles, unlike, ())
    np.testing.assert_allclose(moved[:3, 2], 2.0**-17, rtol=1e-6)
    np.testing.assert_allclose(moved[3:, 2], -(2.0**-17), rtol=1e-6)
    paint = np.repeat(np.array([(1, 0, 0, 1), (0, 0, 1, 1)], np.float32), 3, axis=0)
    assert (separate_coincident(corners, triangles, alike, (paint,)) == moved).all()


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
def test_wall_is_visible_behind_a_clear_decal(at, gap, layers):
    decal = Material(opacity=0.0, alpha_mode="blend", double_sided=True)
    decals = [(decal, _turned(gap * (k + 1))) for k in range(layers)]
    quads = [(_unlit(GREEN), _turned(0.0)), *decals, (_unlit(RED), _turned(-3.0))]
    np.testing.assert_allclose(_seen(quads, (0.3, 0.2, 6.0), at, ground=3.0 * max(100.0, at[0])), GREEN, atol=1e-6)


def _grid(steps: int, size: float, diagonal: int, material: int) -> Mesh:
    """Returns a square of steps x steps cells in the plane z = 0, facing +z."""
    x = np.linspace(-size, size, steps + 1)
    positions = np.array([(a, b, 0) for b in x for a in x], np.float32)
    corner = np.array([j * (steps + 1) + i for j in range(steps) for i in range(steps)])[:, None]
    a, b, c, d = corner, corner + 1, corner + steps + 1, corner + steps + 2
    cuts = [[a, b, d, a, d, c], [a, b, c, b, d, c]]
    return Mesh("grid", positions, np.concatenate(cuts[diagonal], axis=1).reshape(-1, 3).astype(np.int32), material=material)


def _oblique(z: float, at: tuple[float, float, float]) -> np.ndarray:
    """Returns a transform from the plane z = 0 to an oblique plane through `at`, shifted by z along its normal."""
    place = np.eye(4)
    place[:3, :3] = np.linalg.qr(np.array([(1.0, 2.0, 3.0), (-2.0, 1.0, 0.5), (0.3, -1.0, 2.0)]))[0]
    place[:3, :3] *= np.sign(np.linalg.det(place[:3, :3]))
    place[:3, 3] = place[:3, 2] * z + at
    return place


@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), (50.0, 30.0, 40.0), (1000.0, 50.0, 1000.0)])
@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("wall_first", [False, True])
def test_wall_is_visible_behind_coplanar_clear_decals(at, moves, wall_first):
    clear = Material(opacity=0.0, alpha_mode="blend", double_sided=True)
    materials = [_unlit(GREEN), _unlit(RED), clear]
    wall = [(_grid(1, 1.0, 0, 0), 0.0, False), (_grid(1, 3.0, 0, 1), -0.01, False)]
    decals = [(_grid(3 + k, 1.0, k % 2, 2), 0.0, moves) for k in range(3)]
    description = SceneDescription(materials=materials, environment=Environment((0.0, 0.0, 0.0)))
    for mesh, z, moving in [*wall, *decals] if wall_first else [*decals, *wall]:
        description.meshes.append(mesh)
        description.instances.append(Instance(len(description.meshes) - 1, _oblique(z, at), moves=moving))
    scene = compile_scene(description)
    for elevation in np.radians((90.0, 40.0, 15.0)):
        eye = _oblique(0.0, at) @ [3.2 * np.cos(elevation), 2.4 * np.cos(elevation), 4 * np.sin(elevation), 1.0]
        view = View(tuple(eye[:3].tolist()), at, fov=4.0)
        picture = mean(render_frame(scene, RenderSettings(16, 16, view), 4), 24)
        np.testing.assert_allclose(picture.reshape(-1, 3), np.broadcast_to(GREEN, (256, 3)), atol=1e-6)


@grid(
    ("opacities", "moves"),
    [
        pytest.param(opacities, moves, id=f"{len(opacities)} {'moving' if moves else 'still'}")
        for opacities in ((0.5, 0.25), (0.1, 0.3, 0.2), (0.5, 0.0, 0.4, 0.2, 0.1))
        for moves in (False, True)
    ],
    ordinary=("2 moving", "3 moving", "5 still"),
)
def test_coplanar_layers_transmit_their_product(opacities, moves):
    """Coplanar layers transmit the product of their (1 - opacity).

    This holds for rays to the camera and for shadow rays to a small light above the floor.
    """
    product = float(np.prod([1 - each for each in opacities]))
    materials = [Material(base_color=(1.0, 1.0, 1.0))]
    materials += [Material(base_color=(0.0, 0.0, 0.0), opacity=each, alpha_mode="blend", double_sided=True) for each in opacities]
    description = SceneDescription(materials=materials, environment=Environment((0.0, 0.0, 0.0)))

    def picture(layers: bool, eye: tuple[float, float, float]) -> float:
        description.meshes, description.instances = [_grid(1, 3.0, 0, 0)], [Instance(0)]
        for k in range(len(opacities) if layers else 0):
            place = np.eye(4)
            place[2, 3] = 1.0
            description.meshes.append(_grid(1 + k, 3.0, k % 2, 1 + k))
            description.instances.append(Instance(k + 1, place, moves=moves))
        description.lights = [Light("point", (4.0, 4.0, 4.0), (0.3, 0.2, 2.0))]
        settings = RenderSettings(32, 32, View(eye, (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0), fov=10.0), max_depth=2)
        return float(mean(render_frame(compile_scene(description), settings, 64), 24).mean())

    below, above = (0.5, 0.4, 0.9), (0.5, 0.4, 1.5)
    assert picture(True, below) == pytest.approx(product * picture(False, below), rel=1e-4)
    expected = product * product
    error = np.sqrt(product * (1 - product) / (32 * 32 * 64)) * product
    assert picture(True, above) / picture(False, above) == pytest.approx(expected, abs=6 * error + 1e-4)


def test_scattered_rays_hit_the_wall_behind_a_coplanar_decal():
    """A floor below an emissive ceiling receives all of the ceiling's light, and none from behind it.

    In the plane of the ceiling is a clear decal, through which scattered rays hit the ceiling.
    """

    def picture(decals: int) -> float:
        materials = [Material(base_color=(0.5, 0.5, 0.5)), Material(base_color=(0.0, 0.0, 0.0), emission=(1.0, 1.0, 1.0))]
        materials.append(Material(base_color=(0.0, 0.0, 0.0), emission=(50.0, 50.0, 50.0)))
        materials.append(Material(opacity=0.0, alpha_mode="blend", double_sided=True))
        flipped = np.diag([1.0, -1.0, -1.0, 1.0])
        description = SceneDescription(materials=materials, environment=Environment((0.0, 0.0, 0.0)))
        things = [(_grid(1, 1.0, 0, 0), 0.0), (_grid(2, 2.0, 0, 1), 1.0), (_grid(1, 2.0, 0, 2), 1.001)]
        for k, (mesh, z) in enumerate([*things, *[(_grid(3 + k, 2.0, k % 2, 3), 1.0) for k in range(decals)]]):
            place = flipped.copy() if k else np.eye(4)
            place[2, 3] = z
            description.meshes.append(mesh)
            description.instances.append(Instance(k, place))
        settings = RenderSettings(16, 16, View((0.2, 0.1, 0.5), (0.0, 0.0, 0.0), fov=40.0), max_depth=2)
        return float(mean(render_frame(compile_scene(description), settings, 64), 24).mean())

    assert picture(2) == pytest.approx(picture(0), rel=5e-3)
