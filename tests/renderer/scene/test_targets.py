"""Tests of which bodies paths aim at: lights enclosed in smooth glass, and bodies that the scene file marks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.arrays.light_rows import TARGET_CENTER, TARGET_GUARD, TARGET_GUARD2, TARGET_RADIUS
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Instance, Light, Material, Mesh, SceneDescription, Sphere
from renderer.scene.targets import MAX_TARGETS
from tests.renderer.builders import emitter, gray, icosphere, square

WHITE, GLASS, LAMP, FAINT = 0, 1, 2, 3
PLACE = (0.0, 1.0, 0.0)


def described(meshes: tuple[Mesh, ...] = (), spheres: tuple[Sphere, ...] = (), **glass: object) -> SceneDescription:
    """Returns a floor with these bodies. glass: changes to the glass."""
    floor = square((0, 0, 0), (3, 0, 0), (0, 0, -3), WHITE)
    materials = [
        Material(base_color=gray(0.6)),
        Material(kind="glass", **{"roughness": 0.0, **glass}),
        emitter(100.0),
        emitter(0.01),
    ]
    return SceneDescription(
        meshes=[floor, *meshes],
        instances=[Instance(n) for n in range(1 + len(meshes))],
        spheres=list(spheres),
        materials=materials,
    )


def targets(description: SceneDescription) -> np.ndarray:
    return compile_scene(description).target


def shell(thickness: float, material: int = GLASS) -> Mesh:
    """Returns a hollow ball of radius 0.5 about PLACE."""
    ball = icosphere(3, material, 0.5)
    points = np.concatenate([ball.positions, (1 - thickness) * ball.positions]).astype(np.float32) + np.array(PLACE, np.float32)
    return Mesh(
        "shell", points, np.concatenate([ball.triangles, ball.triangles[:, ::-1] + len(ball.positions)]), material=material
    )


def without_bottom(mesh: Mesh, below: float) -> Mesh:
    """Returns a mesh without the triangles that lie wholly below a height."""
    return replace(mesh, triangles=mesh.triangles[(mesh.positions[mesh.triangles][:, :, 1] > below).any(axis=1)])


def test_lamp_in_glass_ball_has_two_targets():
    found = targets(described(spheres=(Sphere(PLACE, 0.5, GLASS), Sphere(PLACE, 0.1, LAMP))))
    np.testing.assert_allclose(found[:, TARGET_CENTER : TARGET_CENTER + 3], [PLACE, PLACE])
    np.testing.assert_allclose(found[:, TARGET_RADIUS], [1.05 * 1.5 * 0.1, 0.5], rtol=1e-6)  # magnified by the index 1.5
    np.testing.assert_allclose(found[:, TARGET_GUARD : TARGET_GUARD + 3], [PLACE, PLACE])
    np.testing.assert_allclose(found[:, TARGET_GUARD2], 0.25, rtol=3e-3)


def test_hollow_bulb_target_is_not_magnified():
    found = targets(described((shell(0.05),), (Sphere(PLACE, 0.1, LAMP),)))
    np.testing.assert_allclose(found[:, TARGET_RADIUS], [1.05 * 0.1, 0.5], rtol=1e-5)


def test_fine_glass_is_sampled(monkeypatch):
    monkeypatch.setattr("renderer.scene.targets._MOST_TRIANGLES", 300)  # of 2,560
    found = targets(described((shell(0.05),), (Sphere((0.0, 1.0, 0.1), 0.1, LAMP),)))
    np.testing.assert_allclose(found[:, TARGET_RADIUS], [1.05 * 0.1, 0.5], rtol=1e-5)


def test_bulb_may_be_open_below_but_bowl_does_not_enclose():
    lamp = (Sphere(PLACE, 0.1, LAMP),)
    assert len(targets(described((without_bottom(shell(0.05), 0.7),), lamp))) == 2
    assert len(targets(described((without_bottom(icosphere(3, GLASS, 0.5, PLACE), 1.2),), lamp))) == 0


def test_lamp_filling_its_glass_has_one_target():
    found = targets(described(spheres=(Sphere(PLACE, 0.5, GLASS), Sphere(PLACE, 0.4, LAMP))))
    np.testing.assert_allclose(found[:, TARGET_RADIUS], [0.5])


def test_lamps_in_one_glass_share_a_target():
    lamps = tuple(Sphere((0.1 * k, 1.0, 0.0), 0.02, LAMP) for k in (-1, 0, 1))
    found = targets(described(spheres=(Sphere(PLACE, 0.5, GLASS), *lamps)))
    np.testing.assert_allclose(found[:, TARGET_RADIUS], [1.05 * 1.5 * 0.12, 0.5], rtol=1e-5)


def test_target_covers_the_motion_of_a_bulb():
    ball = Sphere(PLACE, 0.5, GLASS, keys=tuple(((x, 1.0, 0.0), 0.5) for x in (-1.0, 1.0)), moves=True)
    lamp = Sphere(PLACE, 0.4, LAMP, keys=tuple(((x, 1.0, 0.0), 0.4) for x in (-1.0, 1.0)), moves=True)
    found = targets(described(spheres=(ball, lamp)))
    np.testing.assert_allclose(found[:, TARGET_RADIUS], [1.5])


@pytest.mark.parametrize(
    ("lamp", "glass"),
    [
        (Sphere((0.0, 1.0, 1.0), 0.1, LAMP), {}),  # beside the glass
        (Sphere((0.45, 1.0, 0.0), 0.1, LAMP), {}),  # half out of it
        (Sphere(PLACE, 0.1, LAMP), {"roughness": 0.3}),  # light sampling finds what is behind rough glass
        (Sphere(PLACE, 0.1, WHITE), {}),
    ],
)
def test_unenclosed_lamps_are_no_targets(lamp, glass):
    assert len(targets(described(spheres=(Sphere(PLACE, 0.5, GLASS), lamp), **glass))) == 0


@pytest.mark.parametrize("kind", ["a lamp", "a sky", "a light without a body"])
def test_weak_lamp_is_no_target(kind):
    description = described(spheres=(Sphere(PLACE, 0.5, GLASS), Sphere(PLACE, 0.1, FAINT)))
    assert len(targets(description)) == 2
    if kind == "a lamp":
        description.spheres.append(Sphere((2, 2, 2), 0.3, LAMP))
    elif kind == "a sky":
        description.environment = Environment()
    else:
        description.lights.append(Light("point", gray(10.0), (0, 3, 0)))
    assert len(targets(description)) == 0


def test_instanced_glass_is_transformed():
    description = described((icosphere(3, GLASS, 0.25),), (Sphere(PLACE, 0.1, LAMP),))
    assert len(targets(description)) == 0
    place = np.diag([2.0, 2.0, 2.0, 1.0])
    place[:3, 3] = PLACE
    description.instances[1] = Instance(1, place)
    np.testing.assert_allclose(targets(description)[:, TARGET_RADIUS], [1.05 * 1.5 * 0.1, 0.5], rtol=1e-5)


def test_marked_bodies_are_targets():
    description = described((icosphere(2, GLASS, 0.5, PLACE),), (Sphere((2.0, 1.0, 0.0), 0.3, WHITE, guide=True),))
    description.instances[1] = Instance(1, guide=True)
    found = targets(description)
    np.testing.assert_allclose(found[:, TARGET_CENTER : TARGET_CENTER + 4], [[2, 1, 0, 0.3], [*PLACE, 0.5]], atol=1e-6)


def test_strongest_targets_are_kept():
    pairs = [(Sphere((x, 1.0, 0.0), 0.3, GLASS), Sphere((x, 1.0, 0.0), 0.2 + 0.001 * x, LAMP)) for x in range(20)]
    found = targets(described(spheres=tuple(sphere for pair in pairs for sphere in pair)))
    assert len(found) == MAX_TARGETS
    assert found[0, TARGET_CENTER] == 19
    assert found[:, TARGET_CENTER].min() == 20 - MAX_TARGETS
