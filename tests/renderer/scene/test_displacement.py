"""Tests of displaced meshes: heights in closed form, closed seams and creases, the budget of triangles, and equal results."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image as Picture

from renderer.errors import SceneError
from renderer.scene.compile import compile_scene
from renderer.scene.deduplicate import unique_threes
from renderer.scene.description import Camera, Environment, Image, Instance, Material, SceneDescription, Texture
from renderer.scene.displacement.apply import displace
from renderer.scene.displacement.dicing import dice
from renderer.scene.frame_reuse import ShotCache
from renderer.scene.load import read
from renderer.scene.readers import shapes
from renderer.scene.watertight import is_closed
from renderer.settings import View

SCALE, MIDDLE = 0.4, 0.5


def waves(size=64):
    """Returns the image of a product of two cosines, 0.25 ... 0.75, as floats, which have no steps."""
    wave = np.cos(2 * np.pi * (np.arange(size) + 0.5) / size)
    return Image("waves", np.repeat((0.5 + 0.25 * wave[:, None] * wave)[..., None], 3, axis=2).astype(np.float32), srgb=False)


def scene(mesh, rate=20.0, views=(), instances=None, **more):
    look = Material(
        displacement_texture=0, displacement_scale=SCALE, displacement_midlevel=MIDDLE, displacement_rate=rate, **more
    )
    return SceneDescription(
        meshes=[mesh],
        instances=instances or [Instance(0)],
        images=[waves()],
        textures=[Texture(0)],
        materials=[look, Material()],
        environment=Environment(),
        cameras=[Camera(str(i), view) for i, view in enumerate(views)],
    )


def displaced(description):
    return displace(description, ShotCache()).meshes[-1]


def test_heights_and_normals_of_a_plane():
    """A plane has the heights of its function, and the normals of its derivatives; both converge with finer dicing."""
    mesh = displaced(scene(shapes.quad("plane"), rate=8.0))
    u, v = 2 * np.pi * mesh.uvs.astype(np.float64).T
    assert np.abs(mesh.positions[:, 2] - 0.25 * SCALE * np.cos(u) * np.cos(v)).max() < 3e-3 * SCALE
    np.testing.assert_allclose(mesh.positions[:, :2], np.stack([2 * mesh.uvs[:, 0] - 1, 1 - 2 * mesh.uvs[:, 1]], 1), atol=1e-6)
    inside = (np.abs(mesh.uvs - 0.5) < 0.49).all(axis=1)
    slopes = 0.25 * SCALE * np.pi * np.stack([np.sin(u) * np.cos(v), -np.cos(u) * np.sin(v)], axis=1)
    np.testing.assert_allclose((mesh.normals[:, :2] / mesh.normals[:, 2:])[inside], slopes[inside], atol=0.02)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-6)


def ball(name):
    angles = np.linspace(-np.pi / 2, np.pi / 2, 13)
    return shapes.lathe(name, [(float(np.cos(a)) * (i % 12 > 0), float(np.sin(a))) for i, a in enumerate(angles)], 24)


@pytest.mark.parametrize("make", [shapes.cube, ball, lambda name: replace(shapes.cube(name), normals=None)])
@pytest.mark.parametrize("view", [pytest.param(None, marks=pytest.mark.long), View((2, 3, 4), (0.5, 0.2, 0), fov=20)])
def test_creases_and_seams_stay_closed(make, view):
    """Edges of a cube with a vertex for each face, and the seam and the poles of a sphere, stay closed, finely diced or not."""
    mesh = displaced(scene(make("body"), 30.0, () if view is None else (view,)))
    assert len(mesh.triangles) > 2 * len(make("body").triangles)
    assert is_closed(mesh.positions, mesh.triangles)
    assert np.isfinite(mesh.normals).all()


def test_edges_on_the_screen_are_short():
    """Near the camera triangles are small, far from it large, and outside of the picture up to four times as large."""
    view, rate = View((0, 0, 1), (0, 6, 0), (0, 0, 1), fov=60), 40.0
    plane = shapes.quad("plane")
    plane.positions = plane.positions * np.float32(50)
    whole = displace(scene(plane, rate, (view,)), ShotCache())
    mesh = whole.meshes[-1]
    flat = np.column_stack([100 * mesh.uvs[:, 0] - 50, 50 - 100 * mesh.uvs[:, 1], np.zeros(len(mesh.uvs))]).astype(np.float64)
    a, b = (flat[np.roll(mesh.triangles, -k, axis=1)].reshape(-1, 3) for k in (0, 1))
    middle = (a + b) / 2 - view.eye
    pixels = np.linalg.norm(b - a, axis=1) * 1080 / (2 * np.tan(np.radians(30))) / np.linalg.norm(middle, axis=1)
    forward = np.array([0, 6, -1]) / np.sqrt(37)
    is_behind = middle @ forward < 0
    assert pixels.max() <= 4.001 * rate
    assert pixels[is_behind].max() > 2 * rate
    assert pixels[(np.abs(middle[:, 0]) < 0.5 * (middle @ forward)) & (np.abs(middle[:, 1] - 6) < 2)].max() <= 1.001 * rate


def test_budget_lengthens_all_edges():
    """With too small a budget there are fewer triangles than that, a warning says so, and the bits are the same each time."""
    description = replace(scene(shapes.cube("cube"), 2.0), displaced_triangles=20_000)
    mesh, again = displaced(description), displaced(replace(description, warnings=[]))
    assert 5_000 < len(mesh.triangles) <= 20_000
    assert [each.code for each in description.warnings] == ["displacement-limited"]
    for name in ("positions", "normals", "triangles", "uvs"):
        np.testing.assert_array_equal(getattr(mesh, name), getattr(again, name))


def test_dicing_neither_loses_nor_covers_area():
    """Triangles with one, two or three split edges keep the area and the orientation of the whole."""
    rng = np.random.default_rng(3)
    points = np.array([(0, 0, 0), (3, 0, 0), (0, 2, 0), (2.5, 2, 0)], np.float64)
    wanted = rng.random(7) + 0.1

    def measure(at):
        factor = 1 / wanted[np.abs(at[:, 0] * 13 + at[:, 1] * 5).astype(int) % 7]
        return np.concatenate([at.T, factor[None]])[None]

    made = dice(points, np.array([(0, 1, 2), (1, 3, 2)], np.int32), measure, 1.0, 10_000)
    assert 20 < len(made.triangles) == made.expected
    for a, b in made.levels:
        points = np.concatenate([points, (points[a] + points[b]) / 2])
    u, v = (points[made.triangles[:, k]] - points[made.triangles[:, 0]] for k in (1, 2))
    area = (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    assert area.min() > 0
    assert area.sum() == pytest.approx(3 + 2.5)


@pytest.mark.parametrize("views", [(), (View((0, 0, 3), (0, 0, 0)),)])
def test_dicing_ends_with_impossible_numbers(views):
    """A rate of 0 is refused; positions for which lengths are infinite are refused later, and not diced until then."""
    for rate in (0.0, 1e-300, -1.0, float("nan")):
        with pytest.raises(SceneError, match="its displacement_rate is"):
            displaced(scene(shapes.quad("plane"), rate, views))
    for scale in (1e154, 1e200, np.nan):
        plane = shapes.quad("plane")
        plane.positions = plane.positions.astype(np.float64) * scale
        assert len(displaced(scene(plane, views=views)).triangles) == 2


def test_only_materials_with_heights_displace():
    """An instance of another material stays as it is; meshes without UVs too, with a warning; equal ones are displaced once."""
    places = [Instance(0), Instance(0, material=1), Instance(0, np.diag([2.0, 2, 2, 1]))]
    description = scene(shapes.quad("plane"), instances=places)
    found = displace(description, ShotCache())
    assert [each.mesh for each in found.instances] == [1, 0, 1]
    bare = scene(replace(shapes.quad("plane"), uvs=None))
    assert displace(bare, ShotCache()).instances[0].mesh == 0
    assert [each.code for each in bare.warnings] == ["displacement-without-uvs"]


def test_motion_keys_are_displaced_alike():
    """A mesh whose vertices move has the same triangles at each key, displaced along that key's normals."""
    plane = shapes.quad("plane")
    turned = plane.positions[:, [2, 0, 1]], plane.normals[:, [2, 0, 1]]
    plane.keys, plane.deforms = ((plane.positions, plane.normals), turned), True
    mesh = displaced(scene(plane))
    (first, _), (last, normals) = mesh.keys
    np.testing.assert_array_equal(first, mesh.positions)
    np.testing.assert_allclose(last, mesh.positions[:, [2, 0, 1]], atol=1e-6)
    np.testing.assert_allclose(normals, mesh.normals[:, [2, 0, 1]], atol=1e-5)


