"""Small scenes with participating media, rendered by both Rayfarm and Mitsuba."""

from __future__ import annotations

from collections.abc import Callable

from renderer.scene.description import Environment, Instance, Light, Material, Medium, Mesh, SceneDescription, Sphere
from renderer.settings import RenderSettings, View
from tests.renderer.builders import box, emitter, gray, square

__all__ = ["MEDIA"]

Case = tuple[SceneDescription, RenderSettings]
FLOOR = square((0, 0, 0), (4, 0, 0), (0, 0, -4), 0)
WALL, RED = Material(base_color=(0.8, 0.75, 0.7)), Material(base_color=(0.8, 0.2, 0.1))
VIEW = View((0.0, 2.2, 5.5), (0.0, 0.8, 0.0), (0.0, 1.0, 0.0), 36.0)
SKY = Environment(color=(0.2, 0.25, 0.3))


def _case(materials: list[Material], meshes: list[Mesh], **more: object) -> Case:
    instances = [Instance(i) for i in range(len(meshes))]
    described = SceneDescription(meshes=meshes, instances=instances, materials=materials, **more)
    # Mitsuba counts smooth transmission as depth.
    settings = RenderSettings(48, 48, VIEW, max_depth=24, transmission_depth=0, sampler="independent", filter="box")
    return described, settings


def fog_in_a_box() -> Case:
    """Returns a box of fog with a ball inside, below a lamp."""
    fog = Material(kind="interface", sigma_a=(0.05, 0.1, 0.1), sigma_s=(0.5, 0.7, 1.2), g=0.3)
    lamp = square((0, 3.5, 0.5), (0.8, 0, 0), (0, 0, 0.8), 1)
    meshes = [FLOOR, lamp, box(2, 1.0, (0.0, 1.01, 0.0))]
    return _case([WALL, emitter(8.0), fog, RED], meshes, spheres=[Sphere((0.2, 0.8, 0.2), 0.5, 3)], environment=SKY)


def milk_in_glass() -> Case:
    """Returns a glass ball filled with milk, under a bright sky.

    There is no lamp, since paths from inside the glass would hit it only by chance.
    """
    milk = Material(kind="glass", base_color=gray(1.0), ior=1.33, sigma_s=(2.0, 2.5, 3.5), sigma_a=(0.01, 0.05, 0.2), g=0.5)
    return _case(
        [WALL, milk], [FLOOR], spheres=[Sphere((0.0, 0.9, 0.0), 0.85, 1)], environment=Environment(color=(1.0, 0.9, 0.8))
    )


def smoke_that_scatters_onwards() -> Case:
    smoke = Material(kind="interface", sigma_a=(0.4, 0.2, 0.1), sigma_s=(1.0, 2.0, 4.0), g=0.8)
    lamp = square((0, 3.5, 0.5), (0.8, 0, 0), (0, 0, 0.8), 1)
    return _case([WALL, emitter(8.0), smoke], [FLOOR, lamp], spheres=[Sphere((0.0, 1.0, 0.0), 0.9, 2)], environment=SKY)


def haze_with_a_spot() -> Case:
    """Returns a scene in haze with a spot light; the camera is inside the haze."""
    spot = Light("spot", gray(40.0), (-1.5, 3.0, 1.0), (0.5, -1.0, -0.3), inner_cone=25.0, outer_cone=25.0)
    world = Medium(sigma_a=gray(0.01), sigma_s=(0.08, 0.1, 0.14), g=0.4)
    return _case([WALL, RED], [FLOOR], spheres=[Sphere((0.3, 0.6, 0.0), 0.6, 1)], lights=[spot], medium=world)


MEDIA: dict[str, Callable[[], Case]] = {
    case.__name__: case for case in (fog_in_a_box, milk_in_glass, smoke_that_scatters_onwards, haze_with_a_spot)
}
