"""Small scenes, each with one feature that the pool and the single-path integrator implement differently."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from renderer.arrays.scene import CompiledScene
from renderer.lens_distortion import LensDistortion
from renderer.scene.compile import compile_scene
from renderer.scene.description import (
    EmissionKind,
    EmissionMap,
    Environment,
    Image,
    Instance,
    Light,
    LightLink,
    Material,
    Medium,
    Mesh,
    SceneDescription,
    Sphere,
    Texture,
    Volume,
)
from renderer.scene.material import with_visibility
from renderer.scene.readers.strands import Strand, strands_mesh
from renderer.settings import RenderSettings, View
from tests.renderer.builders import box, gray, icosphere, square

__all__ = ["CAUSTICS", "FEATURES", "GROUPS", "SIZE", "SPECTRAL", "Feature", "grouped", "made"]

SIZE = 32
GROUPS = ("key", "sky", "sun-1")
VIEW = View((0.0, 1.6, 5.0), (0.0, 0.7, 0.0), fov=45.0)
GLASS = {"kind": "glass", "base_color": gray(1.0), "roughness": 0.0}
BLEND = {"alpha_mode": "blend"}
PBR = {"kind": "metallic_roughness", "base_color": (0.8, 0.5, 0.3)}
GOLD = {"kind": "conductor", "eta": (0.2, 0.4, 1.4), "k": (4.0, 2.4, 1.6)}

Feature = tuple[Callable[[], CompiledScene], RenderSettings]


def _images() -> list[Image]:
    """Returns the images of the scenes: colours with alpha, roughness and metallic, bumps, emission."""
    random = np.random.default_rng(0)
    bumps = np.full((8, 8, 4), 255, np.uint8)
    bumps[..., :2] = random.integers(90, 166, (8, 8, 2))
    return [
        Image("colours", random.integers(60, 256, (8, 8, 4), np.uint8)),
        Image("parts", random.integers(40, 256, (8, 8, 4), np.uint8), srgb=False),
        Image("bumps", bumps, srgb=False),
        Image("sky", (random.random((8, 16, 3)) ** 4 * 3).astype(np.float32), srgb=False),
    ]


def _smooth(mesh: Mesh) -> Mesh:
    """Returns a mesh around the origin with normals, texture coordinates and colours at its vertices."""
    unit = mesh.positions / np.linalg.norm(mesh.positions, axis=1, keepdims=True)
    uvs = (unit[:, :2] * 2).astype(np.float32)
    return replace(mesh, normals=unit.astype(np.float32), uvs=uvs)


def strands(aspect: float = 1.0) -> Mesh:
    """Returns bent fibres of hair that stand on the floor, of material 0. aspect: of their cross-sections."""
    random = np.random.default_rng(2)
    along = np.linspace(0, 1, 6)[:, None]
    fibres = []
    for x, z, lean_x, lean_z in random.uniform(-1, 1, (60, 4)):
        points = np.column_stack([1.5 + 0.5 * x + 0.4 * lean_x * along**2, 1.5 * along, 0.5 * z + 0.4 * lean_z * along**2])
        fibres.append(Strand(points, np.linspace(0.03, 0.01, len(points))))
    return strands_mesh(fibres, fibres=True, aspect=aspect)


def flat_strands() -> Mesh:
    """Returns flat curves of the floor's material, in front of the ball."""
    curves = strands()
    return replace(curves, positions=curves.positions + np.float32((-1.5, 0, 1.2)), material=1, flat=True)


def _moved(x: float, y: float = 0.7, z: float = 0.0) -> np.ndarray:
    place = np.eye(4)
    place[:3, 3] = x, y, z
    return place


def _turned(angle: float) -> np.ndarray:
    """Returns a rotation about the vertical axis."""
    turn = np.eye(4)
    turn[0, 0] = turn[2, 2] = np.cos(angle)
    turn[0, 2], turn[2, 0] = np.sin(angle), -np.sin(angle)
    return turn


def room(material: Material, meshes: tuple[Mesh, ...] = (), **more: Any) -> SceneDescription:
    """Returns a floor and a wall, a lamp above, a dim sky, and a ball, a box and a smooth mesh of the material."""
    materials = [material, Material(base_color=(0.7, 0.6, 0.5)), Material(base_color=gray(0.0), emission=(9.0, 8.0, 7.0))]
    placed = (
        square((0, 0, 0), (6, 0, 0), (0, 0, -6), 1),
        square((0, 2, -3), (6, 0, 0), (0, 2, 0), 1),
        square((0, 4, 1), (1, 0, 0), (0, 0, 1), 2),
        box(0, 0.45, (1.5, 0.46, 0.3)),
        *meshes,
    )
    return SceneDescription(
        meshes=[*placed, _smooth(icosphere(2, 0, 0.65))],
        instances=[*(Instance(i) for i in range(len(placed))), Instance(len(placed), _moved(-1.4))],
        spheres=[Sphere((0.0, 0.7, 0.4), 0.65, 0), *more.pop("spheres", ())],
        materials=[*materials, *more.pop("materials", ())],
        environment=more.pop("environment", Environment(gray(0.3))),
        images=_images(),
        textures=[Texture(0), Texture(1), Texture(2)],
        **more,
    )


