"""Motion blur by what is known of it: closed forms, and pictures of a moment averaged over the time that the shutter is open."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from renderer.arrays.scene import CompiledScene
from renderer.film import digest, mean
from renderer.render import render_batch, render_frame, replay
from renderer.scene.animation import Moment, Shutter
from renderer.scene.compile import compile_scene
from renderer.scene.description import Camera, Environment, Instance, Light, Material, Mesh, SceneDescription, Sphere
from renderer.scene.moving import while_open
from renderer.settings import RenderSettings, Tile, View
from tests.renderer.builders import gray, icosphere, square

FLAT = View((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), projection="orthographic", height=4.0)
OPEN = Shutter(1.0)
UNLIT, GRAY, LAMP = 0, 1, 2
MATERIALS = [
    Material(kind="unlit", base_color=gray(1.0)),
    Material(base_color=gray(0.7)),
    Material(base_color=gray(0.0), emission=gray(6.0), double_sided=True),
]

At = Callable[[float], SceneDescription]  # the scene at a share -0.5 ... 0.5 of the time that the shutter is open


def described(**things) -> SceneDescription:
    things.setdefault("environment", Environment(gray(0.0)))
    return SceneDescription(materials=list(MATERIALS), moves=True, **things)


def over(at: At, shutter: Shutter = OPEN) -> SceneDescription:
    return while_open(lambda moment: at(moment.offset), Moment(), shutter)


def turned(angle: float, place: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """About the z axis, then moved."""
    matrix = np.eye(4)
    matrix[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    matrix[:3, 3] = place
    return matrix


def settings_of(view: View = FLAT, size: int = 64, **more) -> RenderSettings:
    return RenderSettings(size, size, view, filter="box", shutter=1.0, **more)


def picture(scene: CompiledScene, settings: RenderSettings, spp: int) -> np.ndarray:
    return mean(render_frame(scene, settings, spp), settings.film_exponent)[..., 1]


def from_the_middle(size: int, height: float) -> tuple[np.ndarray, np.ndarray]:
    """(x, y) of the pixels' middles in the plane that FLAT looks at."""
    y, x = np.mgrid[0:size, 0:size] + 0.5
    return (x / size - 0.5) * height, (0.5 - y / size) * height


def test_a_bar_that_turns_once_is_a_disc_of_the_known_brightness() -> None:
    """At a distance r from its axis a bar of half width w covers 4 asin(w / r) of the circle."""
    bar = square((0, 0, 0), (1.8, 0, 0), (0, 0.15, 0), UNLIT)
    turning = over(lambda t: described(meshes=[bar], instances=[Instance(0, turned(2 * math.pi * t), moves=True)]))
    assert turning.keys == 9, "five keys would take a quarter of a turn for a step"
    found = picture(compile_scene(turning), settings_of(), 256)
    x, y = from_the_middle(64, 4.0)
    r = np.hypot(x, y)
    known = 2 / math.pi * np.arcsin(np.minimum(0.15 / r, 1.0))
    inside = (r > 0.3) & (r < 1.7)
    assert abs(found - known)[inside].max() < 0.03
    assert abs((found - known)[inside].mean()) < 0.001
    assert found[r > 1.9].max() == 0.0
    # The same all around: nothing is brighter at the keys.
    sector = (np.floor((np.arctan2(y, x) / math.pi + 1) * 16) % 32).astype(int)
    around = [found[inside & (sector == k)].mean() / known[inside & (sector == k)].mean() for k in range(32)]
    np.testing.assert_allclose(around, 1.0, atol=0.02)


def test_what_flies_leaves_a_streak_of_the_known_profile() -> None:
    """A square of half width w that flies from -d to d is over a point for min(w, ...) / d of the time: a trapezoid."""
    w, d = 0.25, 1.0
    dot = square((0, 0, 0), (w, 0, 0), (0, w, 0), UNLIT)
    flying = over(
        lambda t: described(meshes=[dot], instances=[Instance(0, turned(0.3, (2 * d * t, 0, 0)) @ turned(-0.3), moves=True)])
    )
    found = picture(compile_scene(flying), settings_of(), 256)
    x, y = from_the_middle(64, 4.0)
    known = np.clip(np.minimum(x + w, d) - np.maximum(x - w, -d), 0, None) / (2 * d)
    along = abs(y) < w - 0.07
    assert abs(found - known)[along].max() < 0.03
    assert abs((found - known)[along].mean()) < 0.001
    assert found[abs(y) > w + 0.07].max() == 0.0


def spinning_child(t: float) -> SceneDescription:
    """A bar that turns about its own middle, which a parent swings around: half a turn and a whole one."""
    parent = turned(math.pi * t) @ turned(0, (1.2, 0, 0))
    return described(
        meshes=[square((0, 0, 0), (0.5, 0, 0), (0, 0.1, 0), UNLIT)],
        instances=[Instance(0, parent @ turned(2 * math.pi * t), moves=True)],
    )


