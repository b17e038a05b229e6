"""The built-in scenes of the self-test of graphics cards: small rooms that together use every stage of the kernels.

Each scene needs certain parts of a kernel (renderer/arrays/scene_features.py) and is rendered with every kernel that has them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from renderer.arrays.scene import CompiledScene
from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.scene.compile import compile_scene
from renderer.scene.description import (
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
from renderer.scene.readers import shapes
from renderer.scene.readers.strands import Strand, strands_mesh
from renderer.settings import RenderSettings, Vec3, View
from renderer.variant_names import base_variant, example_of, has_caustics

__all__ = ["SCENES", "SPP", "SelfTestScene", "scenes_for", "settings_for"]

SIZE, SPP = 64, 4  # width and height in pixels; samples of each pixel
_VIEW = View((0.0, 1.6, 5.0), (0.0, 0.9, 0.0), fov=45.0)
_GREY = Material(base_color=(0.6, 0.6, 0.6))
_PBR = Material(kind="metallic_roughness", base_color=(0.8, 0.5, 0.3))
_GLASS = Material(kind="glass", base_color=(1.0, 1.0, 1.0), roughness=0.0)
_GOLD = Material(kind="conductor", eta=(0.2, 0.4, 1.4), k=(4.0, 2.4, 1.6))
_HALF_CLEAR = Material(base_color=(0.5, 0.6, 0.7), opacity=0.6, alpha_mode="blend")
_COLORS, _PARTS, _BUMPS, _SKY = range(4)  # images
_FLOOR, _LAMP = 0, 1  # materials; those of the balls follow


class SelfTestScene(NamedTuple):
    """A scene of the self-test.

    needs: fields of SceneFeatures that its kernel must have. has_caustics: False for what CausticTables do not support. views: of
    a camera that moves.
    """

    name: str
    needs: tuple[str, ...]
    describe: Callable[[], SceneDescription]
    background: str = "visible"
    has_caustics: bool = True
    views: tuple[View, ...] = ()

    def compiled(self, kernel: str) -> CompiledScene:
        """Returns the compiled scene; with casters, if the kernel of that name has CausticTables."""
        made = self.describe()
        return compile_scene(_with_casters(made) if has_caustics(kernel) else made)


def scenes_for(kernel: str) -> list[SelfTestScene]:
    """Returns the scenes that a kernel can render. kernel: named as in renderer/variant_names.py."""
    has = KERNEL_VARIANTS[base_variant(kernel)]
    found = [scene for scene in SCENES if scene.has_caustics or not has_caustics(kernel)]
    return [scene for scene in found if all(getattr(has, part) for part in scene.needs)]


def settings_for(kernel: str, scene: SelfTestScene) -> RenderSettings:
    """Returns the settings of a scene's picture that use what the kernel's name adds to its variant."""
    _, wanted = example_of(kernel)
    return replace(
        wanted,
        width=SIZE,
        height=SIZE,
        view=_VIEW,
        max_depth=8,
        light_groups="lamp" if wanted.light_groups else "",
        background=scene.background,
        views=scene.views,
    )


def _images() -> list[Image]:
    """Returns colours with alpha, roughness and metallic, bumps, and a sky."""
    random = np.random.default_rng(0)
    bumps = np.full((8, 8, 4), 255, np.uint8)
    bumps[..., :2] = random.integers(90, 166, (8, 8, 2))
    return [
        Image("colors", random.integers(60, 256, (8, 8, 4), np.uint8)),
        Image("parts", random.integers(40, 256, (8, 8, 4), np.uint8), srgb=False),
        Image("bumps", bumps, srgb=False),
        Image("sky", (random.random((8, 16, 3)) ** 4 * 3).astype(np.float32), srgb=False),
    ]


def _placed(x: float, y: float, z: float, width: float, height: float, depth: float) -> np.ndarray:
    """Returns the matrix that scales by the last three numbers and then moves by the first three."""
    matrix = np.diag([width, height, depth, 1.0])
    matrix[:3, 3] = x, y, z
    return matrix


def _down(x: float, y: float, z: float, size: float) -> np.ndarray:
    """Returns the matrix of a quad that faces down."""
    matrix = _placed(x, y, z, size, size, 1.0)
    matrix[:3, :3] = np.array([[size, 0, 0], [0, 0, -1], [0, size, 0]], np.float64)
    return matrix


def _places(count: int) -> list[Vec3]:
    """Returns the centres of `count` balls, in rows of five."""
    return [(-1.5 + 0.75 * (k % 5), 0.35 + 0.75 * (k // 5), 0.1 * (k % 3)) for k in range(count)]


def _room(*materials: Material, vase: int = 0) -> SceneDescription:
    """Returns a floor and a wall, a lamp, a sky, a ball of each material, and a vase and a box of material `vase` of them."""
    turned = shapes.lathe("vase", [(0.05, 0.0), (0.3, 0.1), (0.15, 0.5), (0.25, 0.8)], segments=24)
    first = _LAMP + 1
    return SceneDescription(
        meshes=[
            replace(shapes.cube("floor"), material=_FLOOR),
            replace(shapes.cube("wall"), material=_FLOOR),
            replace(shapes.quad("lamp"), material=_LAMP),
            replace(shapes.cube("box"), material=first + vase),
            replace(turned, material=first + vase),
        ],
        instances=[
            Instance(0, _placed(0, -0.1, 0, 4, 0.1, 4)),
            Instance(1, _placed(0, 2, -2, 4, 2.1, 0.1)),
            Instance(2, _down(0.3, 3.4, 0.8, 0.8)),
            Instance(3, _placed(1.6, 0.25, 1.4, 0.2, 0.25, 0.2)),
            Instance(4, _placed(-1.6, 0.0, 1.4, 1, 1, 1)),
        ],
        spheres=[Sphere(place, 0.32, first + k) for k, place in enumerate(_places(len(materials)))],
        materials=[
            Material(base_color=(0.7, 0.6, 0.5)),
            Material(base_color=(0.0, 0.0, 0.0), emission=(9.0, 8.0, 7.0), light_group="lamp"),
            *materials,
        ],
        environment=Environment(image=_SKY),
        images=_images(),
        textures=[Texture(_COLORS), Texture(_PARTS), Texture(_BUMPS)],
    )


def _surfaces() -> SceneDescription:
    return _room(
        _GREY,
        Material(kind="mirror", base_color=(0.9, 0.9, 0.9)),
        _GLASS,
        replace(_PBR, metallic=0.5, roughness=0.3),
        replace(_PBR, roughness=0.1),
        replace(_GOLD, roughness=0.3),
        replace(_GOLD, roughness=0.0),
    )


def _with_casters(made: SceneDescription) -> SceneDescription:
    """Returns the scene with a ball and a box of glass, a mirror ball and a small lamp in front."""
    glass, mirror = len(made.materials), len(made.materials) + 1
    made.materials += [_GLASS, Material(kind="mirror", base_color=(0.9, 0.9, 0.9))]
    made.spheres += [Sphere((1.0, 0.35, 1.9), 0.3, glass), Sphere((-0.9, 0.3, 2.0), 0.25, mirror)]
    made.meshes.append(replace(shapes.cube("glass box"), material=glass))
    made.instances.append(Instance(len(made.meshes) - 1, _placed(0.1, 0.3, 2.2, 0.2, 0.2, 0.2)))
    made.lights.append(Light("point", (4.0, 4.0, 4.0), (0.8, 3.0, 1.5)))
    return made


def _layers() -> SceneDescription:
    textured = replace(_PBR, base_color_texture=_COLORS, metallic_roughness_texture=_PARTS)
    made = _room(
        replace(textured, normal_texture=_BUMPS),
        replace(textured, clearcoat=0.8, clearcoat_roughness=0.1, sheen_color=(0.4, 0.4, 0.4), sheen_roughness=0.5),
        replace(_GLASS, dispersion=10.0, attenuation_color=(0.5, 0.9, 0.7), attenuation_distance=0.5),
        Material(kind="glass", roughness=0.3),
        replace(_PBR, transmission=0.7, roughness=0.2),
        replace(_PBR, diffuse_transmission=0.6, thin=True),
        replace(_PBR, iridescence=1.0, roughness=0.2),
        replace(_PBR, metallic=1.0, roughness=0.4, anisotropy=0.7),
        Material(kind="blinn_phong", specular_color=(0.3, 0.3, 0.3), shininess=20.0),
        replace(_GOLD, roughness=0.4, distribution="beckmann"),
        Material(kind="plastic", roughness=0.4, nonlinear=True),
        Material(base_color_texture=_COLORS, alpha_mode="mask", alpha_cutoff=0.6),
        Material(base_color=(0.3, 0.3, 0.3), emission=(2.0, 2.0, 2.0), emission_texture=_COLORS),
        Material(kind="unlit", base_color_texture=_COLORS),
        _HALF_CLEAR,
    )
    made.lights += [
        Light("point", (4.0, 4.0, 4.0), (1.0, 2.0, 2.0), radius=0.1),
        Light("spot", (9.0, 9.0, 9.0), (-2.0, 3.0, 1.0), (0.5, -1.0, 0.0), inner_cone=10.0, outer_cone=40.0),
        Light("directional", (1.0, 1.0, 1.0), direction=(0.3, -1.0, -0.5), angle=2.0),
    ]
    return made


def _many() -> SceneDescription:
    """Returns a scene with instances of a mesh, and with enough lamps for a light tree."""
    made = _room(replace(_PBR, roughness=0.4))
    made.meshes.append(replace(shapes.globe("pebble"), material=_LAMP + 1))
    made.instances += [
        Instance(len(made.meshes) - 1, _placed(-2 + 0.2 * k, 0.2, 1.2, 0.2, 0.2 + 0.01 * k, 0.15), _FLOOR if k % 3 else None)
        for k in range(20)
    ]
    place = np.random.default_rng(2).uniform((-3, 0.2, -1.5), (3, 3, 2), (40, 3))
    made.spheres += [Sphere((float(x), float(y), float(z)), 0.03, _LAMP) for x, y, z in place]
    return made


def _motion() -> SceneDescription:
    made = _room(replace(_PBR, metallic=0.5, roughness=0.3), _GREY)
    made.keys = 3
    for number in (2, 3):
        still = made.instances[number]
        keys = tuple(_placed(0.1 * k, 0.05 * k, 0.0, 1, 1, 1) @ still.transform for k in range(3))
        made.instances[number] = replace(still, keys=keys, moves=True)
    x, y, z = made.spheres[0].center
    made.spheres[0] = replace(made.spheres[0], keys=tuple(((x, y + 0.1 * k, z), 0.32) for k in range(3)), moves=True)
    lights = [Light("point", (4.0, 4.0, 4.0), (1.0 + 0.2 * k, 2.0, 2.0), radius=0.1) for k in range(3)]
    made.lights.append(replace(lights[1], keys=tuple(lights)))
    return made


def _media() -> SceneDescription:
    skin = replace(_PBR, base_color_texture=_COLORS, normal_texture=_BUMPS)
    return _room(
        Material(kind="interface", sigma_a=(0.1, 0.2, 0.3), sigma_s=(1.0, 2.0, 3.0), g=0.4),
        replace(_GLASS, sigma_s=(2.0, 3.0, 4.0), g=0.5),
        Material(base_color=(0.8, 0.6, 0.4), subsurface=1.0, subsurface_radius=(0.2, 0.1, 0.05)),
        replace(skin, subsurface=0.7, subsurface_radius=(0.2, 0.1, 0.05)),
        _HALF_CLEAR,
        vase=2,
    )


def _skin() -> SceneDescription:
    return _room(Material(base_color=(0.8, 0.6, 0.4), subsurface=1.0, subsurface_radius=(0.2, 0.1, 0.05)))


def _grids() -> SceneDescription:
    random = np.random.default_rng(4)
    density, emission = (random.random((9, 14, 21)).astype(np.float32) ** 3 for _ in range(2))
    place = _placed(-3, 0, -2, 6, 3, 5)
    smoke = Material(kind="interface", sigma_a=(0.5, 1.0, 2.0), sigma_s=(2.0, 4.0, 6.0), g=0.4, volume="smoke")
    made = _room(smoke, replace(_GLASS, sigma_a=(0.5, 1.0, 2.0), volume="fire"), vase=1)
    made.volumes = {
        "smoke": Volume(density, place),
        "fire": Volume(density, place, np.maximum(emission - 0.3, 0), (3.0, 2.0, 1.0)),
    }
    return made


def _pivots() -> SceneDescription:
    made = _room(_GREY)
    made.spheres.append(Sphere((0.9, 1.5, 0.9), 0.05, _LAMP))
    made.lights.append(Light("point", (4.0, 4.0, 4.0), (-1.0, 2.0, 1.0)))
    made.medium = Medium(sigma_s=(0.2, 0.3, 0.5), sigma_a=(0.05, 0.05, 0.05), g=0.3)
    return made


def _targets() -> SceneDescription:
    made = _room(replace(_PBR, metallic=0.5, roughness=0.3), _GLASS)
    made.spheres += [Sphere((0.9, 1.8, 0.9), 0.3, _LAMP + 2), Sphere((0.9, 1.8, 0.9), 0.06, _LAMP)]
    made.spheres[0] = replace(made.spheres[0], guide=True)
    return made


def _links() -> SceneDescription:
    made = _room(replace(_PBR, metallic=0.5, roughness=0.3), _HALF_CLEAR)
    made.spheres[0] = replace(made.spheres[0], name="ball")
    made.instances[0] = replace(made.instances[0], name="floor")
    made.lights += [
        Light("point", (4.0, 4.0, 4.0), (1.0, 2.0, 2.0), radius=0.1, light_link="ball"),
        Light("directional", (1.0, 1.0, 1.0), direction=(0.0, -0.3, 1.0), angle=20.0, light_link="no floor"),
    ]
    made.light_links = {"ball": LightLink(("ball",), ()), "no floor": LightLink(None, ("floor",))}
    return made


def _visibility() -> SceneDescription:
    made = _links()
    point, sun = (replace(light, light_link="") for light in made.lights)
    made.lights = [
        replace(point, shadow_link="ball", hidden_from=("diffuse",)),
        replace(sun, shadow_link="no floor", hidden_from=("glossy",)),
    ]
    made.materials[_FLOOR] = with_visibility(made.materials[_FLOOR], {"shadow": False})
    made.materials[_LAMP] = with_visibility(made.materials[_LAMP], {"glossy": False})
    made.materials[_LAMP + 1] = with_visibility(made.materials[_LAMP + 1], {"transmission": False, "volume": False})
    return made


def _catchers() -> SceneDescription:
    made = _room(_HALF_CLEAR, _GREY)
    made.lights.append(Light("directional", (2.0, 2.0, 2.0), direction=(0.4, -1.0, -0.3), radius=0.05))
    made.materials[_FLOOR] = replace(_PBR, roughness=0.3, shadow_catcher=True, reflection_catcher=True)
    return made


def _strands(aspect: float) -> Mesh:
    """Returns bent fibres that stand on the floor. aspect: of their cross-sections."""
    random = np.random.default_rng(2)
    along = np.linspace(0, 1, 6)[:, None]
    fibres = []
    for x, z, lean_x, lean_z in random.uniform(-1, 1, (60, 4)):
        points = np.column_stack([1.2 * x + 0.4 * lean_x * along**2, 1.5 * along, 0.5 + 0.5 * z + 0.4 * lean_z * along**2])
        fibres.append(Strand(points, np.linspace(0.05, 0.02, len(points))))
    return replace(strands_mesh(fibres, fibres=True, aspect=aspect), material=_LAMP + 1)


def _hair(material: Material, aspect: float = 1.0) -> SceneDescription:
    made = _room(material)
    made.spheres.clear()
    made.instances = made.instances[:3]
    made.meshes.append(_strands(aspect))
    made.instances.append(Instance(len(made.meshes) - 1))
    return made


_FULL = "textures", "lights", "layers"
SCENES = (
    SelfTestScene("surfaces", (), _surfaces),
    SelfTestScene("textures and layers", _FULL, _layers),
    SelfTestScene("instances and many lamps", (*_FULL, "instances"), _many),
    SelfTestScene("motion", (*_FULL, "instances", "motion"), _motion, has_caustics=False),
    SelfTestScene(
        "a moving camera", (*_FULL, "instances", "motion"), _surfaces, views=(_VIEW, replace(_VIEW, eye=(0.4, 1.6, 5.0)))
    ),
    SelfTestScene("media", (*_FULL, "media"), _media, has_caustics=False),
    SelfTestScene("skin", (*_FULL, "media"), _skin),
    SelfTestScene("media in grids", (*_FULL, "media", "grids"), _grids, has_caustics=False),
    SelfTestScene("small lamps in a medium", (*_FULL, "media", "pivots"), _pivots, has_caustics=False),
    SelfTestScene("lamps behind glass", (*_FULL, "targets"), _targets),
    SelfTestScene("light links", (*_FULL, "links"), _links, has_caustics=False),
    SelfTestScene("visibility by kind of ray", (*_FULL, "visibility"), _visibility, has_caustics=False),
    SelfTestScene("catchers", (*_FULL, "reflections"), _catchers, background="transparent"),
    SelfTestScene("hair", (*_FULL, "hair"), lambda: _hair(Material(kind="hair", base_color=(0.6, 0.4, 0.2)))),
    SelfTestScene(
        "hair of facets",
        (*_FULL, "huang"),
        lambda: _hair(Material(kind="hair", model="huang", base_color=(0.6, 0.4, 0.2), aspect_ratio=0.6, ior=1.55), aspect=0.6),
    ),
)