def test_cameras_of_moving_scenes_do_not_matter():
    """The frames of a shot share their geometry: it does not depend on the camera if the scene moves."""
    views = View((0, 0, 3), (0, 0, 0)), View((0, 0, 30), (0, 0, 0))
    still = [len(displaced(scene(shapes.quad("p"), 20.0, (view,))).triangles) for view in views]
    moving = [displaced(replace(scene(shapes.quad("p"), 20.0, (view,)), moves=True)) for view in views]
    assert still[0] > 4 * still[1]
    np.testing.assert_array_equal(moving[0].positions, moving[1].positions)


def test_frames_share_displaced_meshes():
    """A frame compiled after another one, with what that left, equals the frame compiled alone."""
    kept, scenes = ShotCache(), []
    for x in (0.0, 1.5):
        places = [Instance(0), Instance(1, np.diag([1.0, 1, 1, 1]) + np.eye(4, k=3) * x, moves=True)]
        frame = replace(scene(shapes.quad("plane"), 60.0, (View((0, -4 - x, 3), (0, 0, 0)),), places), moves=True)
        frame.meshes.append(replace(shapes.cube("cube"), material=1))
        scenes.append(compile_scene(frame, shot_cache=kept))
        alone = compile_scene(frame)
        for name in ("position", "normal", "triangle", "to_world"):
            np.testing.assert_array_equal(getattr(scenes[-1], name), getattr(alone, name))
    assert len(scenes[1].triangle) > 500


