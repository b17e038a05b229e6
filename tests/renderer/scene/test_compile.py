"""Tests of the compilation of scene descriptions to the arrays that kernels read."""

from dataclasses import replace

import numpy as np
import pytest

from renderer import film
from renderer.arrays.rows import HALF_16, HALF_GAIN, PART_OBJECT
from renderer.arrays.scene import flat, seal
from renderer.errors import SceneError
from renderer.luminance import luminance
from renderer.render import render_frame
from renderer.scene.animation import Clip
from renderer.scene.compile import AUTO_CAMERA, compile_scene, summarise
from renderer.scene.default_camera import ASPECT, frame
from renderer.scene.description import (
    Camera,
    Environment,
    Image,
    Instance,
    Material,
    Mesh,
    SceneDescription,
    Sphere,
    Texture,
)
from renderer.scene.environment import search_tables
from renderer.scene.geometry import by_triangle, flatten
from renderer.scene.readers import shapes
from renderer.settings import RenderSettings, View
from tests.renderer.scene.builders import rotation_y

ANGLED = np.array([(0, 0, 0), (2, 0, 0), (0, 3, 1)], np.float32)
ONE = np.array([(0, 1, 2)], np.int32)


def described(*meshes, transforms=None, **more):
    description = SceneDescription(meshes=list(meshes), materials=[Material()], **more)
    description.instances = [Instance(i, np.eye(4) if transforms is None else transforms[i]) for i in range(len(meshes))]
    return description


def ellipsoid():
    sphere = shapes.lathe("ball", [(np.sin(a), -np.cos(a)) for a in np.linspace(0, np.pi, 33)], 64)
    sphere.normals = sphere.positions.copy()
    return sphere


@pytest.mark.parametrize("mirror", [1, -1])
def test_normals_under_stretching_shearing_and_mirroring(mirror):
    transform = rotation_y(30) @ np.diag([3.0, mirror * 0.5, 1.0, 1.0])
    transform[0, 1] += 0.4
    transform[:3, 3] = 7, 8, 9
    geometry = flatten(described(ellipsoid(), transforms=[transform]))
    # The ellipsoid |M^-1 (x - t)| = 1 has the gradient M^-T M^-1 (x - t).
    inverse = np.linalg.inv(transform[:3, :3])
    gradient = (geometry.position - transform[:3, 3]) @ inverse.T @ inverse
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    np.testing.assert_allclose(geometry.normal, gradient, atol=2e-5)
    # Normals point outwards, and corners are counter-clockwise seen from outside.
    a, b, c = (geometry.position[geometry.triangle[:, k]] for k in range(3))
    assert ((np.cross(b - a, c - a) * geometry.normal[geometry.triangle[:, 0]]).sum(axis=1) > 0).all()


def test_missing_normals_become_flat():
    geometry = flatten(described(Mesh("m", ANGLED, ONE)))
    expected = np.cross(ANGLED[1] - ANGLED[0], ANGLED[2] - ANGLED[0])
    np.testing.assert_allclose(geometry.normal, np.tile(expected / np.linalg.norm(expected), (3, 1)), rtol=1e-6)


def test_zero_normals_are_replaced():
    normals = np.array([(0, 0, 0), (0, 0, 5), (np.nan, 0, 0)], np.float32)
    mesh = Mesh("m", np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32), ONE, normals)
    np.testing.assert_array_equal(flatten(described(mesh)).normal, [(0, 0, 1)] * 3)


def test_triangles_without_area_are_dropped():
    positions = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (2, 0, 0)], np.float32)
    triangles = np.array([(0, 1, 1), (0, 1, 3), (0, 1, 2)], np.int32)
    geometry = flatten(described(Mesh("m", positions, triangles)))
    assert len(geometry.triangle) == 1
    np.testing.assert_array_equal(geometry.position[geometry.triangle], positions[[(0, 1, 2)]])


def test_scene_of_zero_area_triangles_is_an_error():
    with pytest.raises(SceneError, match="no triangle with an area"):
        compile_scene(described(Mesh("m", ANGLED, ONE), transforms=[np.diag([0.0, 1, 1, 1]) * 0 + np.diag([0, 0, 0, 1.0])]))


