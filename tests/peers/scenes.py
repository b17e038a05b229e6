"""Small scenes rendered by both Rayfarm and Mitsuba."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from renderer.scene.description import Environment, Image, Instance, Light, Material, Mesh, SceneDescription, Sphere, Texture
from renderer.scene.load import read
from renderer.scene.normals import smoothed
from renderer.settings import RenderSettings, View
from tests.renderer.builders import box, emitter, gray, icosphere, square

__all__ = ["SCENES"]

Case = tuple[SceneDescription, RenderSettings]
SCENES: dict[str, Callable[[], Case]] = {}

SIZE = 48
FLOOR = square((0, 0, 0), (4, 0, 0), (0, 0, -4), 0)
WHITE = Material(base_color=(0.8, 0.75, 0.7))


def _case(build: Callable[[], Case]) -> Callable[[], Case]:
    SCENES[build.__name__] = build
    return build


def _settings(view: View, max_depth: int = 6) -> RenderSettings:
    return RenderSettings(SIZE, SIZE, view, max_depth=max_depth, sampler="independent", filter="box")


def _view(fov: float = 36.0, **more: object) -> View:
    return View((0.0, 2.2, 5.5), (0.0, 0.8, 0.0), (0.0, 1.0, 0.0), fov, **more)


def _scene(materials: list[Material], meshes: list[Mesh], **more: object) -> SceneDescription:
    return SceneDescription(meshes=meshes, instances=[Instance(i) for i in range(len(meshes))], materials=materials, **more)


def _ceiling(material: int, side: float = 0.8, height: float = 3.5) -> Mesh:
    return square((0, height, 0.5), (side, 0, 0), (0, 0, side), material)


def _on_the_floor(*tested: Material) -> SceneDescription:
    """Returns a scene of spheres in a row on a floor, one for each of the given materials, with a square light and a dim sky."""
    x = [0.0] if len(tested) == 1 else [-1.1, 1.1]
    radius = 0.9
    return _scene(
        [WHITE, emitter(6.0), *tested],
        [FLOOR, _ceiling(1)],
        spheres=[Sphere((x[i], radius + 0.05, 0.0), radius, 2 + i) for i in range(len(tested))],
        environment=Environment(color=(0.2, 0.25, 0.3)),
    )


def _sky() -> np.ndarray:
    """Returns a smooth sky with a bright patch, (16, 32, 3)."""
    v, u = np.meshgrid((np.arange(16) + 0.5) / 16, (np.arange(32) + 0.5) / 32, indexing="ij")
    patch = 8 * np.exp(-((u - 0.3) ** 2 + (v - 0.25) ** 2) / 0.005)
    return np.stack([0.3 + patch, 0.3 + 0.4 * (1 - v) + 0.8 * patch, 0.2 + 0.8 * (1 - v) + 0.5 * patch], -1).astype(np.float32)


@_case
def cornell_box() -> Case:
    description = read(Path(__file__).parents[2] / "scenes", "cornell-box.yaml")
    return description, _settings(description.cameras[0].view, 8)


@_case
def mirror_and_glass() -> Case:
    tested = (
        Material(kind="mirror", base_color=(0.9, 0.8, 0.6)),
        Material(kind="glass", base_color=(0.95, 0.9, 1.0), ior=1.5, roughness=0.0),
    )
    return _on_the_floor(*tested), _settings(_view(), 10)


@_case
def environment_image() -> Case:
    description = _scene(
        [WHITE, Material(kind="mirror", base_color=gray(0.9))],
        [FLOOR, box(0, 0.5, (-1.2, 0.5, 0))],
        spheres=[Sphere((0.8, 0.8, 0), 0.8, 1)],
        images=[Image("sky", _sky(), srgb=False)],
        environment=Environment(color=(1.0, 0.9, 0.8), image=0, strength=1.5, rotation=40.0),
    )
    return description, _settings(_view(45))


@_case
def sphere_lights() -> Case:
    description = _scene(
        [WHITE, Material(base_color=gray(0.1), emission=(9, 6, 3)), Material(base_color=gray(0.3), emission=(20, 30, 60))],
        [FLOOR, box(0, 0.6, (0, 0.6, 0))],
        spheres=[Sphere((-1.6, 1.0, 0.5), 0.4, 1), Sphere((1.3, 1.9, -0.2), 0.1, 2), Sphere((0.9, 0.2, 1.2), 0.2, 1)],
    )
    return description, _settings(_view())


@_case
def textured_light() -> Case:
    codes = np.random.default_rng(3).integers(0, 256, (8, 8, 4)).astype(np.uint8)
    light = square((0, 1.2, -1.2), (1.6, 0, 0), (0, 1.1, 0), 1)
    light.uvs = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32)
    description = _scene(
        [WHITE, Material(base_color=gray(0.2), emission=(3, 3, 3), emission_texture=0)],
        [FLOOR, light, box(0, 0.4, (0.5, 0.4, 0.6))],
        textures=[Texture(0, "clamp", "clamp")],
        images=[Image("squares", codes)],
    )
    return description, _settings(_view())


@_case
def textured_floor_and_smooth_normals() -> Case:
    codes = np.random.default_rng(4).integers(0, 256, (6, 5, 4)).astype(np.uint8)
    floor = square((0, 0, 0), (4, 0, 0), (0, 0, -4), 3)
    floor.uvs = np.array([(-1, 2), (2, 2), (2, -1), (-1, -1)], np.float32)
    description = _scene(
        [WHITE, emitter(6.0), Material(base_color=(0.6, 0.3, 0.2)), Material(base_color=gray(0.9), base_color_texture=0)],
        [floor, _ceiling(1), smoothed(icosphere(4, 2, 0.9, (0, 1, 0)))],
        textures=[Texture(0, "mirror", "mirror")],
        images=[Image("squares", codes)],
        environment=Environment(color=gray(0.3)),
    )
    return description, _settings(_view())


@_case
def thin_lens() -> Case:
    description = _scene(
        [WHITE, emitter(5.0), Material(base_color=(0.7, 0.2, 0.1))],
        [FLOOR, _ceiling(1, 1.2), box(2, 0.4, (-0.9, 0.4, -2.0)), box(2, 0.4, (0.2, 0.4, 0.3)), box(2, 0.3, (1.0, 0.3, 2.4))],
        environment=Environment(color=(0.3, 0.4, 0.6)),
    )
    return description, _settings(_view(aperture=0.5, focus=5.2), 4)


@_case
def orthographic() -> Case:
    description = _scene(
        [WHITE, emitter(5.0), Material(base_color=(0.2, 0.5, 0.7))],
        [FLOOR, _ceiling(1, 1.2), box(2, 0.6, (-0.7, 0.6, 0)), box(2, 0.3, (0.9, 0.3, 0.8))],
        environment=Environment(color=gray(0.2)),
    )
    return description, _settings(_view(projection="orthographic", height=3.0), 4)


@_case
def point_spot_and_directional_light() -> Case:
    lights = [
        Light("point", (6.0, 5.0, 3.0), position=(-1.5, 2.0, 1.5)),
        Light(
            "spot",
            (3.0, 6.0, 12.0),
            position=(1.8, 3.0, 1.0),
            direction=(-0.4, -1.0, -0.3),
            inner_cone=9.0,
            outer_cone=26.0,
            falloff="linear",
        ),
        Light("directional", (0.6, 0.6, 0.5), direction=(-1.0, -2.0, -0.5)),
    ]
    description = _scene([WHITE, Material(base_color=gray(0.5))], [FLOOR, box(1, 0.5, (0, 0.5, 0))], lights=lights)
    return description, _settings(_view(), 3)


@_case
def metals_of_measured_index() -> Case:
    """Returns spheres of gold and copper by their measured refractive indices.

    Their roughness is low, since the renderers differ in multiple scattering on rougher metals.
    """
    gold = Material(kind="conductor", eta=(0.143, 0.375, 1.442), k=(3.983, 2.386, 1.603), roughness=0.0)
    copper = Material(kind="conductor", eta=(0.200, 0.924, 1.102), k=(3.912, 2.452, 2.142), roughness=0.1)
    return _on_the_floor(gold, copper), _settings(_view())


@_case
def rough_glass() -> Case:
    frosted = Material(kind="glass", base_color=gray(1.0), ior=1.5, roughness=0.1)
    return _on_the_floor(frosted), _settings(_view(), 10)


@_case
def white_rough_metal() -> Case:
    return _on_the_floor(Material(kind="metallic_roughness", base_color=gray(1.0), metallic=1.0, roughness=0.1)), _settings(
        _view()
    )


@_case
def normal_map() -> Case:
    """Returns two normal maps, one on a rotated wall and one, with axes exchanged, on a slope.

    The picture shows if an axis of the maps is swapped or flipped.
    """
    y, x = np.meshgrid(np.arange(32) / 32 * 2 * math.pi, np.arange(32) / 32 * 2 * math.pi, indexing="ij")
    n = np.stack([0.08 * np.cos(x), 0.06 * np.cos(2 * y), np.ones_like(x)], -1)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    codes = np.concatenate([np.rint((n * 0.5 + 0.5) * 255), np.full((32, 32, 1), 255)], -1).astype(np.uint8)
    bumpy = Material(base_color=(0.7, 0.7, 0.6), normal_texture=0)
    wall = square((-0.9, 1.3, -1.0), (1.0, 0, -0.3), (0.1, 1.3, 0), 2)
    slope = square((1.0, 0.7, 0.0), (0.9, 0, 0), (0, 0.6, -0.8), 2)
    wall.uvs = np.array([(0, 2), (2, 2), (2, 0), (0, 0)], np.float32)
    slope.uvs = np.array([(0, 0), (0, 2), (2, 2), (2, 0)], np.float32)
    for mesh in (wall, slope):
        normal = np.cross(mesh.positions[1] - mesh.positions[0], mesh.positions[3] - mesh.positions[0])
        mesh.normals = np.tile(normal / np.linalg.norm(normal), (4, 1)).astype(np.float32)
    description = _scene(
        [WHITE, emitter(30.0), bumpy],
        [FLOOR, wall, slope, square((1.5, 3.5, 1.5), (0.4, 0, 0), (0, 0, 0.4), 1)],
        textures=[Texture(0)],
        images=[Image("bumps", codes, srgb=False)],
    )
    # Weak bumps and one bounce: light that a bent normal reflects below the facet is lost in Mitsuba, and scattered again here.
    return description, _settings(_view(), 2)


@_case
def alpha_blend() -> Case:
    codes = np.random.default_rng(6).integers(0, 256, (4, 4, 4)).astype(np.uint8)
    codes[:2, :2, 3] = 0
    pane = square((0, 1.2, 1.0), (1.2, 0, 0), (0, 1.0, 0), 2)
    pane.uvs = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32)
    description = _scene(
        [
            WHITE,
            emitter(6.0),
            Material(base_color=gray(0.9), base_color_texture=0, alpha_mode="blend"),
            Material(base_color=(0.6, 0.1, 0.1)),
        ],
        [FLOOR, _ceiling(1, 1.0), pane, box(3, 0.5, (0.3, 0.5, -0.8))],
        textures=[Texture(0, "clamp", "clamp")],
        images=[Image("holes", codes)],
        environment=Environment(color=gray(0.2)),
    )
    # Mitsuba counts passing a pane as a bounce, so the depth is large enough that the limit does not matter.
    return description, _settings(_view(), 24)


@_case
def instances() -> Case:
    meshes = [FLOOR, _ceiling(1, 1.2), icosphere(2, 2, 0.45), box(3, 0.3)]
    description = SceneDescription(
        meshes=meshes,
        materials=[WHITE, emitter(6.0), Material(base_color=(0.3, 0.6, 0.2)), Material(base_color=(0.6, 0.4, 0.2))],
        environment=Environment(color=gray(0.3)),
    )
    description.instances = [Instance(0), Instance(1)]
    rng = np.random.default_rng(9)
    for i in range(14):
        turn = np.eye(4)
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        turn[:3, :3] = q * np.sign(np.linalg.det(q)) @ np.diag(rng.uniform(0.5, 1.3, 3))
        turn[:3, 3] = (-1.8 + 0.9 * (i % 5), 0.5 + 0.2 * (i % 2), 1.0 - 1.1 * (i // 5))
        description.instances.append(Instance(2 + i % 2, turn))
    return description, _settings(_view(), 5)
