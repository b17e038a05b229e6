"""Tests of the default camera of scenes with a wide, flat floor: it frames what stands on it, and nothing else is cut."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.scene.compile import camera_dicts
from renderer.scene.default_camera import frame
from renderer.scene.description import Instance, Mesh, SceneDescription, Sphere
from renderer.scene.standing import standing_box
from renderer.settings import Vec3


def cuboid(low: Vec3, high: Vec3) -> Mesh:
    corners = np.array([[(low, high)[n >> i & 1][i] for i in range(3)] for n in range(8)], np.float32)
    triangles = np.array([[0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4]], np.int32)
    return Mesh("cuboid", corners, triangles)


def scene(*parts: Mesh, **further: object) -> SceneDescription:
    made = SceneDescription(meshes=list(parts), **further)  # type: ignore[arg-type]
    made.instances = [Instance(i, np.eye(4)) for i in range(len(parts))]
    return made


FLOOR = cuboid((-4, -0.05, -4), (4, 0, 4))
BOX = cuboid((-0.5, 0, -0.5), (0.5, 1, 0.5))


def test_automatic_camera_frames_what_stands_on_a_floor() -> None:
    description = scene(FLOOR, cuboid((-3, 0, -0.7), (-1.6, 1.4, 0.7)), spheres=[Sphere((2.4, 0.7, 0), 0.7)])
    expected = [(-3, 0, -0.7), (3.1, 1.4, 0.7)]
    found = standing_box(description)
    assert found is not None
    np.testing.assert_allclose(found, expected, atol=1e-6)
    corners = np.array([mesh.positions for mesh in description.meshes], np.float64).reshape(-1, 3)
    bounds = np.array([(-4, -0.05, -4), (4, 1.4, 4)])
    view = camera_dicts(description, bounds, corners)[-1]["view"]
    assert np.linalg.norm(np.subtract(view["eye"], view["target"])) < 0.8 * np.linalg.norm(
        np.subtract(frame(corners).eye, frame(corners).target)
    )


def test_floor_with_z_up_and_things_that_sink_into_it() -> None:
    description = scene(cuboid((-9, -9, -0.1), (9, 9, 0)), cuboid((0, 0, -0.04), (1, 1, 2)), up=(0.0, 0.0, 1.0))
    found = standing_box(description)
    assert found is not None
    np.testing.assert_allclose(found, [(0, 0, -0.04), (1, 1, 2)], atol=1e-6)


def terrain() -> Mesh:
    """Returns a plane with a hill in its middle, as one object."""
    x, z = np.meshgrid(np.linspace(-4, 4, 9), np.linspace(-4, 4, 9))
    heights = np.where((x == 0) & (z == 0), 2.0, 0.0)
    first = (np.arange(8)[:, None] * 9 + np.arange(8)).ravel()
    triangles = np.concatenate([np.stack([first, first + 9, first + 1], 1), np.stack([first + 1, first + 9, first + 10], 1)])
    return Mesh("terrain", np.stack([x, heights, z], 2).reshape(-1, 3).astype(np.float32), triangles.astype(np.int32))


@pytest.mark.parametrize(
    "parts",
    [
        [FLOOR],  # nothing else
        [BOX],
        [terrain()],
        [terrain(), cuboid((1, 0.1, 1), (1.5, 1, 1.5))],  # ground that is not flat
        [FLOOR, BOX, cuboid((-4, 0, -4), (4, 3, -3.9))],  # with a wall
        [FLOOR, cuboid((-3.5, 0, -3.5), (3.5, 1, 3.5))],  # hardly wider
        [
            cuboid((-4, 2, -4), (4, 2.05, 4)),
            *(cuboid((x, 0, z), (x + 0.2, 2, z + 0.2)) for x in (-2, 2) for z in (-2, 2)),
        ],  # a table
        [FLOOR, cuboid((-0.5, -3, -0.5), (0.5, 1, 0.5))],  # which passes through
        [FLOOR, cuboid((-0.5, 0, -0.5), (0.5, 12, 0.5))],  # a tower, higher than the floor is wide
    ],
)
def test_other_scenes_are_framed_whole(parts: list[Mesh]) -> None:
    assert standing_box(scene(*parts)) is None
