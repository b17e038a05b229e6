"""Tests of motion blur against closed forms, and against static pictures averaged over the time the shutter is open."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from renderer.arrays.scene import CompiledScene
from renderer.film import COLOR, digest, mean
from renderer.render import render_batch, render_frame, replay
from renderer.scene.animation import Moment, Shutter
from renderer.scene.compile import compile_scene
from renderer.scene.compiled import load, save
from renderer.scene.description import Camera, Environment, Image, Instance, Light, Material, SceneDescription, Sphere, Texture
from renderer.scene.shutter_merge import merge_over_shutter
from renderer.settings import RenderSettings, Tile, View, tiles_of
from tests.grids import grid
from tests.renderer.builders import gray, icosphere, square

FLAT = View((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), projection="orthographic", height=4.0)
OPEN = Shutter(1.0)
UNLIT, GRAY, LAMP = 0, 1, 2
MATERIALS = [
    Material(kind="unlit", base_color=gray(1.0)),
    Material(base_color=gray(0.7)),
    Material(base_color=gray(0.0), emission=gray(6.0), double_sided=True),
]

At = Callable[[float], SceneDescription]  # Maps a share of the open shutter's time, -0.5 ... 0.5, to the scene at that time.


def described(**things) -> SceneDescription:
    things.setdefault("environment", Environment(gray(0.0)))
    return SceneDescription(materials=list(MATERIALS), moves=True, **things)


def merged_over_shutter(at: At, shutter: Shutter = OPEN) -> SceneDescription:
    return merge_over_shutter(lambda moment: at(moment.offset), Moment(), shutter)


def turned(angle: float, place: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Returns a rotation by `angle` about the z axis followed by a translation to `place`."""
    matrix = np.eye(4)
    matrix[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    matrix[:3, 3] = place
    return matrix


def settings_of(view: View = FLAT, size: int = 64, **more) -> RenderSettings:
    return RenderSettings(size, size, view, filter="box", shutter=1.0, **more)


def picture(scene: CompiledScene, settings: RenderSettings, spp: int) -> np.ndarray:
    return mean(render_frame(scene, settings, spp), settings.film_exponent)[..., 1]


def from_the_middle(size: int, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns x and y of the pixel centres in the plane viewed by FLAT."""
    y, x = np.mgrid[0:size, 0:size] + 0.5
    return (x / size - 0.5) * height, (0.5 - y / size) * height


@pytest.mark.long
def test_rotating_bar_blurs_to_a_disc() -> None:
    """A bar of half width w that turns once covers the share 4 asin(w / r) / (2 pi) of the circle of radius r about its axis."""
    bar = square((0, 0, 0), (1.8, 0, 0), (0, 0.15, 0), UNLIT)
    turning = merged_over_shutter(lambda t: described(meshes=[bar], instances=[Instance(0, turned(2 * math.pi * t), moves=True)]))
    assert turning.keys == 9, "five keys would take a quarter of a turn for a step"
    found = picture(compile_scene(turning), settings_of(), 256)
    x, y = from_the_middle(64, 4.0)
    r = np.hypot(x, y)
    known = 2 / math.pi * np.arcsin(np.minimum(0.15 / r, 1.0))
    inside = (r > 0.3) & (r < 1.7)
    assert abs(found - known)[inside].max() < 0.03
    assert abs((found - known)[inside].mean()) < 0.001
    assert found[r > 1.9].max() == 0.0
    # The disc is uniform in angle: it is no brighter at the keys.
    sector = (np.floor((np.arctan2(y, x) / math.pi + 1) * 16) % 32).astype(int)
    around = [found[inside & (sector == k)].mean() / known[inside & (sector == k)].mean() for k in range(32)]
    np.testing.assert_allclose(around, 1.0, atol=0.02)


@pytest.mark.long
def test_moving_square_blurs_to_a_trapezoid() -> None:
    """The streak of a square moving from -d to d is a trapezoid: a point is covered for the square's width, less at both ends."""
    w, d = 0.25, 1.0
    dot = square((0, 0, 0), (w, 0, 0), (0, w, 0), UNLIT)
    flying = merged_over_shutter(
        lambda t: described(meshes=[dot], instances=[Instance(0, turned(0, (2 * d * t, 0, 0)), moves=True)])
    )
    found = picture(compile_scene(flying), settings_of(), 256)
    x, y = from_the_middle(64, 4.0)
    known = np.clip(np.minimum(x + w, d) - np.maximum(x - w, -d), 0, None) / (2 * d)
    along = abs(y) < w - 0.07
    assert abs(found - known)[along].max() < 0.03
    assert abs((found - known)[along].mean()) < 0.001
    assert found[abs(y) > w + 0.07].max() == 0.0


def spinning_child(t: float) -> SceneDescription:
    """Returns a bar that rotates half a turn about its centre, under a parent that rotates a whole turn."""
    parent = turned(math.pi * t) @ turned(0, (1.2, 0, 0))
    return described(
        meshes=[square((0, 0, 0), (0.5, 0, 0), (0, 0.1, 0), UNLIT)],
        instances=[Instance(0, parent @ turned(2 * math.pi * t), moves=True)],
    )


def growing(t: float) -> SceneDescription:
    """Returns a mirrored and skewed body that grows, rotates and moves, lit, with its shadow on a static wall."""
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
    """Returns a flat and a smooth mesh with moving vertices, lit from one side."""
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
    """Returns spheres that move and grow, and a static one."""
    return described(
        spheres=[
            Sphere((1.2 * t, -0.6, 0.0), 0.5 + 0.3 * t, GRAY, "a", moves=True),
            Sphere((-1.2 * t, 0.9, 0.3), 0.3, GRAY, "b", moves=True),
            Sphere((0.0, 0.2, -0.8), 0.4, GRAY, "c"),
        ],
        environment=Environment((1.0, 0.8, 0.6)),
    )


def lamps(t: float) -> SceneDescription:
    """Returns a wall under moving lights: a rotating quad, a growing sphere, and a static light."""
    return described(
        meshes=[square((0, 0, -1), (3, 0, 0), (0, 3, 0), GRAY), square((0, 0, 0), (0.4, 0, 0), (0, 0.15, 0), LAMP)],
        instances=[
            Instance(0),
            Instance(1, turned(0.4 * t, (1.6 * t, 1.0, 0.2)), moves=True),
            Instance(1, turned(0.0, (-1.0, -1.2, 0.0))),
        ],
        spheres=[Sphere((-1.0, 1.2 * t, 0.2), 0.25 + 0.2 * t, LAMP, moves=True)],
    )


def turning_lamps(t: float) -> SceneDescription:
    """Returns one-sided lights that rotate: at mid-shutter none of them faces the wall, or all do."""
    scene = lamps(t)
    scene.materials[LAMP] = replace(scene.materials[LAMP], double_sided=False)
    for number, (angle, x) in enumerate(((3.0 * t, -1.0), (3.0 * t + math.pi, 1.0), (2.0 * t + math.pi, 0.0)), 1):
        tilt = np.eye(4)
        tilt[1:3, 1:3] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
        tilt[0, 3] = x
        scene.instances[number:] = [Instance(1, tilt, moves=True)]
    return replace(scene, spheres=[])


def one_lamp(t: float) -> SceneDescription:
    """Returns a scene with one lamp of two triangles, which moves and grows with the shutter time t; no light tree is built."""
    scene = lamps(t)
    scene.instances[1].transform = turned(0.4 * t, (1.6 * t, 1.0, 0.2)) @ np.diag([1.0, 1.0 + t, 1.0, 1.0])
    return replace(scene, instances=scene.instances[:2], spheres=[])


def punctual(t: float) -> SceneDescription:
    """Returns a wall under punctual lights that move, rotate and brighten."""
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


def striped() -> list[Image]:
    """Returns images of soft stripes with alpha, of bumps, and of soft spots."""
    y, x = (np.mgrid[0:16, 0:16] + 0.5) * (2 * math.pi / 16)
    stripes = np.stack([0.5 + 0.45 * np.sin(x), 0.5 + 0.45 * np.sin(y), 0.6 + 0.3 * np.cos(x + y), 0.5 + 0.5 * np.cos(2 * x)], -1)
    bumps = np.stack([0.5 + 0.3 * np.sin(2 * x), 0.5 + 0.3 * np.cos(y), 0 * x + 0.9, 0 * x + 1], -1)
    spots = np.stack([0.5 + 0.5 * np.sin(x) * np.sin(y)] * 3 + [0 * x + 1], -1)
    bits = [np.round(255 * pixels).astype(np.uint8) for pixels in (stripes, bumps, spots)]
    return [Image("stripes", bits[0]), Image("bumps", bits[1], srgb=False), Image("spots", bits[2])]


def sliding(t: float) -> SceneDescription:
    """Returns surfaces with moving textures: a wall's colours and bumps, a pane's alpha, and a light's spots."""
    c, s = math.cos(0.9 * t), math.sin(0.9 * t)
    textures = [
        Texture(0, transform=(1.0, 0.0, 0.6 * t, 0.0, 1.0, 0.2 * t)),
        Texture(0, transform=(c, s, 0.0, -s, c, 0.3 * t)),
        Texture(1, transform=(2.0 + t, 0.0, 0.0, 0.0, 2.0, 0.0)),
        Texture(2, transform=(1.0, 0.0, 0.8 * t, 0.0, 1.0, 0.0)),
        Texture(1),
    ]
    wall = {"base_color_texture": 0, "normal_texture": 2, "metallic_roughness_texture": 4, "clearcoat_texture": 1}
    materials = [
        Material(kind="metallic_roughness", roughness=1.0, clearcoat=0.5, clearcoat_roughness=0.6, **wall),
        Material(base_color_texture=1, alpha_mode="blend"),
        Material(base_color=gray(0.0), emission=gray(4.0), emission_texture=3, double_sided=True),
    ]
    places = (((0, 0, -1), (3, 0, 0), (0, 3, 0)), ((-1, 0, 0.5), (0.8, 0, 0), (0, 1.2, 0)), ((1.9, 0, 1), (0, 0, 0.6), (0, 1, 0)))
    meshes = [square(*place, UNLIT + len(MATERIALS) + k) for k, place in enumerate(places)]
    for mesh in meshes:
        mesh.uvs = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
    scene = described(meshes=meshes, instances=[Instance(k) for k in range(3)], lights=[Light("point", gray(12.0), (-1.5, 1, 3))])
    return replace(scene, materials=[*MATERIALS, *materials], textures=textures, images=striped())


def everything(t: float) -> SceneDescription:
    """Returns a scene with all kinds of motion."""
    first, second = bending(t), lamps(t)
    shift = len(first.meshes)
    painted = sliding(t)
    placed = [*first.instances, *(replace(i, mesh=i.mesh + shift) for i in second.instances)]
    spheres = [*rolling(t).spheres, *second.spheres]
    lights = [*first.lights, *punctual(t).lights]
    spun = replace(spinning_child(t).instances[0], mesh=shift + len(second.meshes))
    meshes = [*first.meshes, *second.meshes, *spinning_child(t).meshes, *painted.meshes]
    placed += [replace(i, mesh=i.mesh + shift + len(second.meshes) + 1) for i in painted.instances]
    scene = described(meshes=meshes, instances=[*placed, spun], spheres=spheres, lights=lights)
    return replace(scene, materials=painted.materials, textures=painted.textures, images=painted.images)


def fly_by(t: float) -> SceneDescription:
    """Returns a camera that moves, rotates and zooms, past a body that moves in the opposite direction."""
    view = View((1.0 * t, 0.3, 5.0), (2.0 * t, 0.0, 0.0), fov=45 + 20 * t)
    scene = growing(t)
    scene.cameras = [Camera("flight", view)]
    return scene


SCENES = [spinning_child, bending, rolling, lamps, sliding]
OTHERS = [pytest.param(each, marks=pytest.mark.long) for each in (growing, turning_lamps, one_lamp, punctual, fly_by)]


@pytest.mark.long
@grid("at", [*SCENES, *OTHERS], ids=lambda at: at.__name__, ordinary=(spinning_child, bending))
def test_motion_blur_equals_the_mean_of_static_pictures(at: At) -> None:
    moving = merged_over_shutter(at)
    views = moving.cameras[0].keys if moving.cameras else ()
    settings = settings_of(moving.cameras[0].view if views else FLAT, 24, views=views, max_depth=3)
    samples, moments = 2048, 48
    found = picture(compile_scene(moving), settings, samples)
    known, brightest = np.zeros_like(found), 0.0
    for i in range(moments):
        still = at((i + 0.5) / moments - 0.5)
        view = still.cameras[0].view if views else FLAT
        moment = picture(compile_scene(still), replace(settings, view=view, views=()), 64)
        known += moment / moments
        brightest = max(brightest, float(moment.max()))
    assert known.max() > 0.1
    assert found.mean() == pytest.approx(known.mean(), rel=0.01)
    assert abs(found - known).mean() < 0.015 * known.mean() + 0.002
    # A value between 0 and b with mean m has a variance of at most m (b - m). Of 576 pixels hardly one deviates by 4.5 standard
    # deviations. A moving edge may be off by half a time step in either direction.
    error = np.sqrt(known * np.maximum(brightest - known, 0.0) / samples)
    assert (abs(found - known) < 4.5 * error + brightest / moments).all()


def under_a_lamp(t: float) -> SceneDescription:
    """Returns a deforming body next to a wall, under a static light that faces away from the camera."""
    sheet = replace(square((1.4, 0.6 * t, 0.5), (0.4, 0, 0), (0, 0.5, 0), GRAY), deforms=True)
    wall, lamp = square((0, 0, -1), (3, 0, 0), (0, 3, 0), GRAY), square((-0.2, -0.2, -0.5), (0, 1.1, 0), (1.1, 0, 0), LAMP)
    scene = described(meshes=[sheet, wall, lamp], instances=[Instance(i) for i in range(3)])
    scene.materials[LAMP] = replace(scene.materials[LAMP], double_sided=False)
    return scene


@pytest.mark.long
def test_static_lamp_beside_deforming_geometry() -> None:
    settings = settings_of(size=24, max_depth=2)
    found, known = (
        picture(compile_scene(made), settings, 256)[:, :16] for made in (merged_over_shutter(under_a_lamp), under_a_lamp(0.0))
    )
    assert known.mean() > 0.1
    assert found.mean() == pytest.approx(known.mean(), rel=0.01)  # the right part of the picture, where the sheet is


@pytest.mark.long
def test_frame_without_shutter_equals_the_still() -> None:
    still = compile_scene(growing(0.0))
    settings = settings_of(size=32)
    whole = digest(render_frame(still, replace(settings, shutter=0.0), 4))
    assert (
        digest(render_frame(compile_scene(merged_over_shutter(growing, Shutter())), replace(settings, shutter=0.0), 4)) == whole
    )
    standing = merged_over_shutter(lambda _: growing(0.0))
    assert standing.keys == 0
    assert digest(render_frame(compile_scene(standing), settings, 4)) == whole, "what stands still has nothing to blur"
    assert digest(render_frame(compile_scene(merged_over_shutter(growing)), settings, 4)) != whole


@pytest.mark.long
def test_blurred_frame_does_not_depend_on_batches(tmp_path: Path) -> None:
    made = compile_scene(merged_over_shutter(everything))
    save(made, tmp_path / "scene")
    kept = load(tmp_path / "scene")
    settings = settings_of(size=32)
    whole = render_frame(made, settings, 6, threads=1)
    assert digest(render_frame(kept, settings, 6, threads=2)) == digest(whole)
    parts = np.zeros_like(whole)
    for tile in reversed(tiles_of(32, 32, 12)):
        for first, count in ((4, 2), (0, 1), (1, 3)):
            sums = render_batch(kept, settings, tile, first, count).sums
            parts[:, tile.y : tile.y + tile.h, tile.x : tile.x + tile.w] += sums
    assert digest(parts) == digest(whole)


@pytest.mark.long
def test_replay_uses_the_samples_shutter_time() -> None:
    made = compile_scene(merged_over_shutter(growing))
    settings = settings_of(size=32)
    for sample in (0, 5):
        film = render_batch(made, settings, Tile(0, 0, 32, 32), sample, 1).sums
        for x, y in ((10, 10), (16, 16), (20, 18)):
            found = replay(made, settings, x, y, sample)
            assert [int(v * 2**24) for v in found.value] == film[COLOR, y, x].tolist()


@pytest.mark.long
def test_trailing_and_leading_shutters() -> None:
    """A trailing shutter's streak covers the motion before the frame's time, a leading one's the motion after it."""
    bar = square((0, 0, 0), (0.1, 0, 0), (0, 2, 0), UNLIT)
    flight = lambda t: described(meshes=[bar], instances=[Instance(0, turned(0, (t, 0, 0)), moves=True)])  # noqa: E731
    for at, low, high in (("centred", -0.5, 0.5), ("trailing", -1.0, 0.0), ("leading", 0.0, 1.0)):
        found = picture(compile_scene(merged_over_shutter(flight, Shutter(1.0, at))), settings_of(), 64)
        x, _ = from_the_middle(64, 4.0)
        seen = x[found > 0.02]
        assert seen.min() == pytest.approx(low - 0.1, abs=0.07)
        assert seen.max() == pytest.approx(high + 0.1, abs=0.07)


def test_number_of_motion_keys() -> None:
    bar = square((0, 0, 0), (1, 0, 0), (0, 0.1, 0), UNLIT)

    def turning(turns: float) -> At:
        return lambda t: described(meshes=[bar], instances=[Instance(0, turned(2 * math.pi * turns * t), moves=True)])

    assert merged_over_shutter(turning(0.1)).keys == 5
    assert merged_over_shutter(turning(3.3)).keys == 33
    assert merged_over_shutter(turning(3.3), Shutter(1.0, keys=7)).keys == 7


def test_unsupported_motion_is_named() -> None:
    def changing(t: float) -> SceneDescription:
        scene = growing(t)
        scene.materials[GRAY] = replace(scene.materials[GRAY], base_color=gray(0.5 + 0.1 * t))
        scene.environment = Environment(gray(0.1), rotation=10 * t)
        scene.images, scene.textures = striped(), [Texture(0, filter="nearest" if t > 0 else "linear")]
        scene.materials[UNLIT] = replace(scene.materials[UNLIT], base_color_texture=0)
        if t > 0:
            scene.meshes[1] = replace(scene.meshes[1], triangles=scene.meshes[1].triangles[1:])
        return scene

    found = merged_over_shutter(changing)
    left = "materials, the environment, textures other than their placement, the mesh icosphere, whose triangles change"
    assert found.warnings == [f"Shown as in the middle of the shutter, not blurred: {left}."]
    assert len(found.instances[1].keys) == 5, "it still goes where it goes"


@pytest.mark.long
@pytest.mark.parametrize("edge", ["top", "right"])
def test_rows_of_a_rolling_shutter_equal_those_of_frames_at_their_times(edge: str) -> None:
    """With rows exposed for an instant each is that of a still at its time, of things that rotate, and of a camera that moves."""
    size = 32
    wheel = square((0, 0, 0), (1.8, 0, 0), (0, 0.3, 0), UNLIT)

    def at(t: float) -> SceneDescription:
        return described(
            meshes=[wheel],
            instances=[Instance(0, turned(2 * math.pi * t), moves=True)],
            spheres=[Sphere((3 * t, -1.0, 1.0), 0.3, UNLIT, moves=True)],
        )

    def view(share: float) -> View:
        return replace(FLAT, eye=(0.5 - share, 0, 5.0), target=(0.5 - share, 0, 0))

    moving = compile_scene(merged_over_shutter(at))
    views = tuple(view(k / 4) for k in range(5))
    rolled = settings_of(view(0.5), size, rolling_shutter=1.0, rolling_shutter_from=edge, views=views)
    found = picture(moving, rolled, 16)
    worst = []
    for row in range(size):
        share = (row + 0.5) / size if edge == "top" else 1 - (row + 0.5) / size
        still = picture(compile_scene(at(share - 0.5)), settings_of(view(share), size), 16)
        worst.append(abs(found - still)[row] if edge == "top" else abs(found - still)[:, row])
    assert (np.array(worst) > 1e-6).mean() < 0.005, "of pixels, at edges: a moving body is rounded otherwise"
    assert np.max(worst) < 0.07
    plain = picture(moving, replace(rolled, rolling_shutter=0.0), 16)
    assert abs(plain - found).max() > 0.5


@pytest.mark.long
def test_rows_of_a_rolling_shutter_are_blurred_by_their_exposure() -> None:
    """A bar that crosses the picture leans, and its streak is as wide as the bar and what it moves in a row's exposure."""
    size, share = 64, 0.75
    bar = square((0, 0, 0), (0.1, 0, 0), (0, 2.0, 0), UNLIT)
    flying = merged_over_shutter(
        lambda t: described(meshes=[bar], instances=[Instance(0, turned(0, (2.0 * t, 0, 0)), moves=True)])
    )
    found = picture(compile_scene(flying), settings_of(size=size, rolling_shutter=share), 256)
    x, _ = from_the_middle(size, 4.0)
    center = (found * x).sum(axis=1) / found.sum(axis=1)
    middle = share * (np.arange(size) + 0.5) / size + (1 - share) / 2 - 0.5
    np.testing.assert_allclose(center, 2.0 * middle, atol=0.01)
    spread = np.sqrt((found * (x - center[:, None]) ** 2).sum(axis=1) / found.sum(axis=1))
    known = math.sqrt((0.2**2 + (2.0 * (1 - share)) ** 2 + (4.0 / size) ** 2) / 12)
    np.testing.assert_allclose(spread, known, rtol=0.05)