def colored(description: SceneDescription) -> SceneDescription:
    """Returns the scene with vertex colours and alpha on the smooth mesh."""
    mesh = description.meshes[-1]
    colors = np.random.default_rng(1).random((len(mesh.positions), 4)).astype(np.float32)
    description.meshes[-1] = replace(mesh, colors=colors)
    return description


def copies(material: Material) -> SceneDescription:
    """Returns a scene with enough copies of a mesh to be instanced, some with a different material."""
    description = room(material)
    description.meshes.append(icosphere(4, 0, 0.2))
    for i in range(20):
        place = _moved(-2.2 + 0.25 * i, 0.25, 1.2) @ np.diag([1.0, 1.0 + 0.05 * i, 0.8, 1.0])
        description.instances.append(Instance(len(description.meshes) - 1, place, material=1 if i % 3 == 0 else None))
    return description


def cards(count: int) -> tuple[Mesh, ...]:
    """Returns `count` parallel squares of material 3, coplanar with nothing else, the first in front of all other objects."""
    return tuple(square((0, 1, 1.97 - 0.0101 * i), (2, 0, 0), (0, 1, 0), 3) for i in range(count))


def lamps(count: int) -> SceneDescription:
    """Returns a scene with enough small lights for a light tree."""
    place = np.random.default_rng(2).uniform((-3, 0.2, -2.5), (3, 3, 2), (count, 3))
    balls = [Sphere(tuple(map(float, p)), 0.03, 2) for p in place]
    return room(Material(**PBR, roughness=0.4), spheres=balls, environment=None)


def bulb(material: Material, guide: bool = False, **more: Any) -> SceneDescription:
    """Returns a scene with a small lamp in a glass ball, and another in a hollow one. guide: whether a third body is marked."""
    hollow = icosphere(2, 3, 0.3)
    shell = Mesh(
        "shell",
        np.concatenate([hollow.positions, 0.95 * hollow.positions]),
        np.concatenate([hollow.triangles, hollow.triangles[:, ::-1] + len(hollow.positions)]),
        material=3,
    )
    glow = Material(base_color=gray(0.0), emission=gray(90.0))
    spheres = [Sphere((0.9, 1.5, 0.9), 0.3, 3), Sphere((0.9, 1.5, 0.9), 0.06, 4), Sphere((-1.0, 1.8, 0.4), 0.05, 4)]
    description = room(material, materials=[Material(**GLASS), glow], spheres=spheres, **more)
    description.meshes.append(shell)
    description.instances.append(Instance(len(description.meshes) - 1, _moved(-1.0, 1.8, 0.4)))
    description.spheres[0] = replace(description.spheres[0], guide=guide)
    return description


def moving(material: Material) -> SceneDescription:
    """Returns a scene with a moving and rotating body, a deforming mesh, and a moving sphere, lamp and punctual light."""
    description = room(material, keys=3)
    ball, last = description.meshes[-1], description.instances[-1]
    assert ball.normals is not None
    bent = [(ball.positions * (1 + np.float32(0.3 * k) * ball.normals[:, :1]), ball.normals) for k in range(3)]
    description.meshes[-1] = replace(ball, keys=tuple(bent), deforms=True)
    description.instances[-1] = replace(last, keys=tuple(_moved(-1.4, 0.7 + 0.1 * k) for k in range(3)), moves=True)
    spun = [_moved(0.1 * k, 0.05 * k, 0.2 * k) @ _turned(0.2 * k) for k in range(3)]
    description.instances[3] = replace(description.instances[3], keys=tuple(spun), moves=True)
    lamp = description.instances[2]
    description.instances[2] = replace(lamp, keys=tuple(_moved(0.3 * k, -0.2 * k) for k in range(3)), moves=True)
    sphere = description.spheres[0]
    description.spheres[0] = replace(sphere, keys=tuple(((0.0, 0.7 + 0.1 * k, 0.4), 0.65) for k in range(3)), moves=True)
    lights = [Light("point", gray(4.0), (1.0 + 0.2 * k, 2.0, 2.0), radius=0.1) for k in range(3)]
    description.lights.append(replace(lights[1], keys=tuple(lights)))
    return description


