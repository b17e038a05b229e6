"""Tests of participating media against closed forms: Beer's law, furnaces, single scattering, Chandrasekhar's half-space."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from renderer.film import ALBEDO, COLOR, DEPTH, NORMAL, mean
from renderer.render import render_frame
from renderer.replay import Replay
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Instance, Light, Material, Medium, Mesh, SceneDescription, Sphere
from renderer.settings import RenderSettings, View
from tests.grids import grid
from tests.renderer.builders import box, gray, square
from tests.renderer.half_space import reflectance
from tests.renderer.judge import assert_mean, limit, mean_and_error

AHEAD = View((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), fov=20.0)
# A view 1 mm wide, so that all rays are nearly the same.
NARROW = View((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), projection="orthographic", height=1e-3)
BALL = (Sphere((0.0, 0.0, 0.0), 1.0, 0),)
BLACK_SKY = Environment(gray(0.0))

pytestmark = pytest.mark.long  # one more kernel to compile


def interface(**medium: Any) -> Material:
    return Material(kind="interface", **medium)


def described(materials: list[Material], spheres: tuple[Sphere, ...] = (), meshes: tuple[Mesh, ...] = (), **more: Any) -> Any:
    return compile_scene(
        SceneDescription(
            materials=materials,
            spheres=list(spheres),
            meshes=list(meshes),
            instances=[Instance(i) for i in range(len(meshes))],
            **{"environment": Environment(gray(1.0)), **more},
        )
    )


def film(scene: Any, view: View = AHEAD, spp: int = 64, **more: Any) -> Any:
    return render_frame(scene, RenderSettings(8, 8, view, **{"max_depth": 1024, **more}), spp)


def seen(scene: Any, view: View = NARROW, spp: int = 1, **more: Any) -> np.ndarray:
    """Returns the mean colour (r, g, b) of a rendered picture."""
    return np.asarray(mean(film(scene, view, spp, **more), 24).reshape(-1, 3).mean(0))


def slab(depth: float, wide: float = 30.0, material: int = 0) -> Mesh:
    """Returns a slab from z = -depth to 0 that extends `wide` to each side."""
    mesh = box(material)
    stretched = mesh.positions * np.array((wide, wide, depth / 2)) - np.array((0.0, 0.0, depth / 2))
    return replace(mesh, positions=stretched.astype(np.float32))


def assert_colors(sums: Any, expected: tuple[float, ...], tests: int = 1, slack: float = 1e-4) -> None:
    """Asserts that each channel's mean over the pixels is within its standard errors of `expected`."""
    pixels = np.asarray(mean(sums, 24)).reshape(-1, 3)
    error = pixels.std(axis=0) / np.sqrt(len(pixels))
    assert (error < 0.02 * np.array(expected)).all(), f"too noisy to judge: {error}"
    off = np.abs(pixels.mean(axis=0) - expected)
    assert (off <= limit(3 * tests) * error + slack * np.array(expected)).all(), (
        f"{pixels.mean(axis=0)} +- {error}, not {expected}"
    )


def test_absorption_follows_beers_law() -> None:
    """Absorption follows Beer's law exactly: without scattering nothing is random."""
    sigma = np.array((0.1, 0.7, 3.0))
    assert seen(described([interface(sigma_a=tuple(sigma))], meshes=(slab(1.5),))) == pytest.approx(
        np.exp(-1.5 * sigma), rel=3e-4
    )
    both = interface(sigma_a=tuple(sigma), attenuation_color=gray(0.5), attenuation_distance=3.0)
    assert seen(described([both], BALL)) == pytest.approx(np.exp(-2 * sigma) * 0.5 ** (2 / 3), rel=3e-4)


def test_nested_media_absorb_separately() -> None:
    """Nested balls in a slab absorb by their own media; a ball of the slab's medium has no effect."""
    a, b, c = 0.2, 0.5, 0.7
    nested = described(
        [interface(sigma_a=gray(a)), interface(sigma_a=gray(b)), interface(sigma_a=gray(c))],
        (Sphere((0, 0, -3), 1.0, 1), Sphere((0, 0, -3), 0.5, 2), Sphere((0, 0, -5), 0.5, 0)),
        (slab(6.0),),
    )
    assert seen(nested) == pytest.approx(gray(np.exp(-4 * a - 1 * b - 1 * c)), rel=3e-4)
    empty = described(
        [interface(sigma_a=gray(a)), Material(kind="glass", base_color=gray(1.0), ior=1.0)],
        (Sphere((0, 0, -3), 1.0, 1),),
        (slab(6.0),),
    )
    assert seen(empty) == pytest.approx(gray(np.exp(-4 * a)), rel=3e-4)


