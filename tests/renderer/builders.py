"""Small scenes for tests, built as scene descriptions and compiled like any other scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from renderer.arrays.kernel_variant import strip_absent_features
from renderer.arrays.scene import CompiledScene
from renderer.bvh.layout import Bvh
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Image, Instance, Light, Material, Mesh, SceneDescription, Sphere
from renderer.scene.readers import shapes
from renderer.settings import RenderSettings, View


def gray(value: float) -> tuple[float, float, float]:
    return (value, value, value)


def emitter(radiance: float, albedo: float = 0.0, **more: object) -> Material:
    return Material(base_color=gray(albedo), emission=gray(radiance), **more)


def square(center: tuple[float, ...], u: tuple[float, ...], v: tuple[float, ...], material: int) -> Mesh:
    """Returns the parallelogram with corners center +- u +- v; its front side faces along u x v."""
    c, u_, v_ = (np.array(x, np.float64) for x in (center, u, v))
    corners = np.array([c - u_ - v_, c + u_ - v_, c + u_ + v_, c - u_ + v_], np.float32)
    return Mesh("square", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), material=material)


def disk(radius: float, height: float, segments: int, material: int) -> Mesh:
    """Returns a horizontal disk about the y axis, facing down, with the area of a circle of the given radius."""
    turns = np.arange(segments) * (2 * np.pi / segments)
    radius *= np.sqrt(2 * np.pi / (segments * np.sin(2 * np.pi / segments)))
    rim = np.stack([np.cos(turns) * radius, np.full(segments, height), np.sin(turns) * radius], 1)
    positions = np.concatenate([[[0, height, 0]], rim]).astype(np.float32)
    i = np.arange(segments)
    triangles = np.stack([np.zeros_like(i), 1 + i, 1 + (i + 1) % segments], 1).astype(np.int32)
    return Mesh("disk", positions, triangles, material=material)


def scene(
    materials: list[Material],
    meshes: tuple[Mesh, ...] = (),
    spheres: tuple[Sphere, ...] = (),
    environment: float | np.ndarray | Environment | None = None,
    lights: tuple[Light, ...] = (),
) -> CompiledScene:
    """Returns the compiled scene. environment: a constant radiance, an image (h, w, 3) float32, or an Environment."""
    description = SceneDescription(
        meshes=list(meshes),
        instances=[Instance(i) for i in range(len(meshes))],
        spheres=list(spheres),
        materials=materials,
        lights=list(lights),
    )
    if isinstance(environment, np.ndarray):
        description.images.append(Image("sky", environment.astype(np.float32), srgb=False))
        description.environment = Environment(image=0)
    elif isinstance(environment, Environment):
        description.environment = environment
    elif environment is not None:
        description.environment = Environment(color=gray(environment))
    return compile_scene(description)


def as_rendered(made: CompiledScene) -> CompiledScene:
    """Returns the scene with the argument types of already compiled kernels, which test kernels can then call."""
    return strip_absent_features(made, "full")


def still(bvh: Bvh) -> Bvh:
    """Returns a tree of static primitives with the argument types that compiled kernels already have; see `as_rendered`."""
    return kept(bvh)._replace(motion=None, instance_motion=None, keyed_packets=None)


def kept(bvh: Bvh) -> Bvh:
    """Returns a tree that a test has assembled, with its first four arrays read-only, as in trees that `build` returns.

    Compiled kernels thus need no new compilation.
    """
    views = {name: getattr(bvh, name).view() for name in Bvh._fields[:4]}
    for view in views.values():
        view.flags.writeable = False
    return bvh._replace(**views)


def settings(
    eye: tuple[float, ...], target: tuple[float, ...], fov: float = 1.0, size: int = 24, **more: object
) -> RenderSettings:
    """Returns settings for a square picture from `eye` towards `target`, `fov` degrees wide, and of `size` pixels a side.

    Further settings are in `more`. The `up` vector is never parallel to the line of sight.
    """
    more.setdefault("filter", "box")
    sight = np.subtract(target, eye)
    up = (0.0, 1.0, 0.0) if abs(sight[1]) < 0.9 * np.linalg.norm(sight) else (0.0, 0.0, 1.0)
    return RenderSettings(size, size, View(tuple(eye), tuple(target), up, fov), **more)


def icosphere(levels: int, material: int = 0, scale: float = 1.0, center: tuple[float, ...] = (0, 0, 0)) -> Mesh:
    """Returns a sphere approximated by 20 * 4**levels flat triangles with shared vertices, closed and facing outwards."""
    golden = (1 + 5**0.5) / 2
    corner = np.array([np.roll((0.0, s, t * golden), k) for k in range(3) for s in (-1, 1) for t in (-1, 1)])
    corner /= np.linalg.norm(corner[0])
    near = np.isclose(corner @ corner.T, 5**-0.5)
    faces = [(i, j, k) for i in range(12) for j in range(i) for k in range(j) if near[i, j] and near[j, k] and near[i, k]]
    faces = [f if np.linalg.det(corner[list(f)]) > 0 else f[::-1] for f in faces]
    points = list(corner)
    for _ in range(levels):
        made: dict[tuple[int, int], int] = {}
        finer = []
        for a, b, c in faces:
            halves = []
            for i, j in ((a, b), (b, c), (c, a)):
                key = (min(i, j), max(i, j))
                if key not in made:
                    made[key] = len(points)
                    points.append((points[i] + points[j]) / np.linalg.norm(points[i] + points[j]))
                halves.append(made[key])
            ab, bc, ca = halves
            finer += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = finer
    positions = np.array(points) * scale + np.array(center)
    return Mesh("icosphere", positions.astype(np.float32), np.array(faces, np.int32), material=material)


def box(material: int, scale: float = 1.0, center: tuple[float, ...] = (0, 0, 0)) -> Mesh:
    """Returns a closed cube with edges of length 2 * scale, facing outwards."""
    mesh = shapes.cube("box")
    return replace(mesh, positions=(mesh.positions * scale + np.array(center)).astype(np.float32), material=material)