def sliding(material: Material) -> SceneDescription:
    """Returns a scene with moving textures."""
    description = room(material, keys=3)
    for k, (x, y) in enumerate(((0.5, 0.0), (0.0, -0.3), (0.2, 0.2))):
        keys = tuple((1.0, 0.0, x * step, 0.1 * step, 1.0, y * step) for step in range(3))
        description.textures[k] = replace(description.textures[k], keys=keys)
    return description


def hidden(material: Material) -> SceneDescription:
    """Returns a scene with lamps that rays pass through, one of them visible to the camera, and a ball hidden from the camera."""
    glow = {"base_color": gray(0.0), "emission": (3.0, 2.0, 1.0), "lamp": True}
    cards = tuple(square((x, 1.0, 2.0), (0.5, 0, 0), (0, 0.4, 0), n) for x, n in ((-0.6, 3), (0.6, 4)))
    ball = Sphere((1.4, 0.7, 0.4), 0.5, 5)
    description = room(
        material,
        cards,
        materials=[Material(**glow), Material(**glow, unseen=True), Material(base_color=gray(0.6), unseen=True)],
        spheres=[ball],
    )
    description.materials[2] = replace(description.materials[2], lamp=True, unseen=True)
    return description


def dark() -> SceneDescription:
    """Returns a scene without lights."""
    description = room(Material(base_color=gray(0.5)), environment=None)
    description.materials[2] = Material(base_color=gray(0.5))
    return description


def balls() -> SceneDescription:
    """Returns a scene without triangles."""
    return SceneDescription(
        spheres=[Sphere((0, -1e4, 0), 1e4, 0), Sphere((0, 0.7, 0.4), 0.65, 1), Sphere((1, 3, 1), 0.5, 2)],
        materials=[Material(base_color=gray(0.6)), Material(**GLASS), Material(base_color=gray(0.0), emission=gray(20.0))],
    )


def _feature(describe: Callable[[], SceneDescription], view: View = VIEW, **more: Any) -> Feature:
    return lambda: compile_scene(describe()), RenderSettings(SIZE, SIZE, view, **{"max_depth": 6, **more})


def _of(material: Material, **more: Any) -> Feature:
    return _feature(lambda: room(material), **more)


def _punctual() -> SceneDescription:
    lights = [
        Light("point", gray(4.0), (1.0, 2.0, 2.0), radius=0.1),
        Light("spot", gray(9.0), (-2.0, 3.0, 1.0), (0.5, -1.0, 0.0), inner_cone=10.0, outer_cone=40.0),
        Light("directional", gray(1.0), direction=(0.3, -1.0, -0.5), angle=2.0),
    ]
    return room(Material(**PBR, roughness=0.3), lights=lights)


def linked(material: Material, **more: Any) -> SceneDescription:
    """Returns a scene in which a lamp, a point light and a visible sun illuminate some objects only."""
    lights = [
        Light("point", gray(4.0), (1.0, 2.0, 2.0), radius=0.1, light_link="ball"),
        Light("spot", gray(9.0), (-2.0, 3.0, 1.0), (0.5, -1.0, 0.0), inner_cone=10.0, outer_cone=40.0),
        Light("directional", gray(1.0), direction=(0.0, -0.3, 1.0), angle=20.0, seen="always", light_link="no floor"),
    ]
    description = room(material, lights=lights, **more)
    names = ("floor", "wall", "lamp", "box")
    description.instances[:4] = [replace(i, name=name) for i, name in zip(description.instances, names, strict=False)]
    description.spheres[0] = replace(description.spheres[0], name="ball")
    description.materials[2] = replace(description.materials[2], light_link="no wall")
    links = {"ball": (("ball", "box"), ()), "no floor": (None, ("floor",)), "no wall": (None, ("wall", "ball"))}
    description.light_links = {name: LightLink(*link) for name, link in links.items()}
    return description


def seen_by_kind(material: Material, **more: Any) -> SceneDescription:
    """Returns the scene of `linked` with shadow links instead, and objects and lights hidden from some kinds of rays."""
    description = linked(material, **more)
    point, spot, sun = (replace(light, light_link="") for light in description.lights)
    description.lights = [
        replace(point, shadow_link="ball", hidden_from=("diffuse",)),
        spot,
        replace(sun, shadow_link="no floor", hidden_from=("glossy",)),
    ]
    lamp = replace(description.materials[2], light_link="", shadow_link="no wall")
    description.materials[2] = with_visibility(lamp, {"glossy": False})
    description.materials[0] = with_visibility(description.materials[0], {"transmission": False, "volume": False})
    description.materials[1] = with_visibility(description.materials[1], {"shadow": False})
    return description


