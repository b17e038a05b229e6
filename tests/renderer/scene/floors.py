"""Scenes with floors, which the renderer and the page frame alike."""

from __future__ import annotations

import numpy as np

from renderer.scene.description import Instance, Mesh, SceneDescription
from renderer.settings import Vec3

__all__ = ["FLOOR", "FRAMED_WHOLE", "FRAMED_WITHOUT_FLOOR", "cuboid", "scene"]


def cuboid(low: Vec3, high: Vec3) -> Mesh:
    corners = np.array([[(low, high)[n >> i & 1][i] for i in range(3)] for n in range(8)], np.float32)
    triangles = np.array([[0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4]], np.int32)
    return Mesh("cuboid", corners, triangles)


def scene(*parts: Mesh, **further: object) -> SceneDescription:
    """Returns a scene of one instance a mesh."""
    made = SceneDescription(meshes=list(parts), **further)  # type: ignore[arg-type]
    made.instances = [Instance(i, np.eye(4)) for i in range(len(parts))]
    return made


FLOOR = cuboid((-4, -0.05, -4), (4, 0, 4))
BOX = cuboid((-0.5, 0, -0.5), (0.5, 1, 0.5))


def terrain() -> Mesh:
    """Returns a plane with a hill in its middle, as one object."""
    x, z = np.meshgrid(np.linspace(-4, 4, 9), np.linspace(-4, 4, 9))
    heights = np.where((x == 0) & (z == 0), 2.0, 0.0)
    first = (np.arange(8)[:, None] * 9 + np.arange(8)).ravel()
    triangles = np.concatenate([np.stack([first, first + 9, first + 1], 1), np.stack([first + 1, first + 9, first + 10], 1)])
    return Mesh("terrain", np.stack([x, heights, z], 2).reshape(-1, 3).astype(np.float32), triangles.astype(np.int32))


FRAMED_WITHOUT_FLOOR: list[list[Mesh]] = [
    [FLOOR, BOX],
    [FLOOR, cuboid((-3, 0, -0.7), (-1.6, 1.4, 0.7)), cuboid((1.7, 0, -0.7), (3.1, 1.4, 0.7))],
    [FLOOR, cuboid((-0.5, -0.04, -0.5), (0.5, 1, 0.5))],  # a box that sinks into the floor
    [FLOOR, BOX, cuboid((-0.4, 0.5, -0.4), (0.4, 0.505, 0.4))],  # a flat thing above the floor
    [cuboid((-4, -0.05, -4), (0, 0, 4)), cuboid((0, -0.05, -4), (4, 0, 4)), BOX],  # a floor of two parts
]
FRAMED_WHOLE: list[list[Mesh]] = [
    [],
    [FLOOR],  # a floor alone
    [BOX],
    [terrain()],
    [terrain(), cuboid((1, 0.1, 1), (1.5, 1, 1.5))],  # ground that is not flat
    [FLOOR, BOX, cuboid((-4, 0, -4), (4, 3, -3.9))],  # a floor with a wall
    [FLOOR, cuboid((-3.5, 0, -3.5), (3.5, 1, 3.5))],  # a floor hardly wider than the box on it
    [
        cuboid((-4, 2, -4), (4, 2.05, 4)),
        *(cuboid((x, 0, z), (x + 0.2, 2, z + 0.2)) for x in (-2, 2) for z in (-2, 2)),
    ],  # a table
    [FLOOR, cuboid((-0.5, -3, -0.5), (0.5, 1, 0.5))],  # a box that passes through the floor
    [FLOOR, cuboid((-0.5, 0, -0.5), (0.5, 12, 0.5))],  # a tower, higher than the floor is wide
]