def test_too_many_triangles_are_rejected_early(monkeypatch):
    monkeypatch.setattr("renderer.scene.geometry.MAX_TRIANGLES", 10)
    description = described(shapes.quad("q"))
    description.instances *= 6
    with pytest.raises(SceneError, match="Simplify"):
        compile_scene(description)


def test_transform_beyond_float32_range_is_an_error():
    with pytest.raises(SceneError, match="too large for 32-bit numbers"):
        compile_scene(described(Mesh("far", ANGLED, ONE), transforms=[np.diag([1e30, 1e30, 1e30, 1.0])]))


def test_an_instances_material_replaces_the_meshs():
    description = described(shapes.quad("a"), shapes.quad("b"))
    description.materials.append(Material("other"))
    description.instances[1].material = 1
    geometry = flatten(description)
    assert by_triangle(geometry, geometry.material).tolist() == [0, 0, 1, 1]


def test_lights_are_chosen_by_power():
    description = described(shapes.quad("lamp"), shapes.quad("wall"))
    description.materials = [
        Material("lamp", emission=(1.0, 1.0, 1.0), double_sided=True),
        Material("wall"),
        Material("ball", emission=(0.0, 2.0, 0.0)),
    ]
    description.meshes[1].material = 1
    description.spheres = [Sphere((0, 5, 0), 0.5, 1), Sphere((0, 9, 0), 0.5, 2)]
    scene = compile_scene(description)
    assert sorted(scene.light_primitive.tolist()) == [0, 5]
    lamp, ball = np.argsort(scene.light_primitive)
    assert scene.triangle_light.tolist() == [lamp, lamp, -1, -1]
    assert scene.sphere_light.tolist() == [-1, ball]
    np.testing.assert_allclose(scene.light_area[[lamp, ball]], [4, np.pi], rtol=1e-6)
    powers = np.array([4 * 2, np.pi * 2 * 0.7152])  # area times number of sides times luminance
    np.testing.assert_allclose(np.diff(scene.light_cdf)[[lamp, ball]], 0.99 * powers / powers.sum() + 0.01 / 2, rtol=1e-5)
    assert scene.light_cdf[0] == 0
    assert scene.light_cdf[-1] == 1


def test_textured_emission_is_averaged_per_triangle():
    """The triangles of an emissive square are sampled in proportion to the mean of their texels.

    The square is split along a diagonal, and its right half is black.
    """
    pixels = np.zeros((64, 64, 4), np.uint8)
    pixels[:, :32] = 255
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    uvs = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32)
    description = described(Mesh("screen", corners, faces, uvs=uvs), Mesh("lamp", corners, faces, material=1))
    description.images, description.textures = [Image("i", pixels)], [Texture(0, "clamp", "clamp")]
    description.materials = [Material(emission=(1, 1, 1), emission_texture=0), Material(emission=(1, 1, 1))]
    scene = compile_scene(description)
    chance = np.diff(scene.light_cdf)[scene.triangle_light].astype(float)
    powers = np.array([0.95 * 0.25 + 0.025, 0.95 * 0.75 + 0.025, 2.0, 2.0])  # the quad lamp is one light
    np.testing.assert_allclose(chance, 0.99 * powers / 3 + 0.01 / 3, rtol=0.06)  # the mean is estimated from 64 points


