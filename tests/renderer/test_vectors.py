"""Tests of motion vectors against independent computations: affine motions in closed form, and all triangles of a file."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from renderer.scene.animation import BETWEEN, Moment
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Instance, Material, Mesh, SceneDescription, Sphere
from renderer.scene.load import Shot
from renderer.scene.shutter_merge import merge_over_shutter
from renderer.settings import RenderSettings, View
from renderer.vectors import motion_vectors
from tests.grids import grid
from tests.rayfarm.test_stage import animated_test_scene
from tests.renderer.builders import gray, square
from tests.renderer.scene.builders import world

WIDTH, HEIGHT = 40, 24
NEAR = 1e-4  # pixels
VIEW = View((0.5, 0.3, 4.0), (0.1, 0.0, 0.0), fov=50.0)
GRAY, LAMP, SHEER = 0, 1, 2
MATERIALS = [
    Material(base_color=gray(0.7)),
    Material(emission=gray(2.0), double_sided=True),
    Material(base_color=gray(0.7), opacity=0.3, alpha_mode="blend"),
]
F64 = np.ndarray
At = Callable[[float], F64]  # Maps a time, in frames relative to the current one, to a 4 x 4 matrix.


def turned(angle: float, axis: int = 2) -> F64:
    matrix = np.eye(4)
    a, b = [k for k in range(3) if k != axis]
    matrix[a, a] = matrix[b, b] = math.cos(angle)
    matrix[b, a] = math.sin(angle)
    matrix[a, b] = -math.sin(angle)
    return matrix


def moved(*way: float) -> F64:
    matrix = np.eye(4)
    matrix[:3, 3] = way
    return matrix


def axes(view: View) -> F64:
    """Returns the camera's axes as rows: right, up, forward."""
    forward = np.subtract(view.target, view.eye)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, view.up)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(right, forward), forward])


def rays(view: View) -> tuple[F64, F64]:
    """Returns the origins and directions of the rays through the pixel centres, (h, w, 3) each."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    x, y = x - WIDTH / 2, HEIGHT / 2 - y
    right, up, forward = axes(view)
    if view.projection == "panorama":
        turn, rise = x / WIDTH * 2 * math.pi, y / HEIGHT * math.pi
        part = np.stack([np.cos(rise) * np.sin(turn), np.sin(rise), np.cos(rise) * np.cos(turn)], -1)
        return np.broadcast_to(view.eye, part.shape), part @ axes(view)
    x, y = x + view.shift_x * HEIGHT, y + view.shift_y * HEIGHT
    flat = view.projection == "orthographic"
    pixel = (view.height if flat else 2 * math.tan(math.radians(view.fov) / 2)) / HEIGHT
    across = x[..., None] * pixel * right + y[..., None] * pixel * up
    if flat:
        return view.eye + across, np.broadcast_to(forward, across.shape)
    return np.broadcast_to(view.eye, across.shape), across + forward


def seen(view: View, points: F64) -> F64:
    """Returns the picture positions of points, in pixels from the centre: x to the right, y upwards."""
    x, y, z = np.moveaxis((points - view.eye) @ axes(view).T, -1, 0)
    if view.projection == "panorama":
        turns = np.arctan2(x, z) / (2 * math.pi), np.arcsin(y / np.sqrt(x * x + y * y + z * z)) / math.pi
        return np.stack([turns[0] * WIDTH, turns[1] * HEIGHT], -1)
    shift = np.array([view.shift_x, view.shift_y]) * HEIGHT
    if view.projection == "orthographic":
        return np.stack([x, y], -1) / (view.height / HEIGHT) - shift
    return np.stack([x, y], -1) / z[..., None] / (2 * math.tan(math.radians(view.fov) / 2) / HEIGHT) - shift


def known(points: list[F64], views: list[View]) -> F64:
    """Returns the expected motion vectors of points from their positions and the camera views at three times."""
    before, now, after = (seen(view, each) for view, each in zip(views, points, strict=True))
    ways = [before - now, now - after]
    for way in ways:
        if views[1].projection == "panorama":
            way[..., 0] -= WIDTH * np.round(way[..., 0] / WIDTH)
    return np.concatenate(ways, -1)


def settings_of(views: list[View]) -> RenderSettings:
    moving = tuple(views) if len({*views}) > 1 else ()
    return RenderSettings(WIDTH, HEIGHT, views[1], views=moving)


def merged_over_shutter(at: Callable[[float], SceneDescription]) -> SceneDescription:
    return merge_over_shutter(lambda moment: at(moment.offset), Moment(), BETWEEN)


def described(**things) -> SceneDescription:
    return SceneDescription(materials=list(MATERIALS), environment=Environment(gray(1.0)), moves=True, **things)


def body(at: At, material: int = GRAY) -> Callable[[float], SceneDescription]:
    """Returns a function that takes a time and returns a scene with a square, placed by the matrix `at(time)`."""
    mesh = square((0, 0, 0), (1.2, 0.1, 0), (0, 1.0, 0), material)
    return lambda t: described(meshes=[mesh], instances=[Instance(0, at(t), moves=True)])


def bent(at: At) -> Callable[[float], SceneDescription]:
    """Returns the same function as `body`, except that the square's vertices move instead of its matrix."""
    mesh = square((0, 0, 0), (1.2, 0.1, 0), (0, 1.0, 0), GRAY)

    def describe(t: float) -> SceneDescription:
        positions = (mesh.positions @ at(t)[:3, :3].T + at(t)[:3, 3]).astype(np.float32)
        return described(meshes=[replace(mesh, positions=positions, deforms=True)], instances=[Instance(0)])

    return describe