def test_overlapping_bodies_are_left_separately() -> None:
    """In two overlapping bodies, the medium entered last applies until the ray leaves its body, and then the other one again."""
    first, second = interface(sigma_a=gray(0.2)), interface(sigma_a=gray(0.5))
    balls = (Sphere((0, 0, 0.5), 1.0, 0), Sphere((0, 0, -0.5), 1.0, 1))
    assert seen(described([first, second], balls)) == pytest.approx(gray(np.exp(-1 * 0.2 - 2 * 0.5)), rel=3e-4)


@pytest.mark.parametrize("inside", [1, 2, 3])
def test_camera_inside_nested_media(inside: int) -> None:
    """A camera inside any number of concentric balls is in all their media: each attenuates its view."""
    sigma = (0.3, 0.5, 0.8)
    balls = tuple(Sphere((0, 0, 0), 1.0 + k, k) for k in range(inside))
    scene = described([interface(sigma_a=gray(s)) for s in sigma], balls)
    view = View((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), fov=0.1)
    assert seen(scene, view) == pytest.approx(gray(np.exp(-sum(sigma[:inside]))), rel=3e-4)


def test_world_medium_hides_the_environment() -> None:
    sigma = np.array((0.1, 0.2, 0.4))
    world = Medium(sigma_a=tuple(sigma))
    lamp = Material(base_color=gray(0.0), emission=gray(2.0))
    lit = described([lamp], meshes=(square((0, 0, -2), (1, 0, 0), (0, 1, 0), 0),), medium=world)
    assert seen(lit) == pytest.approx(2 * np.exp(-7 * sigma), rel=3e-4)
    aside = described([lamp], (Sphere((0, 50, 0), 1.0, 0),), medium=world)
    assert seen(aside) == pytest.approx(gray(0.0))


def test_shadow_rays_are_attenuated_by_media() -> None:
    """Shadow rays through a ball of smoke above a floor are attenuated by its absorption."""
    floor = square((0, 0, -2), (9, 0, 0), (0, 9, 0), 1)
    lights = [Light("point", gray(10.0), position=(0.0, 0.0, 3.0))]
    sigma = np.array((0.1, 0.4, 1.2))
    view = View((5.0, 0.0, 0.0), (0.0, 0.0, -2.0), fov=0.01)
    without, smoke = (
        described([material, Material(base_color=gray(0.5))], BALL, (floor,), lights=lights, environment=BLACK_SKY)
        for material in (interface(), interface(sigma_a=tuple(sigma)))
    )
    # Shadow rays go straight up from the floor's middle to the light; the camera looks past the ball, below it.
    assert seen(smoke, view, max_depth=2) / seen(without, view, max_depth=2) == pytest.approx(np.exp(-2 * sigma), rel=1e-3)


FURNACES = {
    "fog": interface(sigma_s=(1.0, 2.0, 4.0)),
    "onwards": interface(sigma_s=(1.0, 2.0, 8.0), g=0.8),
    "back": interface(sigma_s=(4.0, 2.0, 0.0), g=-0.5),
    "glass": Material(kind="glass", base_color=gray(1.0), sigma_s=(1.0, 2.0, 3.0), g=0.3),
    "a leaf": Material(
        kind="metallic_roughness", base_color=gray(0.0), specular=0.0, diffuse_transmission=1.0, sigma_s=gray(1.0)
    ),
}


@grid("name", FURNACES, ordinary=("onwards", "glass"))
def test_nonabsorbing_medium_in_a_white_furnace(name: str) -> None:
    """Scattering without absorption is invisible in constant light, for any density and phase function, also in glass."""
    assert_mean(film(described([FURNACES[name]], BALL), spp=128), 1.0, most_error=0.02, tests=len(FURNACES))


