"""Tests of suns with visible disks, and of lamps that are disks facing the shaded point, in rendered pictures."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from renderer.film import Sums, mean
from renderer.render import render_frame
from renderer.scene.description import Light, Material, Sphere
from renderer.settings import RenderSettings, View
from tests.grids import grid
from tests.renderer.builders import gray, scene, square
from tests.renderer.judge import assert_mean, mean_and_error

MIRROR = Material(kind="mirror", base_color=gray(1.0))
WHITE = Material(base_color=gray(0.8))
ROUGH = Material(kind="metallic_roughness", base_color=gray(1.0), metallic=1.0, roughness=0.15)
FLOOR = square((0, 0, 0), (20, 0, 0), (0, 0, -20), 0)
DOWN = View((0.0, 2.0, 0.0), (0.0, 0.0, 0.0), up=(0, 0, -1), fov=40.0)
SUN = Light("directional", gray(2.0), direction=(0.0, -1.0, 0.0), angle=20.0, seen="mirrored")
RADIANCE = 2.0 / (math.pi * math.sin(math.radians(10)) ** 2)
PATH = {"light_samples": 2}  # an option for which the kernel traces one path at a time


def picture(material: Material, *lights: Light, spp: int = 16, view: View = DOWN, **more: object) -> Sums:
    asked: dict[str, object] = {"max_depth": 3, "filter": "box", **more}
    return render_frame(scene([material], (FLOOR,), lights=lights), RenderSettings(48, 48, view, **asked), spp)


@pytest.mark.parametrize("kernel", [{}, PATH, pytest.param({"integrator": "whitted"}, marks=pytest.mark.long)])
def test_mirror_shows_the_sun_disk(kernel: dict[str, object]) -> None:
    """A mirror below a camera that looks straight down shows the sun's disk at its angle to the axis."""
    found = mean(picture(MIRROR, SUN, **kernel), 24)[..., 0]
    slope = math.tan(math.radians(20))
    x, y = np.meshgrid(*[(2 * (np.arange(48) + 0.5) / 48 - 1) * slope] * 2)
    angle = np.degrees(np.arctan(np.hypot(x, y)))
    np.testing.assert_allclose(found[angle < 9], RADIANCE, rtol=1e-4)
    assert not found[angle > 11].any()
    assert not mean(picture(MIRROR, replace(SUN, seen="never"), **kernel), 24).any()


@pytest.mark.parametrize("kernel", [{}, PATH, pytest.param({"integrator": "whitted"}, marks=pytest.mark.long)])
def test_sun_visibility_to_the_camera(kernel: dict[str, object]) -> None:
    up = View((0.0, 2.0, 0.0), (0.0, 3.0, 0.0), up=(0, 0, -1), fov=10.0)
    np.testing.assert_allclose(
        mean(picture(WHITE, replace(SUN, seen="always"), view=up, spp=4, **kernel), 24), RADIANCE, rtol=1e-4
    )
    assert not mean(picture(WHITE, SUN, view=up, spp=4, **kernel), 24).any()


@grid("kernel", [{}, PATH, {"sampling": "bsdf"}, {"sampling": "light"}], ordinary=({},))
@grid("others", [0, 4], ordinary=(4,))
def test_visible_sun_is_counted_once(kernel: dict[str, object], others: int) -> None:
    """Rough metal under a sun is equally bright for each way of light sampling, with a light tree or without."""
    lights = [Light("point", gray(0.5), (k - 1.5, 3.0, 1.0)) for k in range(others)]
    alone, _ = mean_and_error(picture(ROUGH, replace(SUN, seen="never"), *lights, spp=256))
    assert_mean(picture(ROUGH, SUN, *lights, spp=256, **kernel), alone, slack=4e-3)


def test_visible_sun_keeps_diffuse_irradiance() -> None:
    assert_mean(picture(WHITE, SUN, spp=256), 0.8 / math.pi * 2.0, slack=2e-3)


def lit(
    lamp: Material | None, *lights: Light, height: float = 1.0, spp: int = 256, below: Material = WHITE, **more: object
) -> Sums:
    """Returns the film sums of a floor under a ball lamp of radius 0.8 at `height`, and under further lights.

    lamp: the material of the ball; None for no ball. below: the material of the floor.
    """
    spheres = [Sphere((0.0, height, 0.0), 0.8, 1)] if lamp is not None else []
    materials = [below, *([lamp] if lamp is not None else [])]
    made = scene(materials, (FLOOR,), tuple(spheres), lights=lights)
    view = View((0.0, 0.02, 0.0), (0.0, 0.0, 0.0), up=(0, 0, -1), fov=2.0)
    return render_frame(made, RenderSettings(8, 8, view, **{"max_depth": 2, "filter": "box", **more}), spp)