def caught(*, shadows: bool = True, **more: Any) -> SceneDescription:
    """Returns a room with a lamp, a spot and a sun, whose floor and wall catch reflections."""
    lights = [
        Light("spot", gray(20.0), (-2.0, 3.0, 1.0), (0.5, -1.0, 0.0), inner_cone=10.0, outer_cone=40.0),
        Light("directional", gray(2.0), direction=(0.4, -1.0, -0.3), radius=0.05),
    ]
    wall = Material(kind="mirror", base_color=gray(0.8), reflection_catcher=True)
    description = room(_half_clear(), lights=lights, environment=Environment((0.2, 0.3, 0.4)), materials=[wall], **more)
    description.materials[1] = Material(**PBR, roughness=0.3, shadow_catcher=shadows, reflection_catcher=True)
    description.meshes[1] = square((0, 2, -3), (6, 0, 0), (0, 2, 0), 3)
    return description


def casting(description: SceneDescription) -> SceneDescription:
    """Returns the scene with a glass ball, a mirror and a closed mesh of glass, and small lamps: a ball, a spot and a sun."""
    first = len(description.materials)
    glow = Material(base_color=gray(0.0), emission=gray(300.0))
    description.materials += [Material(**GLASS), Material(kind="mirror", base_color=gray(0.9)), glow]
    description.spheres += [Sphere((0.8, 0.4, 1.5), 0.35, first), Sphere((-0.7, 0.3, 1.6), 0.25, first + 1)]
    description.spheres.append(Sphere((-0.3, 2.8, 1.8), 0.08, first + 2))
    description.meshes.append(_smooth(icosphere(2, first, 0.3)))
    description.instances.append(Instance(len(description.meshes) - 1, _moved(0.0, 0.3, 2.0)))
    description.lights += [
        Light("spot", gray(20.0), (2.0, 3.0, 2.0), (-0.5, -1.0, -0.2), inner_cone=10.0, outer_cone=40.0, radius=0.02),
        Light("directional", gray(1.0), direction=(0.3, -1.0, -0.5), angle=2.0, seen="always"),
    ]
    return description


def _shaped(**keys: int) -> SceneDescription:
    """Returns a scene with lights that have emission maps of all kinds, some of them moving."""
    random = np.random.default_rng(5)
    picture, web = (random.random((6, 9, 3), np.float32) ** 4 * 3 for _ in range(2))
    kinds: tuple[tuple[EmissionKind, np.ndarray, tuple[float, float, float, float]], ...] = (
        ("sphere", web, (0.0, 2 * np.pi, 0.0, 2.5)),
        ("window", picture, (-0.9, 0.9, 0.6, -0.6)),
        ("screen", picture, (-0.8, 0.8, 0.7, -0.7)),
    )
    maps = [EmissionMap(kind, values, edges) for kind, values, edges in kinds]
    lights = [
        Light("point", gray(8.0), (1.0, 2.0, 2.0), (-0.3, -1.0, -0.6), radius=0.1, emission=maps[0]),
        Light("spot", gray(20.0), (-2.0, 3.0, 1.0), (0.5, -1.0, 0.0), inner_cone=10.0, outer_cone=40.0, emission=maps[1]),
        Light("point", gray(6.0), (0.5, 2.5, 3.0), (0.0, -0.6, -1.0), radius=0.2, facing=True, emission=maps[2]),
        Light("point", gray(1.0), (0.0, 2.5, 1.0)),
    ]
    if keys:
        for light in lights[:3]:
            x, y, z = light.direction
            light.keys = tuple(replace(light, direction=(x + 0.2 * k, y, z), up=(0.2 * k, 1.0, 0.0)) for k in range(keys["keys"]))
    return room(Material(**PBR, roughness=0.3), lights=lights, **keys)


def _behind_cards(count: int, **card: Any) -> SceneDescription:
    return room(Material(), cards(count), materials=[Material(**card)])


def _in_one_plane(count: int, **card: Any) -> SceneDescription:
    """Returns a scene with `count` squares of several sizes that coincide with the wall and with a face of the box."""
    walls = [square((0.1 * i, 2, -3), (4 - i, 0, 0), (0, 1.5 - 0.1 * i, 0), 3) for i in range(count)]
    sides = [square((1.5, 0.45, 0.75), (0.4 - 0.1 * i, 0, 0), (0, 0.3, 0), 3) for i in range(count)]
    return room(Material(), (*walls, *sides), materials=[Material(**card)])


def _half_clear(**more: Any) -> Material:
    return Material(opacity=0.6, **BLEND, **more)


def _volumes() -> dict[str, Volume]:
    """Returns the grids `smoke` and `fire`, which fill the room; the second emits."""
    place = np.diag((6.0, 3.0, 5.0, 1.0))
    place[:3, 3] = -3.0, 0.0, -2.0
    random = np.random.default_rng(4)
    density, emission = (random.random((9, 14, 21)).astype(np.float32) ** 3 for _ in range(2))
    return {"smoke": Volume(density, place), "fire": Volume(density, place, np.maximum(emission - 0.3, 0), (3.0, 2.0, 1.0))}