def test_camera_inside_nonabsorbing_medium_in_a_white_furnace() -> None:
    view = View((0.1, 0.2, 0.3), (0.0, 0.0, -1.0), fov=70.0)
    assert_mean(film(described([interface(sigma_s=(1.0, 2.0, 4.0), g=0.4)], BALL), view, 128), 1.0)


@pytest.mark.parametrize("g", [0.0, 0.7])
def test_single_scattering_matches_closed_form(g: float) -> None:
    """Single scattering in a slab under a distant light, viewed obliquely, has radiance

    E p(cos) s / u * integral of exp(-t z (1 / u + 1 / v)), where u and v are the cosines of light and view.
    """
    sigma_s, sigma_t = np.array((0.2, 0.5, 1.0)), np.array((0.5, 0.7, 1.5))
    to_light, to_eye = np.array((0.6, 0.0, 0.8)), np.array((-0.28, 0.0, 0.96))
    lights = [Light("directional", gray(3.0), direction=tuple(-to_light))]
    fog = interface(sigma_s=tuple(sigma_s), sigma_a=tuple(sigma_t - sigma_s), g=g)
    scene = described([fog], meshes=(slab(2.0),), lights=lights, environment=BLACK_SKY)
    view = View(tuple(5 * to_eye), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0), projection="orthographic", height=1e-2)
    cosine = -float(to_light @ to_eye)
    phase = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)
    rate = sigma_t * (1 / to_eye[2] + 1 / to_light[2])
    expected = 3.0 * phase * sigma_s / to_eye[2] * (1 - np.exp(-2.0 * rate)) / rate
    assert_colors(film(scene, view, 256, integrator="direct"), tuple(expected), tests=2)


@pytest.mark.parametrize("cosine", [1.0, 0.3])
def test_half_space_reflectance_matches_chandrasekhar(cosine: float) -> None:
    """A half-space under a white sky reflects 1 - sqrt(1 - albedo) H(cosine), Chandrasekhar's solution."""
    albedos = np.array((0.5, 0.9, 0.99))
    deep = described([interface(sigma_s=tuple(albedos), sigma_a=tuple(1 - albedos))], meshes=(slab(300.0, 1e3),))
    eye = (5 * np.sqrt(1 - cosine**2), 0.0, 5 * cosine)
    view = View(eye, (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0), projection="orthographic", height=1e-2)
    expected = [reflectance(albedo, cosine) for albedo in albedos]
    assert_colors(film(deep, view, 256), tuple(expected), tests=2)


SKIN = {"subsurface": 1.0, "subsurface_radius": (1.0, 0.5, 0.2)}
COLORED = (0.2, 0.5, 0.8)
BODIES = {
    "wax": Material(base_color=COLORED, **SKIN),
    "onwards": Material(base_color=COLORED, **SKIN, subsurface_anisotropy=0.8),
    "half": Material(base_color=COLORED, **{**SKIN, "subsurface": 0.5}),
    "white": Material(base_color=(0.95, 0.98, 1.0), **SKIN),
}


@grid("name", BODIES, ordinary=("wax",))
def test_subsurface_reflectance_equals_its_color(name: str) -> None:
    """From afar under a white sky, a body's reflectance equals its subsurface colour within van de Hulst's 2 to 3 per cent."""
    slack = 0.03 if name == "onwards" else 0.02
    body = BODIES[name]
    assert_colors(film(described([body], meshes=(slab(1e3, 1e4),)), spp=256), body.base_color, tests=4, slack=slack)


def test_coat_over_subsurface_equals_coat_over_diffuse() -> None:
    """A body with a clear coat is equally bright with a subsurface base and with a diffuse base of the same colour.

    All light that enters leaves again.
    """
    skin = {"kind": "metallic_roughness", "base_color": COLORED, "roughness": 0.5, "clearcoat": 0.5, "clearcoat_roughness": 0.2}
    bodies = (Material(**skin), Material(**skin, **SKIN), Material(**skin, **{**SKIN, "subsurface": 0.4}))
    without, *others = (film(described([body], meshes=(slab(1e3, 1e4),)), spp=256) for body in bodies)
    expected = tuple(np.asarray(mean(without, 24)).reshape(-1, 3).mean(axis=0))
    for other in others:
        assert_colors(other, expected, tests=2, slack=0.03)