def test_hdr_emission_is_unclipped_and_colors_are_clipped():
    pixels = np.zeros((1, 2, 3), np.float32)
    pixels[0, 0], pixels[0, 1] = (8, 4, 0), (0.5, 0.5, 0.5)
    description = described(shapes.quad("a"))
    description.images, description.textures = [Image("i", pixels)], [Texture(0, "clamp", "mirror")]
    description.materials = [Material(emission=(1, 1, 1), emission_texture=0, base_color_texture=0)]
    scene = compile_scene(description)
    np.testing.assert_array_equal(scene.material[0, 3:6], [8, 8, 8])
    base, emission = scene.texture[scene.material_texture[0, 0]], scene.texture[scene.material_texture[0, 1]]
    assert base[1:].tolist() == emission[1:].tolist() == [2, 1, 2, 1, HALF_16, 0, -1, 0, 0]
    halves = scene.texel.view("<f2").reshape(-1, 4) / HALF_GAIN
    assert halves[base[0] // 2].tolist() == [1, 1, 0, 1]
    assert halves[emission[0] // 2].tolist() == [1, 0.5, 0, 1]


def test_one_image_in_several_textures_is_packed_once():
    description = described(shapes.quad("a"))
    description.images = [Image("i", np.full((2, 3, 4), 7, np.uint8))]
    description.textures = [Texture(0), Texture(0, "clamp", "clamp")]
    description.materials = [Material(base_color_texture=0), Material(base_color_texture=1)]
    scene = compile_scene(description)
    assert scene.texel.shape == (6, 4)
    assert scene.texture.tolist() == [[0, 3, 2, 0, 0, 1, 0, -1, 0, 0], [0, 3, 2, 2, 2, 1, 0, -1, 0, 0]]


def test_environment_cdfs_weight_excess_radiance_by_solid_angle():
    pixels = np.random.default_rng(2).random((8, 16, 3), np.float32)
    pixels[3] = 0
    description = described(shapes.quad("a"), images=[Image("sky", pixels)])
    description.environment = Environment((2.0, 1.0, 1.0), 0, strength=3.0, rotation=90.0)
    scene = compile_scene(description)
    np.testing.assert_allclose(scene.environment, pixels * np.float32([6, 3, 3]), rtol=1e-6)
    bright = scene.environment.astype(np.float64) @ [0.2126, 0.7152, 0.0722]
    edges = np.cos(np.arange(9) * np.pi / 8)
    solid_angle = edges[:-1] - edges[1:]
    mean_expected = (bright.mean(axis=1) * solid_angle).sum() / 2
    weight = np.maximum(bright - mean_expected, 0)
    rows = weight.mean(axis=1) * solid_angle
    np.testing.assert_allclose(np.diff(scene.environment_marginal), rows / rows.sum(), atol=1e-6)
    expected = weight[0] / weight[0].sum()
    np.testing.assert_allclose(np.diff(scene.environment_conditional[0]), expected, atol=1e-6)
    np.testing.assert_allclose(np.diff(scene.environment_conditional[3]), 1 / 16, atol=1e-6)  # black rows can still be sampled
    cosine, sine, mean, chance = scene.environment_frame[:4]
    assert not scene.environment_frame[4:].any()
    assert (cosine, sine) == pytest.approx((0, 1), abs=1e-6)
    assert mean == pytest.approx(mean_expected, rel=1e-5)
    assert chance == 1  # there is no other light


@pytest.mark.long
def test_bsdf_sampling_covers_radiance_below_the_mean():
    """Sampling only the environment's luminance above its mean by tables, and the rest by BSDF sampling, yields the same picture.

    It is compared with a picture whose tables contain all luminance.
    """
    ours = compile_scene(described(ellipsoid(), studio_for_accents=True))
    bright = luminance(ours.environment.astype(np.float64))
    rows = bright.sum(axis=1) * -np.diff(np.cos(np.linspace(0, np.pi, len(bright) + 1)))
    everything = seal(
        ours._replace(
            **search_tables(
                np.r_[0, np.cumsum(rows)] / rows.sum(),
                np.insert(np.cumsum(bright, axis=1) / bright.sum(axis=1, keepdims=True), 0, 0, axis=1),
            )
        )
    )
    for depth in (2, 5):
        films = [
            [
                render_frame(s, RenderSettings(24, 24, View((0, 0.5, 4), (0, 0, 0)), max_depth=depth, seed=seed), 64)
                for seed in range(8)
            ]
            for s in (ours, everything)
        ]
        means = [[film.mean(sums, 24).mean(dtype=np.float64) for sums in some] for some in films]
        error = np.sqrt((np.var(means[0], ddof=1) + np.var(means[1], ddof=1)) / 8)
        assert error < 0.002 * np.mean(means[1])
        assert abs(np.mean(means[0]) - np.mean(means[1])) < 4 * error
        noise = [np.mean([film.noise(sums, 24) for sums in some]) for some in films]
        assert noise[0] < 0.9 * noise[1]


def test_environment_choice_follows_power_within_limits():
    half = np.zeros((2, 1, 3), np.float32)
    half[0] = 2  # bright above, black below: mean 1, mean square 2, so half of its power is contrast
    chances = []
    for strength, image in ((0.0, 0), (1e-6, 0), (1.0, 0), (1e6, 0), (1e6, None)):
        description = described(shapes.quad("lamp"), images=[Image("half", half)])
        description.environment = Environment(strength=strength, image=image)
        description.materials = [Material(emission=(1, 1, 1))]
        chances.append(float(compile_scene(description).environment_frame[3]))
    assert chances[0] == 0
    assert chances[1] == pytest.approx(0.1)
    # Sky: pi * pi R^2 with R^2 = 2, halved; lamp: pi * 4 * 1.
    assert chances[2] == pytest.approx(np.pi / (np.pi + 4), rel=1e-5)
    assert chances[3] == pytest.approx(0.8)
    assert chances[4] == pytest.approx(0.1)  # a constant sky is left to BSDF sampling


@pytest.mark.parametrize(("emission", "studio"), [(0.02, True), (10.0, False)])
def test_model_with_weak_lights_gets_studio_lighting(emission, studio):
    description = described(shapes.quad("panel"), studio_for_accents=True)
    description.materials = [Material(emission=(emission,) * 3)]
    scene = compile_scene(description)
    assert scene.environment.any() == studio
    assert bool(description.warnings) == studio


def test_arrays_are_read_only_and_reproducible():
    description = described(ellipsoid(), environment=Environment())
    first, second = compile_scene(description), compile_scene(description)
    for a, b in zip(flat(first).values(), flat(second).values(), strict=True):
        assert a.flags.c_contiguous
        assert not a.flags.writeable
        assert a.tobytes() == b.tobytes()


def test_the_scene_does_not_depend_on_the_number_of_threads():
    """Any number of threads compiles a mesh that is cut into several parts to the same vertices, triangles and tree."""
    rng = np.random.default_rng(6)
    count = 70_000
    positions = (np.repeat(rng.uniform(-1, 1, (count, 3)), 3, axis=0) + rng.normal(0, 0.01, (3 * count, 3))).astype(np.float32)
    normals = rng.standard_normal((3 * count, 3)).astype(np.float32)
    triangles = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    triangles[::7, 1] = triangles[::7, 0]  # zero area
    turned = np.array([[0, -2, 0, 1], [1, 0, 0, 2], [0, 0, 3, 3], [0, 0, 0, 1]], float)
    description = described(Mesh("m", positions, triangles, normals), transforms=[turned], environment=Environment())
    scenes = [compile_scene(description, threads=threads) for threads in (1, 2, 3)]
    assert len(scenes[0].triangle) == count - len(triangles[::7])
    for name, array in flat(scenes[0]).items():
        assert all(flat(scene)[name].tobytes() == array.tobytes() for scene in scenes[1:]), name


def test_zero_normal_becomes_the_mean_face_normal():
    normals = np.array([(0, 0, 2), (0, 0, 0), (np.nan, 0, 0)], np.float32)
    geometry = flatten(described(Mesh("m", np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32), ONE, normals)))
    np.testing.assert_array_equal(geometry.normal, [(0, 0, 1)] * 3)


def test_progress_steps_are_reported_in_order():
    told = []
    compile_scene(described(shapes.quad("a")), lambda step, fraction: told.append((step, fraction)))
    assert [f for _, f in told] == sorted(f for _, f in told)
    assert told[-1][1] == 1.0


def test_summary_ends_with_the_auto_camera():
    description = described(shapes.cube("a"), clips=[Clip("spin", 0.0, 1.5)], warnings=["w"], defaults={"spp": 4})
    description.spheres = [Sphere((4, 0, 0), 1.5)]
    description.cameras = [Camera("front", View((0, 0, 9), (0, 0, 8.5), fov=30))]
    compiled = compile_scene(description)
    summary = summarise(description, compiled)
    assert [c["name"] for c in summary["cameras"]] == ["front", AUTO_CAMERA]
    assert View.from_json(summary["cameras"][0]["view"]) == View((0, 0, 9), (0, 0, 0), fov=30)
    assert summary["bounds"] == [[-1, -1.5, -1.5], [5.5, 1.5, 1.5]]
    assert summary["counts"]["triangles"] == 12
    assert summary["counts"]["spheres"] == 1
    assert (summary["animations"], summary["warnings"], summary["defaults"]) == (["spin"], ["w"], {"spp": 4})
    assert summary["clips"] == [{"name": "spin", "start": 0.0, "end": 1.5}]


def test_moving_the_orbit_target_keeps_the_focus():
    description = described(shapes.cube("a"))
    description.cameras = [Camera("lens", View((0, 0, 9), (0, 0, 8.5), aperture=0.1)), Camera("flat", View((0, 0, 9), (0, 0, 8)))]
    description.cameras[1].view = replace(description.cameras[1].view, projection="orthographic", height=3.0)
    lens, flat, _ = (View.from_json(c["view"]) for c in summarise(description, compile_scene(description))["cameras"])
    assert (lens.target, lens.focus) == ((0, 0, 0), 0.5)
    assert (flat.projection, flat.height, flat.focus) == ("orthographic", 3.0, None)


def test_object_and_material_names_are_in_number_order():
    description = described(shapes.cube("a"), shapes.quad("b"), shapes.quad("c"))
    description.materials = [Material("red"), Material("blue")]
    description.instances[0].name = description.instances[2].name = "table"
    description.spheres = [Sphere((4, 0, 0), 1.0, 0, "ball"), Sphere((7, 0, 0), 1.0, 1, "ball")]
    compiled = compile_scene(description)
    summary = summarise(description, compiled)
    assert summary["objects"] == ["table", "b", "ball", "ball"]
    assert summary["materials"] == ["red", "blue"]
    assert compiled.part[compiled.triangle[:, 3], PART_OBJECT].tolist() == [0] * 12 + [1] * 2 + [0] * 2
    assert compiled.sphere_object.tolist() == [2, 3]


def test_file_camera_may_be_named_auto():
    description = described(shapes.cube("a"))
    description.cameras = [Camera(AUTO_CAMERA, View((0, 0, 9), (0, 0, 0)))]
    names = [c["name"] for c in summarise(description, compile_scene(description))["cameras"]]
    assert names == ["auto (of the file)", AUTO_CAMERA]


@pytest.mark.parametrize("distance", [0.0, 1.0, 1e9, 1e12])
def test_auto_camera_looks_at_a_single_point(distance):
    point = np.full((1, 3), distance)
    view = frame(point)
    assert np.linalg.norm(np.subtract(view.eye, point[0])) > 0
    assert np.allclose(view.target, point[0], rtol=1e-6)


@pytest.mark.parametrize("up", [(0, 1, 0), (0, 0, 1)])
@pytest.mark.parametrize("size", [(5, 1, 2), (1, 1, 4), (1, 6, 1), (6, 0.1, 6)])
def test_auto_camera_centres_all_points_and_fills_most_of_the_picture(up, size):
    points = np.random.default_rng(9).normal(size=(500, 3)) * size
    view = frame(points, up)
    eye, target = np.array(view.eye), np.array(view.target)
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, view.up)
    right /= np.linalg.norm(right)
    above = np.cross(right, forward)
    depth = (points - eye) @ forward
    slope = np.tan(np.radians(view.fov / 2))
    x = (points - eye) @ right / (depth * slope * ASPECT)
    y = (points - eye) @ above / (depth * slope)
    assert depth.min() > 0
    assert max(x.max(), y.max()) == pytest.approx(0.8, abs=1e-6)
    assert x.max() == pytest.approx(-x.min(), abs=1e-9)
    assert y.max() == pytest.approx(-y.min(), abs=1e-9)