def on_the_square(at: At, view: View) -> tuple[list[F64], F64]:
    """Returns the points of the square that the pixels see, at the three times, and a mask of the pixels that see it."""
    o, d = rays(view)
    back = np.linalg.inv(at(0))
    start, way = o @ back[:3, :3].T + back[:3, 3], d @ back[:3, :3].T
    t = -start[..., 2] / way[..., 2]
    local = start + t[..., None] * way
    side = np.linalg.solve(np.array([[1.2, 0], [0.1, 1.0]]), local[..., :2].reshape(-1, 2).T).T.reshape(local[..., :2].shape)
    inside = (np.abs(side) < 0.98).all(-1) & (t > 0)
    return [local @ at(time)[:3, :3].T + at(time)[:3, 3] for time in (-1, 0, 1)], inside


SKEW = np.array([[-0.8, 0.3, 0, 0], [0, 0.7, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
MOVES: dict[str, At] = {
    "flies": lambda t: moved(0.3 * t, 0.1 * t, -0.2 * t),
    "turns": lambda t: turned(0.3 * t) @ turned(0.4 * t - 0.2, 1),
    "hangs on what turns": lambda t: turned(0.2 * t) @ moved(0.3, 0, 0) @ turned(0.5 * t) @ SKEW,
    "grows": lambda t: moved(0, 0, 0.1 * t) @ np.diag([1 + 0.2 * t, 1 - 0.1 * t, 1, 1]),
}
WAYS: dict[str, list[View]] = {
    "stands still": [VIEW] * 3,
    "pans": [replace(VIEW, target=(x, 0.05 * x, 0.0)) for x in (-0.2, 0.1, 0.5)],
    "flies and zooms": [replace(VIEW, eye=(x, 0.3, 4 + x), fov=50 + 20 * x) for x in (0.1, 0.5, 0.7)],
    "flies and shifts": [replace(VIEW, eye=(x, 0.3, 4.0), shift_x=0.3 * x, shift_y=-0.2) for x in (0.1, 0.5, 0.7)],
    "orthographic": [replace(VIEW, eye=(x, 0.3, 4.0), projection="orthographic", height=3.0) for x in (0.1, 0.5, 0.7)],
    "panorama": [replace(VIEW, eye=(x, 0.3, 0.8), projection="panorama") for x in (0.4, 0.5, 0.7)],
}


@pytest.mark.parametrize("way", WAYS)
@grid("move", MOVES, ordinary=("hangs on what turns",))
def test_affine_motion_matches_closed_form(move: str, way: str) -> None:
    at, views = MOVES[move], WAYS[way]
    points, inside = on_the_square(at, views[1])
    assert inside.sum() > 40
    expected = known(points, views)
    shapes = {"a body": body(at), "a lamp": body(at, LAMP), "a mesh that bends": bent(at)}
    for name, describe in shapes.items():
        found = motion_vectors(compile_scene(merged_over_shutter(describe)), settings_of(views))
        assert np.abs(expected[inside]).max() > 1.0
        np.testing.assert_allclose(found[inside], expected[inside], rtol=1e-5, atol=NEAR, err_msg=name)


@pytest.mark.parametrize("way", WAYS)
def test_motion_of_spheres_and_background(way: str) -> None:
    """Points of a moving and growing sphere keep their direction from its centre; background pixels have no motion vector."""
    views = WAYS[way]
    balls = {t: ((0.2 * t, 0.1 * t, 0.0), 0.7 + 0.1 * t) for t in (-1.0, 0.0, 1.0)}
    scene = compile_scene(merged_over_shutter(lambda t: described(spheres=[Sphere(*balls[t], moves=True)])))
    found = motion_vectors(scene, settings_of(views))
    o, d = rays(views[1])
    d = d / np.linalg.norm(d, axis=-1, keepdims=True)
    b, c = (o * d).sum(-1), (o * o).sum(-1) - 0.7**2
    met = b * b > c
    normal = (o + (-b - np.sqrt(np.where(met, b * b - c, 0)))[..., None] * d) / 0.7
    expected = known([balls[t][0] + balls[t][1] * normal for t in (-1.0, 0.0, 1.0)], views)
    inside = (b * b > c + 0.02) & (b < 0)
    np.testing.assert_allclose(found[inside], expected[inside], rtol=1e-4, atol=1e-3)
    outside = (b * b < c - 0.02) | (b > 0)
    assert inside.sum() > 25 and outside.sum() > 50
    far = [view.eye + 1e9 * d for view in views]
    expected = np.zeros_like(found) if views[1].projection == "orthographic" else known(far, views)
    np.testing.assert_allclose(found[outside], expected[outside], rtol=1e-5, atol=NEAR)


@pytest.mark.long
def test_motion_vectors_of_an_animated_gltf(tmp_path: Path) -> None:
    """Motion vectors of a glTF file match a brute-force search of all triangles.

    The file has a hierarchy, a morph target, a skin and a moving camera.
    """
    (tmp_path / "all.glb").write_bytes(animated_test_scene())
    shot = Shot(tmp_path, "all.glb")
    found = [shot.scene_at(Moment(frame)) for frame in (8, 9, 10)]
    views = [replace(each.cameras[0].view, fov=50.0) for each in found]
    corners = [np.concatenate([world(each, n) for n in range(len(each.instances))]).astype(np.float64) for each in found]
    o, d = rays(views[1])
    best = np.full((HEIGHT, WIDTH), np.inf)
    points = [np.zeros((HEIGHT, WIDTH, 3)) for _ in range(3)]
    for n, (a, b, c) in enumerate(corners[1]):  # Moeller & Trumbore 1997
        p = np.cross(d, c - a)
        determinant = p @ (b - a)
        u = ((o - a) * p).sum(-1) / determinant
        q = np.cross(o - a, b - a)
        v, t = (d * q).sum(-1) / determinant, q @ (c - a) / determinant
        nearer = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < best)
        best[nearer] = t[nearer]
        for point, triangles in zip(points, corners, strict=True):
            a, b, c = triangles[n]
            point[nearer] = (a + u[..., None] * (b - a) + v[..., None] * (c - a))[nearer]
    ours = motion_vectors(compile_scene(shot.between_frames(Moment(9))), settings_of(views))
    met = np.isfinite(best)
    assert met.sum() > 150
    apart = np.abs(ours[met] - known(points, views)[met]).max(-1)
    assert (apart < NEAR).mean() > 0.98, "but where a ray meets an edge, the neighbouring triangle moves otherwise"
    assert np.abs(ours[met]).max() > 0.5


def test_mostly_transparent_surfaces_are_ignored() -> None:
    pane = square((0, 0, 1), (3, 0, 0), (0, 3, 0), SHEER)
    at = MOVES["flies"]

    def describe(t: float) -> SceneDescription:
        behind = body(at)(t)
        return replace(behind, meshes=[*behind.meshes, pane], instances=[*behind.instances, Instance(1)])

    points, inside = on_the_square(at, VIEW)
    found = motion_vectors(compile_scene(merged_over_shutter(describe)), settings_of([VIEW] * 3))
    np.testing.assert_allclose(found[inside], known(points, [VIEW] * 3)[inside], rtol=1e-5, atol=NEAR)


def test_vectors_ignore_threads_lens_and_points_behind() -> None:
    scene = compile_scene(merged_over_shutter(body(MOVES["turns"])))
    settings = settings_of(WAYS["flies and zooms"])
    one = motion_vectors(scene, settings, threads=1)
    np.testing.assert_array_equal(motion_vectors(scene, settings, threads=3), one)
    blurred = [replace(view, aperture=0.3) for view in settings.views]
    np.testing.assert_array_equal(motion_vectors(scene, replace(settings, view=blurred[1], views=tuple(blurred))), one)
    backwards = [replace(VIEW, target=(0.1, 0.0, 8.0)), VIEW, VIEW]
    found = motion_vectors(scene, settings_of(backwards))
    assert not found[HEIGHT // 2, WIDTH // 2, :2].any() and np.isfinite(found).all()


def test_changed_topology_has_camera_motion_only() -> None:
    one = square((0, 0, 0), (1.2, 0.1, 0), (0, 1.0, 0), GRAY)
    other = Mesh("square", one.positions + np.float32([0.1, 0, 0]), one.triangles[::-1].copy(), deforms=True)
    still = [replace(one, deforms=True), other]
    scene = compile_scene(merged_over_shutter(lambda t: described(meshes=[still[int(t > 0)]], instances=[Instance(0)])))
    assert not motion_vectors(scene, settings_of([VIEW] * 3)).any()