def test_subsurface_transmits_light_through_thin_slabs() -> None:
    """A thin slab transmits light from behind by subsurface scattering."""
    lights = [Light("point", gray(10.0), position=(0.0, 0.0, -4.0))]
    for share, expected in ((0.0, 0.0), (1.0, 0.01)):
        wax = Material(base_color=gray(0.9), subsurface=share, subsurface_radius=gray(0.2))
        behind = described([wax], meshes=(slab(0.2, 2.0),), lights=lights, environment=BLACK_SKY)
        assert seen(behind, spp=64).mean() >= expected


def test_first_hit_is_the_first_scattering_event() -> None:
    dense = described([interface(sigma_s=(3e3, 2e3, 1e3), sigma_a=gray(1e3))], meshes=(slab(2.0),))
    found = np.asarray(film(dense, NARROW, 64)).mean(axis=(1, 2)) * 2.0**-24 / 64
    assert found[ALBEDO] == pytest.approx((3 / 4, 2 / 3, 1 / 2), rel=1e-3)
    assert found[NORMAL] == pytest.approx((0.0, 0.0, 0.0))
    assert found[DEPTH] == pytest.approx(5.0, rel=1e-3)


def test_path_in_fog_is_recorded_by_vertex() -> None:
    from renderer.render import replay

    fog = described([interface(sigma_s=gray(2.0))], BALL)
    settings = RenderSettings(8, 8, AHEAD, max_depth=32)
    told: list[Replay] = [replay(fog, settings, 4, 4, sample) for sample in range(8)]
    vertices = [vertex for path in told for vertex in path.vertices]
    assert {vertex.kind for vertex in vertices} == {"passed", "medium", "missed"}
    for path in told:
        assert path.value is not None
        total = np.sum([np.add(np.add(v.emitted, v.direct), v.beside) for v in path.vertices], axis=0)
        assert total == pytest.approx(path.value, abs=1e-5)
        for vertex in path.vertices:
            if vertex.kind == "medium":
                assert (vertex.object, vertex.material, vertex.normal) == (None, None, None)
                assert vertex.point is not None
                assert np.linalg.norm(vertex.point) <= 1.0


@pytest.mark.parametrize("integrator", ["whitted", "ao"])
def test_integrators_without_media_ignore_them(integrator: str) -> None:
    floor = square((0, 0, -2), (9, 0, 0), (0, 9, 0), 1)
    kinds = interface(sigma_s=gray(2.0)), interface()
    fog, nothing = (described([kind, Material(base_color=gray(0.5))], BALL, (floor,)) for kind in kinds)
    assert np.array_equal(film(fog, spp=4, integrator=integrator)[COLOR], film(nothing, spp=4, integrator=integrator)[COLOR])


@pytest.mark.parametrize("thickness", [0.1, 0.6])
def test_distances_by_the_angle_at_a_lamp_give_the_same_picture_with_less_noise(thickness: float) -> None:
    """A lamp in fog: with and without equiangular sampling the means agree, and in thin fog its variance is lower."""
    floor = square((0, -1, 0), (6, 0, 0), (0, 0, -6), 1)
    lamp = Material(base_color=gray(0.0), emission=gray(60.0))
    world = Medium(sigma_s=(0.5 * thickness, thickness, thickness), sigma_a=gray(0.1 * thickness), g=0.3)
    scene = described(
        [lamp, Material(base_color=gray(0.5))], (Sphere((0.0, 1.3, 0.0), 0.1, 0),), (floor,), medium=world, environment=BLACK_SKY
    )
    assert len(scene.pivot) == 1
    with_it, without = film(scene, spp=512), film(scene._replace(pivot=scene.pivot[:0]), spp=512)
    (a, of_a), (b, of_b) = mean_and_error(with_it), mean_and_error(without)
    assert max(of_a / a, of_b / b) < 0.02
    assert abs(a - b) <= 3 * np.hypot(of_a, of_b)
    assert thickness > 0.5 or of_a < 0.6 * of_b