def growing(t: float) -> SceneDescription:
    """A mirrored and skewed body that grows, turns and flies; round and lit, with its shadow on a wall that stands still."""
    skew = np.eye(4)
    skew[0, 0], skew[0, 1], skew[1, 1] = -0.8, 0.3, 0.7 + 0.4 * t
    ball = icosphere(3, 0, 0.7)
    unit = (ball.positions / np.linalg.norm(ball.positions, axis=1, keepdims=True)).astype(np.float32)
    return described(
        meshes=[square((0, 0, -1), (3, 0, 0), (0, 3, 0), GRAY), replace(ball, normals=unit, material=GRAY)],
        instances=[Instance(0), Instance(1, turned(1.5 * t, (1.2 * t, 0.4, 0)) @ skew, moves=True)],
        lights=[Light("point", gray(8.0), (1.0, 2.0, 3.0))],
    )


def bending(t: float) -> SceneDescription:
    """A flat mesh and a smooth one whose vertices move by themselves, lit from one side."""
    ball = icosphere(2, 0, 0.8)
    unit = ball.positions / np.linalg.norm(ball.positions, axis=1, keepdims=True)
    bent = (ball.positions * (1 + 0.8 * t * unit[:, :1]) + (-0.9, 0.5 * t, 0)).astype(np.float32)
    sheet = square((0.9, 0, 0), (0.6, 0, 0), (0, 0.8, 0), GRAY)
    lift = np.array([(0, 0, 2 * t), (0, 0, 0), (0, 0, 2 * t), (0.4 * t, 0, 0)])
    sheet.positions = (sheet.positions + lift).astype(np.float32)
    sheet.deforms = True
    return described(
        meshes=[replace(ball, positions=bent, normals=unit.astype(np.float32), material=GRAY, deforms=True), sheet],
        instances=[Instance(0), Instance(1)],
        lights=[Light("directional", gray(2.0), direction=(0.5, -0.6, -1.0))],
    )


def rolling(t: float) -> SceneDescription:
    """Spheres that fly and swell, beside one that stands still."""
    return described(
        spheres=[
            Sphere((1.2 * t, -0.6, 0.0), 0.5 + 0.3 * t, GRAY, "a", moves=True),
            Sphere((-1.2 * t, 0.9, 0.3), 0.3, GRAY, "b", moves=True),
            Sphere((0.0, 0.2, -0.8), 0.4, GRAY, "c"),
        ],
        environment=Environment((1.0, 0.8, 0.6)),
    )


def lamps(t: float) -> SceneDescription:
    """A wall under lamps that move: a quad that flies and turns, a sphere that flies and swells, and one that stands still."""
    return described(
        meshes=[square((0, 0, -1), (3, 0, 0), (0, 3, 0), GRAY), square((0, 0, 0), (0.4, 0, 0), (0, 0.15, 0), LAMP)],
        instances=[
            Instance(0),
            Instance(1, turned(0.4 * t, (1.6 * t, 1.0, 0.2)), moves=True),
            Instance(1, turned(0.0, (-1.0, -1.2, 0.0))),
        ],
        spheres=[Sphere((-1.0, 1.2 * t, 0.2), 0.25 + 0.2 * t, LAMP, moves=True)],
    )


def one_lamp(t: float) -> SceneDescription:
    """Two triangles, between which no tree chooses, whose area changes."""
    scene = lamps(t)
    scene.instances[1].transform = turned(0.4 * t, (1.6 * t, 1.0, 0.2)) @ np.diag([1.0, 1.0 + t, 1.0, 1.0])
    return replace(scene, instances=scene.instances[:2], spheres=[])


def punctual(t: float) -> SceneDescription:
    """A wall under lights without a body that fly, turn and brighten."""
    wall = square((0, 0, -1), (3, 0, 0), (0, 3, 0), GRAY)
    return described(
        meshes=[wall],
        instances=[Instance(0)],
        lights=[
            Light("point", gray(2.0 + 3.0 * t), (2.0 * t, 1.0, 0.5), radius=0.2),
            Light("spot", gray(9.0), (-1.0, -1.0, 1.0), (t, 0.5 * t, -1.0), inner_cone=10.0, outer_cone=25.0),
            Light("directional", (0.3 + 0.2 * t, 0.3, 0.3), direction=(0.4 * t, -0.3, -1.0), angle=1.0),
        ],
    )


def fly_by(t: float) -> SceneDescription:
    """A camera that flies, turns and zooms, past a body that moves the other way."""
    view = View((1.0 * t, 0.3, 5.0), (2.0 * t, 0.0, 0.0), fov=45 + 20 * t)
    scene = growing(t)
    scene.cameras = [Camera("flight", view)]
    return scene


SCENES = [spinning_child, growing, bending, rolling, lamps, one_lamp, punctual, fly_by]


@pytest.mark.parametrize("at", SCENES, ids=lambda at: at.__name__)
def test_a_blurred_picture_is_the_mean_of_its_moments(at: At) -> None:
    moving = over(at)
    views = moving.cameras[0].keys if moving.cameras else ()
    settings = settings_of(moving.cameras[0].view if views else FLAT, 24, views=views, max_depth=3)
    found = picture(compile_scene(moving), settings, 1024)
    moments = 48
    known = np.zeros_like(found)
    for i in range(moments):
        still = at((i + 0.5) / moments - 0.5)
        view = still.cameras[0].view if views else FLAT
        known += picture(compile_scene(still), replace(settings, view=view, views=()), 64) / moments
    assert known.max() > 0.1
    assert found.mean() == pytest.approx(known.mean(), rel=0.01)
    assert abs(found - known).mean() < 0.015 * known.mean() + 0.002
    assert abs(found - known).max() < 0.12 * known.max()