GLOW = Material(base_color=gray(0.0), emission=gray(3.0), lamp=True, unseen=True, facing=True)


@pytest.mark.parametrize("height", [2.0, 1.0, 0.4])
@grid("kernel", [{}, PATH, {"sampling": "bsdf"}, {"sampling": "light"}], ordinary=({},))
def test_facing_disk_irradiance(height: float, kernel: dict[str, object]) -> None:
    """Below the centre of a facing disk, irradiance is pi L sin^2(half angle), also near the floor."""
    irradiance = 3.0 * math.pi * 0.8**2 / (0.8**2 + height**2)
    assert_mean(lit(GLOW, height=height, spp=1024, **kernel), 0.8 / math.pi * irradiance, slack=4e-3)


@pytest.mark.parametrize("kind", ["point", "spot"])
def test_facing_punctual_light_irradiance(kind: str) -> None:
    light = Light(kind, gray(3.0 * math.pi * 0.8**2), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), radius=0.8, facing=True)
    light.inner_cone = light.outer_cone = 89.0
    irradiance = 3.0 * math.pi * 0.8**2 / (0.8**2 + 1)
    assert_mean(lit(None, light), 0.8 / math.pi * irradiance, slack=4e-3)


@pytest.mark.parametrize("kernel", [{}, PATH, pytest.param({"integrator": "whitted"}, marks=pytest.mark.long)])
def test_mirror_shows_the_facing_disk(kernel: dict[str, object]) -> None:
    """A mirror shows a facing disk of radius 0.8 at a distance of 3.0, not a ball: the tangent of its half angle is 0.8 / 3.0."""
    made = scene([MIRROR, GLOW], (FLOOR,), (Sphere((0.0, 1.0, 0.0), 0.8, 1),))
    view = View((0.0, 2.0, 0.0), (0.0, 0.0, 0.0), up=(0, 0, -1), fov=80.0)
    sums = render_frame(made, RenderSettings(64, 64, view, **{"max_depth": 3, "filter": "box", **kernel}), 16)
    found = mean(sums, 24)[..., 0]
    x, y = np.meshgrid(*[(2 * (np.arange(64) + 0.5) / 64 - 1) * math.tan(math.radians(40))] * 2)
    slope = np.hypot(x, y)
    # A ray hits the floor at 2 tan a, the vertex that the lamp faces.
    start, rise = 2 * slope, slope
    d = np.stack([-start, np.ones_like(start)])  # from the vertex to the disk's middle, outwards and up
    along = (d[0] * rise + d[1]) / np.hypot(rise, 1)
    off2 = (d**2).sum(axis=0) - along**2
    meets = (along > 0) & (np.sqrt(off2) * np.sqrt((d**2).sum(axis=0)) < 0.8 * along)
    around = [np.roll(meets, step, axis) for step in (-1, 1) for axis in (0, 1)]
    inner, edge = np.all([meets, *around], axis=0), np.any([meets, *around], axis=0)
    np.testing.assert_allclose(found[inner], 3.0, rtol=1e-4)
    assert not found[~edge].any()
    assert 0 < inner.sum() < (~edge).sum()


def test_shadeless_object_is_lit_and_visible() -> None:
    """A square above the floor that casts no shadow lets the light pass, and is itself lit."""
    card = square((0, 1.0, 0), (8, 0, 0), (0, 0, -8), 1)
    lamp = Light("point", gray(5.0), (0.0, 3.0, 0.0))
    below, above = (
        View((0.0, 0.5, 0.0), (0.0, 0.0, 0.0), up=(0, 0, -1), fov=10.0),
        View((0, 2, 0), (0, 0, 0), up=(0, 0, -1), fov=10.0),
    )

    def seen(view: View, material: Material) -> float:
        made = scene([WHITE, material], (FLOOR, card), lights=(lamp,))
        return mean_and_error(render_frame(made, RenderSettings(8, 8, view, max_depth=2, filter="box"), 64))[0]

    plain = Material(base_color=gray(0.5))
    assert seen(below, plain) == 0
    assert seen(below, replace(plain, shadeless=True)) == pytest.approx(0.8 / math.pi * 5.0 / 9, rel=0.01)
    assert seen(above, replace(plain, shadeless=True)) == pytest.approx(0.5 / math.pi * 5.0 / 4, rel=0.01)
