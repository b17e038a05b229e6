"""Tests that clear surfaces transmit all light, however many there are: panes of clear glass, and layers of alpha 0."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from renderer.film import COLOR
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Instance, Light, Material, Mesh, SceneDescription, Sphere
from renderer.settings import RenderSettings, View
from tests.grids import grid
from tests.renderer.builders import gray, square

VIEW = View((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), fov=20.0)
GLASS = Material(kind="glass", base_color=gray(1.0), roughness=0.0)
LAYERED = Material(base_color=gray(1.0), metallic=0.0, roughness=0.0, transmission=1.0)
LIT = 0.5  # reflectance of a wall, and its radiance under an irradiance of pi


def mean(description: SceneDescription, spp: int, **settings: object) -> float:
    """Returns the mean of a rendered picture of 16 x 16 pixels with `spp` samples each."""
    asked = RenderSettings(16, 16, VIEW, **settings)
    sums = render_frame(compile_scene(description), asked, spp)
    return float(sums[COLOR].mean()) * 2.0**-asked.film_exponent / spp


def panes(count: int, material: Material) -> SceneDescription:
    """Returns nested closed panes in constant white light."""
    x, y, z = (np.array([0, 0, 0, 0, 1, 1, 1, 1]), np.array([0, 0, 1, 1] * 2), np.array([0, 1] * 4))
    corners = np.stack([4.0 * x - 2, 4.0 * y - 2, 0.04 * z], 1)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))], np.int32)
    meshes = [Mesh("pane", (corners - (0, 0, 0.3 * k)).astype(np.float32), triangles) for k in range(count)]
    return SceneDescription(
        meshes=meshes,
        instances=[Instance(k) for k in range(count)],
        materials=[material],
        environment=Environment(color=gray(1.0)),
    )


def layers(count: int, **material: object) -> SceneDescription:
    """Returns layers of alpha 0 in front of a light and a wall, which would hide both if they were opaque."""
    cards = [square((0, 0, -3.0 * k / count), (3, 0, 0), (0, 3, 0), 0) for k in range(count)]
    return SceneDescription(
        meshes=[*cards, square((0, 0, -5), (9, 0, 0), (0, 9, 0), 1)],
        instances=[Instance(k) for k in range(count + 1)],
        materials=[Material(opacity=0.0, **material), Material(base_color=gray(LIT))],
        lights=[Light("directional", gray(math.pi), direction=(0.0, 0.0, -1.0))],
    )


@pytest.mark.parametrize("material", [GLASS, LAYERED], ids=["glass", "layered"])
@grid("count", [3, 4, 6], ordinary=(6,))
def test_clear_panes_in_a_white_furnace(count: int, material: Material) -> None:
    assert mean(panes(count, material), 64) == pytest.approx(1.0, abs=1e-3)


def test_counted_transmissions_use_up_the_depth() -> None:
    """If every transmission counts as a bounce for max_depth, nested glass is dark: only reflections remain.

    With a max_depth of 64 it is as bright as its surroundings.
    """
    assert mean(panes(4, GLASS), 64, transmission_depth=0) < 0.2
    assert mean(panes(4, GLASS), 64, transmission_depth=0, max_depth=64) == pytest.approx(1.0, abs=5e-3)


def test_transmission_limit_is_exact() -> None:
    """The limit of transmissions is exact: four clear panes with an index of 1 need a limit of eight, two for each pane.

    Transmissions through clear panes do not count in max_depth; those through rough panes do.
    """
    clear = panes(4, replace(GLASS, ior=1.0))
    assert mean(clear, 4, transmission_depth=8) == pytest.approx(1.0, abs=1e-3)
    assert mean(clear, 4, transmission_depth=7) == 0.0
    assert mean(clear, 4, transmission_depth=8, max_depth=2) == pytest.approx(1.0, abs=1e-3)
    rough = panes(4, replace(GLASS, ior=1.0, roughness=0.5))
    assert mean(rough, 16, transmission_depth=7, glossy_depth=1, max_depth=64) < 0.2
    assert mean(rough, 16, transmission_depth=8, glossy_depth=1, max_depth=64) > 0.9


@pytest.mark.parametrize(
    "integrator", ["path", "direct", *(pytest.param(name, marks=pytest.mark.long) for name in ("whitted", "ao"))]
)
def test_alpha_layer_limit_is_shared_with_shadow_rays(integrator: str) -> None:
    """The limit of transparent layers is shared by a path and its shadow rays.

    A path that passes 5 layers on its way to the wall leaves its shadow rays 5 of 10 on their way to the light.
    """
    five = layers(5, alpha_mode="blend")
    asked = {"integrator": integrator, **({"ao_distance": 9.0} if integrator == "ao" else {})}
    lit = 1.0 if integrator == "ao" else LIT
    assert mean(five, 16, transparency_depth=10, **asked) == pytest.approx(lit, rel=1e-3)
    if integrator != "ao":  # ambient occlusion rays leave sideways, and only some pass all layers
        assert mean(five, 16, transparency_depth=9, **asked) == 0.0
    assert mean(five, 16, transparency_depth=4, **asked) == 0.0


def test_surface_behind_the_limit_of_layers_is_visible() -> None:
    sky = replace(layers(5, alpha_mode="blend"), lights=[], environment=Environment(color=gray(1.0)))
    sky.instances.pop()  # removes the wall
    assert mean(sky, 4, transparency_depth=5) == pytest.approx(1.0, abs=1e-3)
    assert mean(sky, 4, transparency_depth=4) == 0.0


def test_layer_limit_is_equal_for_both_strategies() -> None:
    """With half-transparent layers before a white wall in white light, shadow rays and scattered rays have equal limits."""
    room = layers(3, alpha_mode="mask")
    room.materials[0] = replace(room.materials[0], opacity=0.5, alpha_mode="blend")
    room = replace(room, lights=[], environment=Environment(color=gray(1.0)))
    for depth in (3, 4, 5):
        found = [mean(room, 256, transparency_depth=depth, sampling=how, max_depth=3) for how in ("mis", "light", "bsdf")]
        assert found == pytest.approx([found[0]] * 3, rel=0.01)


@pytest.mark.parametrize("medium", [{}, pytest.param({"sigma_a": gray(1e-6)}, marks=pytest.mark.long)], ids=["empty", "medium"])
def test_medium_boundaries_do_not_count_as_layers(medium: dict[str, object]) -> None:
    boxes = panes(4, Material(kind="interface", **medium))
    assert mean(boxes, 4, transparency_depth=1) == pytest.approx(1.0, abs=1e-3)


def test_bounce_limits_by_kind() -> None:
    """In a closed white sphere of radiance 1 each diffuse bounce adds a reflectance of 0.5, up to the limit of its kind."""
    light = Material(base_color=gray(0.5), emission=gray(1.0), double_sided=True)
    room = SceneDescription(spheres=[Sphere((0.0, 0.0, 0.0), 9.0, 0)], materials=[light])
    for bounces, expected in ((1, 1.5), (2, 1.75), (3, 1.875)):
        assert mean(room, 64, diffuse_depth=bounces, max_depth=64) == pytest.approx(expected, rel=0.01)
        assert mean(room, 64, glossy_depth=bounces, max_depth=3) == pytest.approx(1.75, rel=0.01)
    mirrored = replace(light, kind="mirror")
    room = replace(room, materials=[mirrored])
    for bounces, expected in ((1, 1.5), (2, 1.75)):
        assert mean(room, 4, glossy_depth=bounces, max_depth=64) == pytest.approx(expected, rel=0.01)
        assert mean(room, 4, diffuse_depth=bounces, max_depth=4) == pytest.approx(1.875, rel=0.01)


def test_max_depth_1_shows_emission_but_not_through_glass() -> None:
    assert mean(panes(1, GLASS), 4, max_depth=1) == 0.0


@pytest.mark.parametrize(
    "material", [{"alpha_mode": "blend"}, {"alpha_mode": "mask", "alpha_cutoff": 0.5}], ids=["blend", "mask"]
)
@grid("count", [100, 300, 1000], ordinary=(300,))
def test_clear_layers_transmit_camera_and_shadow_rays(count: int, material: dict[str, object]) -> None:
    assert mean(layers(count, **material), 4) == pytest.approx(LIT, rel=1e-3)


def test_more_layers_than_random_numbers() -> None:
    """A path that passes more than 65,536 surfaces reuses its random numbers and still transmits all light."""
    count = 70_000
    corners = np.array([(-3, -3), (3, -3), (3, 3), (-3, 3)])
    positions = np.column_stack([np.tile(corners, (count, 1)), np.repeat(-3.0 * np.arange(count) / count, 4)]).astype(np.float32)
    triangles = (np.array([(0, 1, 2), (0, 2, 3)]) + 4 * np.arange(count)[:, None, None]).reshape(-1, 3).astype(np.int32)
    description = layers(0, alpha_mode="blend")
    description.meshes.append(Mesh("layers", positions, triangles))
    description.instances.append(Instance(1))
    settings = RenderSettings(2, 2, VIEW)
    sums = render_frame(compile_scene(description), settings, 1)
    assert float(sums[COLOR].mean()) * 2.0**-settings.film_exponent == pytest.approx(LIT, rel=1e-3)
