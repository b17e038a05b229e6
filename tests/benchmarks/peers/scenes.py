"""Scenes that Rayfarm and Mitsuba render for the comparison, with the changes that Mitsuba's version needs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from renderer.scene.description import Environment, Image, Instance, Material, Mesh, SceneDescription, Sphere, Texture
from renderer.scene.load import read
from renderer.settings import RenderSettings, View
from tests.benchmarks.peers.meshes import checks, displaced_sphere, torus
from tests.benchmarks.peers.sizes import Sizes
from tests.renderer.builders import gray, square

ROOT = Path(__file__).resolve().parents[3]  # not of tests.helpers, whose packages a bare machine with a card lacks

__all__ = ["CASES", "DEPTH", "Case", "displaced", "many_lights"]

DEPTH = 8
ROUGHNESS = 0.4
_GOLD = {"eta": (0.143, 0.375, 1.442), "k": (3.983, 2.386, 1.603)}


@dataclass
class Case:
    """A scene and its view, for both renderers.

    twin: description converted for Mitsuba in place of ours, where Mitsuba has no equal material. theirs: function that changes
    Mitsuba's scene dictionary where its parameters differ.
    """

    name: str
    description: SceneDescription
    view: View
    theirs: Callable[[Any, dict[str, Any]], None] | None = None
    twin: SceneDescription | None = None

    def settings(self, pixels: int, **more: Any) -> RenderSettings:
        """Returns the render settings of a square picture. pixels: its width and height. more: further settings."""
        return RenderSettings(pixels, pixels, self.view, max_depth=DEPTH, filter="box", **more)


def cornell_box(sizes: Sizes) -> Case:
    """Returns the Cornell box. Mitsuba renders its own Cornell box, which is part of the package."""

    def shipped(mi: Any, made: dict[str, Any]) -> None:
        scene = mi.cornell_box()
        for key in [key for key in made if key not in ("type", "integrator", "sensor")]:
            del made[key]
        made.update({key: value for key, value in scene.items() if key not in ("type", "integrator", "sensor")})

    view = View((0, 0, 3.9), (0, 0, 0), (0, 1, 0), 39.3077)
    return Case("Cornell box", read(ROOT / "scenes", "cornell-box.yaml"), view, shipped)


def displaced(triangles: int, material: Material | None = None) -> Case:
    """Returns a bumpy sphere under a sky."""
    material = material or Material(base_color=(0.7, 0.6, 0.5))
    description = _with_sky([material], [displaced_sphere(triangles)])
    return Case("large mesh, diffuse", description, View((0.0, 0.8, 3.2), (0.0, 0.0, 0.0), fov=42))


def large_mesh_diffuse(sizes: Sizes) -> Case:
    return displaced(sizes.large_mesh)


def large_mesh_plastic(sizes: Sizes) -> Case:
    """Returns a large mesh of plastic.

    The renderers' plastic models differ, so the picture of each is compared with the renderer's own converged picture.
    """
    color = (0.7, 0.3, 0.2)
    case = displaced(sizes.large_mesh, Material(kind="metallic_roughness", base_color=color, roughness=ROUGHNESS))

    def plastic(mi: Any, made: dict[str, Any]) -> None:
        made["bsdf0"] = {
            "type": "roughplastic",
            "distribution": "ggx",
            "alpha": ROUGHNESS**2,
            "diffuse_reflectance": {"type": "rgb", "value": list(color)},
        }

    twin = replace(case.description, materials=[Material(base_color=color)])
    return Case("large mesh, rough plastic", case.description, case.view, plastic, twin)


def glass_and_metal(sizes: Sizes) -> Case:
    materials = [
        Material(base_color=gray(0.6)),
        Material(kind="glass", base_color=gray(1.0), ior=1.5, roughness=0.0),
        Material(kind="conductor", roughness=0.35, **_GOLD),  # type: ignore[arg-type]
    ]
    places = [(-2.1, 1), (0.0, 2), (2.1, 1), (-1.05, 2), (1.05, 1)]
    spheres = [Sphere((x, 0.9, 0.0 if i < 3 else 1.9), 0.9, material) for i, (x, material) in enumerate(places)]
    floor = square((0, -0.02, 0), (12, 0, 0), (0, 0, -12), 0)
    description = _with_sky(materials, [floor], spheres=spheres)
    return Case("glass and rough metal", description, View((0.0, 3.2, 8.5), (0.0, 0.8, 0.4), fov=36))


def textured_mesh(sizes: Sizes) -> Case:
    """Returns a mesh of six thousand triangles with one texture."""
    description = _with_sky([Material(base_color=gray(0.9), base_color_texture=0)], [torus(6_000)])
    description.images.append(checks(sizes.texture))
    description.textures.append(Texture(len(description.images) - 1))
    return Case("textured mesh", description, View((0.6, -1.8, 2.6), (0.0, 0.0, 0.0), fov=45))


def many_lights_case(sizes: Sizes) -> Case:
    return many_lights(sizes.lights)


def many_lights(count: int) -> Case:
    """Returns a room of 40 x 10 x 40 with 60 balls and `count` small emissive balls of different power."""
    rng = np.random.default_rng(0)
    half = np.array([20.0, 5.0, 20.0])
    materials = [Material(base_color=gray(0.7)), Material(kind="conductor", roughness=0.4, **_GOLD)]  # type: ignore[arg-type]
    walls = []
    for axis in range(3):
        for sign in (-1, 1):  # walls face inwards
            u, v = np.eye(3)[(axis + 1) % 3] * half, -sign * np.eye(3)[(axis + 2) % 3] * half
            walls.append(square(tuple(sign * np.eye(3)[axis] * half), tuple(u), tuple(v), 0))
    spheres = [Sphere(tuple(rng.uniform(-0.9, 0.9, 3) * half), rng.uniform(0.3, 1.0), i % 2) for i in range(60)]
    radius = 0.08
    strengths = 10 ** np.linspace(-1.5, 1.5, 8)
    for power in strengths * 400 / count:
        materials.append(Material(base_color=gray(0.0), emission=gray(float(power / (4 * math.pi**2 * radius**2)))))
    for i in range(count):
        spheres.append(Sphere(tuple(rng.uniform(-0.95, 0.95, 3) * half), radius, 2 + i % len(strengths)))
    description = SceneDescription(
        meshes=walls, instances=[Instance(i) for i in range(len(walls))], spheres=spheres, materials=materials
    )
    return Case("many lights", description, View((-18.0, 3.0, -18.0), (0.0, -1.0, 0.0), fov=70))


CASES: dict[str, Callable[[Sizes], Case]] = {
    "Cornell box": cornell_box,
    "large mesh, diffuse": large_mesh_diffuse,
    "large mesh, rough plastic": large_mesh_plastic,
    "glass and rough metal": glass_and_metal,
    "textured mesh": textured_mesh,
    "many lights": many_lights_case,
}


def _with_sky(materials: list[Material], meshes: list[Mesh], **more: Any) -> SceneDescription:
    return SceneDescription(
        meshes=meshes,
        instances=[Instance(i) for i in range(len(meshes))],
        materials=materials,
        images=[Image("sky", _sky(), srgb=False)],
        environment=Environment(image=0),
        **more,
    )


def _sky(height: int = 256) -> np.ndarray:
    """Returns a sky with clouds and a bright haze around the sun, (height, 2 height, 3).

    A sharp sun would make caustics that do not converge.
    """
    v, u = np.meshgrid((np.arange(height) + 0.5) / height, (np.arange(2 * height) + 0.5) / (2 * height), indexing="ij")
    clouds = 0.15 * np.sin(14 * math.pi * u) * np.sin(9 * math.pi * v) * np.sin(math.pi * v)
    blue = np.stack([0.3 + 0.2 * v, 0.4 + 0.15 * v, 0.7 - 0.1 * v], -1) + clouds[..., None]
    sun = 12 * np.exp(-((u - 0.3) ** 2 + ((v - 0.25) / 2) ** 2) / 0.002)
    return (np.maximum(blue, 0.02) + sun[..., None] * np.array([1.0, 0.9, 0.7])).astype(np.float32)
