"""Tests that a picture depends neither on whether meshes are stored as instances or copies, nor on the scale of the scene."""

import numpy as np
import pytest

from renderer.film import ALBEDO, COLOR, MATERIAL, NORMAL, OBJECT, SAMPLES, mean
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.description import Instance, Light, Material, Mesh, SceneDescription, Sphere
from renderer.settings import RenderSettings, View
from tests.grids import grid
from tests.renderer.builders import box, emitter, gray, icosphere, square
from tests.renderer.judge import limit, mean_and_error


def room(scale=1.0):
    """Returns a closed room with a light, smooth and flat balls as instances, a sphere, and glass."""
    ball = icosphere(2)
    smooth = Mesh("smooth", ball.positions, ball.triangles, ball.positions)
    rng = np.random.default_rng(0)
    instances = [Instance(0), Instance(1)]
    for i in range(8):
        place = np.eye(4)
        place[:3, :3] = np.linalg.qr(rng.standard_normal((3, 3)))[0] * rng.uniform(0.2, 0.5)
        place[:3, 3] = rng.uniform(-1.4, 1.4, 3)
        instances.append(Instance(2 + i % 2, place, material=3 if i == 5 else None, name=f"ball {i}"))
    whole = np.diag([scale, scale, scale, 1.0])
    for instance in instances:
        instance.transform = whole @ instance.transform
    return SceneDescription(
        meshes=[box(0, 2.0), square((0, 1.9, 0), (0.8, 0, 0), (0, 0, 0.8), 1), smooth, icosphere(1, 2)],
        instances=instances,
        spheres=[Sphere(tuple(scale * c for c in (0.3, -1.5, 0.5)), 0.4 * scale, 3)],
        materials=[
            Material(base_color=gray(0.7)),
            emitter(8.0, double_sided=True),
            Material(kind="metallic_roughness", base_color=(0.9, 0.4, 0.2), metallic=1.0, roughness=0.3),
            Material(kind="glass", base_color=gray(1.0)),
        ],
    )


def view(scale=1.0, seed=0, size=32):
    view = View((1.9 * scale, 1.6 * scale, 1.9 * scale), (0, -0.4 * scale, 0), fov=80)
    return RenderSettings(size, size, view, max_depth=6, seed=seed)


@pytest.fixture
def kept(monkeypatch):
    """Makes the compiler turn every repeated mesh into instances."""
    monkeypatch.setattr("renderer.scene.instances._MIN_SAVED_TRIANGLES", 0)


def test_instances_and_copies_render_equally(monkeypatch):
    """Pictures of instances and of copied meshes differ by noise only, in each pixel; ids and normals of sample 0 are equal."""
    films = []
    for seed, worth in ((1, 0), (2, 10**9), (1, 10**9)):
        monkeypatch.setattr("renderer.scene.instances._MIN_SAVED_TRIANGLES", worth)
        compiled = compile_scene(room())
        assert (len(compiled.to_world) > 0) == (worth == 0)
        films.append(render_frame(compiled, view(seed=seed), 64))
    means = [mean_and_error(sums) for sums in films]
    assert abs(means[0][0] - means[1][0]) < limit(1) * np.hypot(means[0][1], means[1][1])
    assert means[0][1] < 0.01 * means[0][0]
    kept, _, copied = films  # films of the same seed
    for plane in (OBJECT, MATERIAL):
        assert (kept[plane] == copied[plane]).mean() > 0.99
        assert len(np.unique(kept[plane])) >= 3
    for plane in (NORMAL, ALBEDO):
        difference = np.abs(mean(kept, 24, plane) - mean(copied, 24, plane)).max(-1)
        assert (difference < 1e-3).mean() > 0.97


@pytest.mark.parametrize("scale", [2.0**-10, 2.0**10])
def test_power_of_two_scale_keeps_the_bits(kept, scale):
    """All thresholds and offsets are relative, so scaling the scene by a power of two changes no bit of the picture."""
    one, other = (render_frame(compile_scene(room(s)), view(s), 4) for s in (1.0, scale))
    for plane in (COLOR, ALBEDO, NORMAL, OBJECT, MATERIAL):
        np.testing.assert_array_equal(one[plane], other[plane])


@grid("scale", [1e-3, 1e3])
def test_picture_does_not_depend_on_scale(kept, scale):
    one, other = (mean_and_error(render_frame(compile_scene(room(s)), view(s, seed), 64)) for seed, s in enumerate((1.0, scale)))
    assert abs(one[0] - other[0]) < limit(2) * np.hypot(one[1], other[1])
    assert other[1] < 0.01 * other[0]


def test_coarse_smooth_ball_has_no_terminator_artefacts():
    """A smooth ball of 320 triangles shows no facets at the shadow boundary and differs from a sphere only in its silhouette."""
    ball = icosphere(2)
    ball.normals = ball.positions
    films = []
    for shape in ({"meshes": [ball], "instances": [Instance(0)]}, {"spheres": [Sphere((0, 0, 0), 1.0)]}):
        light = Light("point", intensity=gray(100.0), position=(9.0, 3.0, 1.0))
        description = SceneDescription(materials=[Material(base_color=gray(0.8))], lights=[light], **shape)
        settings = RenderSettings(48, 48, View((0.5, 0.5, 4.0), (0, 0, 0), fov=30), max_depth=2)
        films.append(render_frame(compile_scene(description), settings, 8))
    ours, true = (mean(sums, 24)[..., 0] for sums in films)
    within = (films[0][SAMPLES] == 8) & (films[0][MATERIAL] > 0) & (films[1][MATERIAL] > 0)
    dark = within & (true == 0)
    dim = within & (true > 0) & (true < 0.1 * true.max())
    assert dim.sum() > 40
    assert dark.sum() > 200
    assert (ours[dim] > 0).mean() > 0.9  # pixels next to the terminator are lit,
    assert (ours[dark] < 0.02 * true.max()).mean() > 0.99  # those beyond it are dark,
    assert np.median(np.abs(ours - true)[within]) < 0.01 * true.max()


def test_without_a_bvh_the_picture_is_the_same(kept):
    with_tree, brute = (render_frame(compile_scene(room(), brute=b), view(size=12), 2) for b in (False, True))
    np.testing.assert_array_equal(with_tree, brute)