GRAY = Material(base_color=gray(0.6))
TEXTURED = {"base_color_texture": 0, "metallic_roughness_texture": 1}
COATED = {"clearcoat": 0.8, "clearcoat_roughness": 0.1, "sheen_color": gray(0.4), "sheen_roughness": 0.5}

SMOKE = {"sigma_a": (0.5, 1.0, 2.0), "sigma_s": (2.0, 4.0, 6.0), "g": 0.4, "volume": "smoke"}

FEATURES: dict[str, Feature] = {
    # Features of the plain variant
    "diffuse": _of(GRAY),
    "mirror": _of(Material(kind="mirror", base_color=gray(0.9))),
    "glass": _of(Material(**GLASS)),
    "metal and plastic": _of(Material(**PBR, metallic=0.5, roughness=0.3)),
    "a rough metal": _of(Material(**GOLD, roughness=0.3)),
    "an even metal": _of(Material(**GOLD, roughness=0.0)),
    "no triangles": _feature(balls, environment=(0.2, 0.2, 0.2)),
    "nothing but a sky": _of(GRAY, view=View((0.0, 5.0, 5.0), (0.0, 9.0, 9.0))),
    "no light": _feature(dark),
    "a sky's picture": _feature(lambda: room(GRAY, environment=Environment(image=3))),
    "what is seen alone": _of(GRAY, max_depth=1, view=replace(VIEW, target=(0.0, 2.5, 0.0))),
    "direct light": _of(GRAY, integrator="direct"),
    "long paths": _of(Material(kind="mirror", base_color=gray(1.0)), max_depth=100),
    "a fixed roulette": _of(GRAY, roulette=0.7),
    "a roulette that spares": _of(GRAY, roulette_floor=0.5, max_depth=20),
    "few diffuse bounces": _of(Material(**PBR, metallic=0.5, roughness=0.3), diffuse_depth=1),
    "few glossy bounces": _of(Material(**PBR, metallic=0.5, roughness=0.3), glossy_depth=1),
    "few transmissions": _of(Material(**GLASS), transmission_depth=3),
    "a clamp": _of(Material(**GLASS), clamp_indirect=0.5),
    "independent numbers": _of(GRAY, sampler="independent", seed=7),
    "a box filter": _of(GRAY, filter="box"),
    "a panorama": _of(GRAY, view=View((0.0, 1.6, 3.0), (0.0, 0.7, 0.0), projection="panorama")),
    "an orthographic view": _of(GRAY, view=View((0.0, 1.6, 5.0), (0.0, 0.7, 0.0), projection="orthographic", height=4.0)),
    "a lens": _of(GRAY, view=replace(VIEW, aperture=0.2, focus=4.0)),
    "a shifted lens": _of(GRAY, view=replace(VIEW, shift_x=0.4, shift_y=-0.2)),
    "a near plane": _of(GRAY, view=replace(VIEW, near=4.8)),
    # Features of the full variant only
    "textures": _of(Material(**PBR, **TEXTURED, metallic=1.0)),
    "a textured mirror": _of(Material(kind="mirror", base_color_texture=0)),
    "a bumpy floor": _of(Material(**PBR, normal_texture=2, roughness=0.5)),
    "colours at vertices": _feature(lambda: colored(room(GRAY))),
    "light through textures": _of(Material(base_color=gray(0.3), emission=gray(2.0), emission_texture=0)),
    "half clear": _of(_half_clear()),
    "half clear glass": _of(_half_clear(**GLASS)),
    "half clear lights": _of(_half_clear(emission=gray(3.0), double_sided=True)),
    "a mask": _of(Material(base_color_texture=0, alpha_mode="mask", alpha_cutoff=0.6)),
    "alpha at vertices": _feature(lambda: colored(room(Material(**BLEND)))),
    "cards": _feature(lambda: _behind_cards(6, opacity=0.3, **BLEND)),
    "fewer cards than there are": _feature(lambda: _behind_cards(6, opacity=0.3, **BLEND), transparency_depth=4),
    "so many cards that nothing is left": _feature(lambda: _behind_cards(300, opacity=0.0, **BLEND)),
    "cards in one plane": _feature(lambda: _in_one_plane(3, opacity=0.4, double_sided=True, **BLEND)),
    "coloured glass": _of(Material(**GLASS, attenuation_color=(0.5, 0.9, 0.7), attenuation_distance=0.5)),
    "a prism": _of(Material(**GLASS, dispersion=10.0)),
    "rough glass": _of(Material(kind="glass", roughness=0.3)),
    "a coat and cloth": _of(Material(**PBR, **COATED, roughness=0.5)),
    "a coat on bumps": _of(Material(**PBR, **TEXTURED, **COATED, normal_texture=2, clearcoat_normal_texture=2)),
    "what transmits": _of(Material(**PBR, transmission=0.7, roughness=0.2)),
    "a pane": _of(Material(**PBR, transmission=0.9, thin=True, roughness=0.1)),
    "leaves": _of(Material(**PBR, diffuse_transmission=0.6, thin=True)),
    "a soap film": _of(Material(**PBR, iridescence=1.0, roughness=0.2)),
    "brushed": _of(Material(**PBR, metallic=1.0, roughness=0.4, anisotropy=0.7)),
    "a brushed metal": _of(Material(**GOLD, roughness=0.4, anisotropy=0.7, anisotropy_texture=1)),
    "a brushed metal that is even": _of(Material(**GOLD, roughness=0.0, anisotropy=0.7)),
    "a highlight of Blinn's": _of(Material(kind="blinn_phong", specular_color=gray(0.3), shininess=20.0)),
    "Beckmann metal": _of(Material(**GOLD, roughness=0.4, distribution="beckmann")),
    "Beckmann glass": _of(Material(kind="glass", roughness=0.4, distribution="beckmann")),
    "rough plastic": _of(Material(kind="plastic", roughness=0.4, nonlinear=True, distribution="beckmann")),
    "unlit": _of(Material(kind="unlit", base_color_texture=0)),
    "copies": _feature(lambda: copies(Material(**PBR, roughness=0.4))),
    "many lights": _feature(lambda: lamps(100)),
    "lights without a body": _feature(_punctual),
    "lights with pictures": _feature(_shaped),
    "what the camera does not see": _feature(lambda: hidden(Material(kind="mirror", base_color=gray(0.9)))),
    "half clear lamps": _feature(lambda: hidden(_half_clear())),
    # Motion while the shutter is open
    "what moves": _feature(lambda: moving(Material(**PBR, metallic=0.5, roughness=0.3))),
    "a rolling shutter": _feature(
        lambda: moving(Material(base_color=gray(0.7))), shutter=0.5, rolling_shutter=0.7, rolling_shutter_from="left"
    ),
    "textures that slide": _feature(
        lambda: sliding(Material(**PBR, **TEXTURED, **COATED, normal_texture=2, clearcoat_texture=1, **BLEND))
    ),
    "lights that turn with their pictures": _feature(lambda: _shaped(keys=3)),
    "a camera that moves": _of(GRAY, views=tuple(replace(VIEW, eye=(x, 1.6, 5.0)) for x in (-0.3, 0.0, 0.4))),
    "a lens that distorts": _of(GRAY, view=replace(VIEW, distortion=LensDistortion("brown", (-0.2, 0.05, 0.002, 0.001)))),
    "a fisheye": _of(GRAY, view=replace(VIEW, distortion=LensDistortion("fisheye", (0.02, -0.01)), near=0.5)),
    # Participating media
    "fog": _of(Material(kind="interface", sigma_a=(0.1, 0.2, 0.3), sigma_s=(1.0, 2.0, 3.0), g=0.4), max_depth=12),
    "smoke around the camera": _of(
        Material(kind="interface", sigma_a=gray(0.4), sigma_s=gray(1.0)), view=replace(VIEW, eye=(0.1, 0.8, 0.5))
    ),
    "cards in fog": _feature(
        lambda: room(Material(), cards(4), materials=[_half_clear()], medium=Medium(sigma_s=(0.05, 0.06, 0.08), g=0.3))
    ),
    "few of anything in smoke": _of(
        Material(kind="interface", sigma_a=gray(0.4), sigma_s=gray(1.0)), diffuse_depth=2, transparency_depth=1
    ),
    "milk in glass": _of(Material(**GLASS, sigma_s=(2.0, 3.0, 4.0), g=0.5), max_depth=12),
    "rough glass in haze": _feature(
        lambda: room(
            Material(kind="glass", roughness=0.3, sigma_s=gray(1.0)),
            medium=Medium(sigma_s=(0.05, 0.06, 0.08), g=0.3),
            lights=[Light("spot", gray(90.0), (-2.0, 3.0, 1.0), (0.5, -1.0, 0.0), inner_cone=10.0, outer_cone=40.0)],
        )
    ),
    "wax": _of(
        Material(base_color=(0.8, 0.6, 0.4), subsurface=1.0, subsurface_radius=(0.2, 0.1, 0.05), subsurface_anisotropy=0.5)
    ),
    "skin": _of(Material(**PBR, **TEXTURED, **COATED, subsurface=0.7, subsurface_radius=(0.2, 0.1, 0.05), normal_texture=2)),
    "fog that moves": _feature(lambda: moving(Material(kind="interface", sigma_s=gray(2.0)))),
    "fog in a room that the camera moves in": _of(
        Material(kind="interface", sigma_s=gray(2.0)),
        views=tuple(replace(VIEW, eye=(x, 1.6, 5.0)) for x in (-0.3, 0.0, 0.4)),
    ),
    # Distances in media sampled towards small lamps
    "lamps in thick fog": _feature(
        lambda: room(
            GRAY,
            materials=[Material(base_color=gray(0.0), emission=gray(90.0))],
            spheres=[Sphere((0.9, 1.5, 0.9), 0.05, 3)],
            lights=[Light("point", gray(4.0), (-1.0, 2.0, 1.0))],
            medium=Medium(sigma_s=(0.2, 0.3, 0.5), sigma_a=gray(0.05), g=0.3),
        ),
        max_depth=12,
    ),
    # Heterogeneous media
    "smoke in a grid": _feature(lambda: room(Material(kind="interface", **SMOKE), volumes=_volumes()), max_depth=12),
    "fire in a grid behind cards": _feature(
        lambda: room(
            Material(kind="glass", roughness=0.0, sigma_a=(0.5, 1.0, 2.0), volume="fire"),
            cards(4),
            materials=[_half_clear()],
            volumes=_volumes(),
            lights=[Light("point", gray(4.0), (-1.0, 2.0, 1.0))],
            medium=Medium(sigma_s=(0.3, 0.4, 0.5), g=0.3, volume="smoke"),
        ),
    ),
    # Directions aimed at targets
    "lamps in glass": _feature(lambda: bulb(GRAY)),
    "lamps in glass by metal and plastic": _feature(lambda: bulb(Material(**PBR, metallic=0.5, roughness=0.3))),
    "lamps in glass by a coat on bumps": _feature(
        lambda: bulb(Material(**PBR, **TEXTURED, **COATED, normal_texture=2, clearcoat_normal_texture=2))
    ),
    "lamps in glass by rough glass": _feature(lambda: bulb(Material(kind="glass", roughness=0.3), guide=True)),
    "lamps in glass by a pane": _feature(lambda: bulb(Material(**PBR, transmission=0.9, thin=True, roughness=0.0))),
    "lamps in glass by a brushed metal": _feature(lambda: bulb(Material(**GOLD, roughness=0.4, anisotropy=0.7))),
    "lamps in glass, with few bounces": _feature(
        lambda: bulb(Material(**PBR, metallic=0.5, roughness=0.3)), diffuse_depth=1, glossy_depth=2
    ),
    "lamps in glass, without splitting": _feature(lambda: bulb(GRAY, guide=True), splitting=1),
    "lamps in glass in fog": _feature(lambda: bulb(GRAY, medium=Medium(sigma_s=(0.05, 0.06, 0.08), g=0.3)), max_depth=12),
    "lamps in glass by wax": _feature(
        lambda: bulb(Material(base_color=(0.8, 0.6, 0.4), subsurface=1.0, subsurface_radius=(0.2, 0.1, 0.05)))
    ),
    # Hair
    "hair": _feature(lambda: room(Material(kind="hair", base_color=(0.6, 0.4, 0.2)), (strands(), flat_strands()))),
    "hair in fog": _feature(
        lambda: room(
            Material(kind="hair", pheomelanin=0.5, beta_m=0.2, base_color_texture=0),
            (strands(),),
            medium=Medium(sigma_s=gray(0.1)),
        ),
        views=tuple(replace(VIEW, eye=(x, 1.6, 5.0)) for x in (-0.3, 0.0, 0.4)),
        max_depth=12,
    ),
    "hair of facets": _feature(
        lambda: room(
            Material(kind="hair", model="huang", base_color=(0.6, 0.4, 0.2), aspect_ratio=0.6, ior=1.55), (strands(0.6),)
        )
    ),
    "hair of facets in fog": _feature(
        lambda: room(
            Material(kind="hair", model="huang", eumelanin=0.5, roughness=0.4, distribution="beckmann", ior=1.55, r=0.5),
            (strands(),),
            medium=Medium(sigma_s=gray(0.1)),
        ),
        max_depth=12,
    ),
    # Light links
    "linked lights": _feature(lambda: linked(Material(**PBR, metallic=0.5, roughness=0.3))),
    "linked lights through cards": _feature(lambda: linked(_half_clear(normal_texture=2))),
    "linked lights in fog": _feature(lambda: linked(Material(**GLASS), medium=Medium(sigma_s=gray(0.1))), max_depth=12),
    "seen by some rays": _feature(lambda: seen_by_kind(Material(**PBR, metallic=0.3, roughness=0.3))),
    "seen by some rays, through cards": _feature(lambda: seen_by_kind(_half_clear(normal_texture=2))),
    "seen by some rays, in fog": _feature(
        lambda: seen_by_kind(Material(**GLASS), medium=Medium(sigma_s=gray(0.1))), max_depth=12
    ),
    "linked lights on wax": _feature(
        lambda: linked(Material(base_color=(0.8, 0.6, 0.4), subsurface=1.0, subsurface_radius=(0.2, 0.1, 0.05)))
    ),
    "reflections on a floor": _feature(caught, background="transparent"),
    "reflections without shadows": _feature(lambda: caught(shadows=False), background="transparent"),
    "reflections in fog": _feature(lambda: caught(medium=Medium(sigma_s=gray(0.1))), background="transparent"),
}


