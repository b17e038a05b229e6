"""The scenes of hard light as Blender's data, without Blender: blender_peer.py makes them. Imports NumPy only."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tests.benchmarks.hard.scenes import HardScene, Surface
from tests.benchmarks.hard.shapes import Point

__all__ = ["BlenderLamp", "BlenderMesh", "BlenderScene", "blender_scene", "to_z_up"]

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class BlenderMesh:
    """A mesh in Blender's space. is_caster: whether it is marked as a caster of shadow caustics, otherwise as a receiver."""

    name: str
    surface: str
    positions: F64
    triangles: npt.NDArray[np.int64]
    normals: F64 | None
    is_caster: bool


@dataclass(frozen=True)
class BlenderLamp:
    """A rectangular area lamp in Blender's space. size: of its sides. x_axis, y_axis: along them; it shines along -z_axis.

    color, energy: their product is the radiant power, as Blender has it, of a lamp that shines to one side.
    """

    name: str
    center: F64
    x_axis: F64
    y_axis: F64
    size: tuple[float, float]
    color: tuple[float, ...]
    energy: float

    @property
    def z_axis(self) -> F64:
        """Unit vector, opposite to the direction of its light."""
        return np.cross(self.x_axis, self.y_axis)


@dataclass(frozen=True)
class BlenderScene:
    """A scene in Blender's space, whose up direction is z. fov: degrees, vertical. Sun: direction of its light, and strength."""

    meshes: list[BlenderMesh]
    lamps: list[BlenderLamp]
    surfaces: dict[str, Surface]
    eye: F64
    target: F64
    fov: float
    sky: tuple[float, ...]
    sun: tuple[F64, tuple[float, ...], float] | None


def to_z_up(vectors: F64 | Point) -> F64:
    """Returns vectors, (..., 3), of a space whose up direction is y in Blender's."""
    x, y, z = np.moveaxis(np.asarray(vectors, float), -1, 0)
    return np.stack([x, -z, y], -1)


def blender_scene(scene: HardScene, with_lamps: bool) -> BlenderScene:
    """Returns the scene in Blender's terms. with_lamps: lights are lamps, which shadow caustics need, and not meshes."""
    meshes, lamps = [], []
    for part in scene.parts:
        surface, shape = scene.surfaces[part.surface], part.shape
        positions = to_z_up(shape.positions)
        if surface.kind == "light" and with_lamps:
            lamps.append(_lamp(part.name, positions, surface.color))
            continue
        normals = None if shape.normals is None else to_z_up(shape.normals)
        if normals is None and surface.kind == "glass":  # shadow caustics refuse flat shading
            normals = _normals_of_faces(positions, shape.triangles)
        meshes.append(BlenderMesh(part.name, part.surface, positions, shape.triangles, normals, surface.kind == "glass"))
    sun = None
    if scene.sun is not None:
        strength = max(scene.sun.irradiance)
        sun = (to_z_up(scene.sun.direction), tuple(c / strength for c in scene.sun.irradiance), strength)
    black = (0.0, 0.0, 0.0)
    eye, target = to_z_up(scene.eye), to_z_up(scene.target)
    return BlenderScene(meshes, lamps, scene.surfaces, eye, target, scene.fov, scene.sky or black, sun)


def _normals_of_faces(positions: F64, triangles: npt.NDArray[np.int64]) -> F64:
    """Returns the normal of each vertex of a mesh, (V, 3), whose faces share no vertices with faces in other planes."""
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    normals = np.empty_like(positions)
    for k in range(3):
        normals[triangles[:, k]] = np.cross(b - a, c - a)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _lamp(name: str, corners: F64, radiance: tuple[float, ...]) -> BlenderLamp:
    """Returns the lamp of a rectangle whose front emits `radiance`: its power is pi times radiance and area."""
    u, v = corners[1] - corners[0], corners[3] - corners[0]
    width, height = float(np.linalg.norm(u)), float(np.linalg.norm(v))
    strength = max(radiance)
    color = tuple(c / strength for c in radiance)
    # Along -u, so that -z_axis is u x v, which points to the front.
    return BlenderLamp(name, corners.mean(0), -u / width, v / height, (width, height), color, strength * width * height * math.pi)