@pytest.mark.long
def test_threads_do_not_change_a_displaced_scene():
    one, three = (compile_scene(scene(shapes.globe("globe"), 4.0), threads=threads) for threads in (1, 3))
    assert len(one.triangle) > 65_536  # more than a part
    for name in ("position", "normal", "triangle", "uv"):
        np.testing.assert_array_equal(getattr(one, name), getattr(three, name))


def test_scene_file(tmp_path):
    """A scene file's sphere is displaced as a mesh with the UVs of the analytic sphere."""
    Picture.fromarray(np.full((4, 4), 255, np.uint8)).save(tmp_path / "h.png")
    (tmp_path / "s.yaml").write_text(
        "displaced_triangles: 300000\n"
        "textures: {h: {image: h.png}}\n"
        "materials: {m: {displacement_texture: h, displacement_scale: 0.5, displacement_midlevel: 0.2, displacement_rate: 90}}\n"
        "shapes: [{type: sphere, material: m, center: [1, 2, 3], radius: 2}]\n"
    )
    description = read(tmp_path, "s.yaml")
    assert description.displaced_triangles == 300_000
    assert not description.spheres
    mesh = displaced(description)
    np.testing.assert_allclose(np.linalg.norm(mesh.positions, axis=1), 1 + 0.5 * 0.8, rtol=1e-3)
    np.testing.assert_allclose(description.instances[0].transform[:3, 3], (1, 2, 3))
    points = mesh.positions / np.linalg.norm(mesh.positions, axis=1, keepdims=True)
    u = 0.5 + np.arctan2(points[:, 0], -points[:, 2]) / (2 * np.pi)
    off = np.abs(mesh.uvs[:, 0] - u)
    ring = np.abs(points[:, 1]) < 0.99
    assert np.minimum(off, 1 - off)[ring].max() < 1e-3
    assert len(unique_threes(mesh.positions)[0]) < len(mesh.positions)  # the seam