# The features that are rendered by wavelength, too.
SPECTRAL = (
    *("metal and plastic", "a rough metal", "an even metal", "textures", "coloured glass", "a prism", "a coat and cloth"),
    *("leaves", "half clear lights", "unlit", "rough plastic", "a sky's picture", "a highlight of Blinn's", "a soap film"),
    *("fog", "wax", "milk in glass", "smoke in a grid", "fire in a grid behind cards", "reflections on a floor"),
)


def _caustics(describe: Callable[[], SceneDescription], **more: Any) -> Feature:
    return _feature(lambda: casting(describe()), **{"max_depth": 8, "caustics": "on", **more})


# Light through casters. The last four ask for the kernels of subsurface scattering, targets, reflections and a moving camera.
CAUSTICS: dict[str, Feature] = {
    "casters": _caustics(lambda: room(GRAY)),
    "casters of glass": _caustics(lambda: room(Material(**GLASS)), splitting=1),
    "casters by metal and plastic": _caustics(lambda: room(Material(**PBR, metallic=0.5, roughness=0.5))),
    "casters by a coat on bumps": _caustics(
        lambda: room(Material(**PBR, **TEXTURED, **COATED, normal_texture=2, clearcoat_normal_texture=2))
    ),
    "casters by a brushed metal": _caustics(lambda: room(Material(**GOLD, roughness=0.4, anisotropy=0.7))),
    "casters by a brushed metal that is even": _caustics(lambda: room(Material(**GOLD, roughness=0.0, anisotropy=0.7))),
    "casters by rough glass": _caustics(lambda: room(Material(kind="glass", roughness=0.4))),
    "casters by half clear cards": _caustics(
        lambda: room(_half_clear(normal_texture=2), cards(2), materials=[Material(**BLEND)])
    ),
    "casters by copies": _caustics(lambda: copies(Material(**PBR, roughness=0.4))),
    "casters by coloured glass": _caustics(
        lambda: room(Material(**GLASS, attenuation_color=(0.5, 0.9, 0.7), attenuation_distance=0.5))
    ),
    "casters, with few bounces": _caustics(lambda: room(GRAY), max_depth=5, diffuse_depth=2, transmission_depth=5),
    "casters, with a clamp": _caustics(lambda: room(GRAY), clamp_indirect=0.5),
    "casters, with a fixed roulette": _caustics(lambda: room(GRAY), roulette=0.7, sampler="independent", seed=7),
    "casters, on nothing": _caustics(lambda: room(GRAY), background="transparent"),
    "casters by wax": _caustics(
        lambda: room(Material(base_color=(0.8, 0.6, 0.4), subsurface=1.0, subsurface_radius=(0.2, 0.1, 0.05)))
    ),
    "casters by lamps in glass": _caustics(lambda: bulb(GRAY)),
    "casters on a floor that reflects": _caustics(caught, background="transparent"),
    "casters for a camera that moves": _caustics(
        lambda: room(GRAY), views=tuple(replace(VIEW, eye=(x, 1.6, 5.0)) for x in (-0.3, 0.0, 0.4))
    ),
}


def made(name: str) -> tuple[CompiledScene, RenderSettings]:
    """Returns the scene of that name and its settings."""
    compiled, settings = FEATURES[name] if name in FEATURES else CAUSTICS[name]
    return compiled(), settings


@cache
def grouped(name: str) -> CompiledScene:
    """Returns the scene of that name, with its lights and materials in random ones of GROUPS, other than the environment's."""
    scene = made(name)[0]
    random = np.random.default_rng(len(name))
    arrays = {
        "light_group": random.choice([0, 1, 3], len(scene.light_primitive)).astype(np.int32),
        "material_group": random.integers(0, 4, len(scene.material_kind)).astype(np.int32),
        "environment_group": np.array([2], np.int32),
        "group_name": np.frombuffer("\0".join(GROUPS).encode(), np.uint8).copy(),
    }
    for array in arrays.values():
        array.flags.writeable = False
    return scene._replace(**arrays)
