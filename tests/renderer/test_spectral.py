"""Tests of pictures rendered by wavelength: furnaces with closed forms, and what cannot be combined with `spectral`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer import render
from renderer.arrays.scene import CompiledScene
from renderer.deep import LIGHT
from renderer.errors import SettingsError
from renderer.film import ALPHA_PLANES, COLOR, SAMPLES, alpha, group_planes
from renderer.kernel import accumulate
from renderer.render import RenderStats, is_for_cards, render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Instance, Light, Material, SceneDescription, Sphere, Volume
from renderer.scene.given_spectra import black_body, given_index, given_reflectance
from renderer.scene.observer import DAYLIGHT_WEIGHTS, WAVELENGTHS
from renderer.settings import RenderSettings, View
from tests.renderer.builders import box, gray, scene
from tests.renderer.judge import assert_mean
from tests.renderer.kernel.backends.features import PBR, VIEW, room
from tests.renderer.kernel.bsdf.films import by_matrices
from tests.renderer.kernel.spectrum.colors import at_wavelengths, to_rgb

INSIDE = View((0.3, 0.2, 0.1), (0.9, -0.1, 0.3), fov=70.0)
SETTINGS = RenderSettings(12, 12, INSIDE, max_depth=100, spectral="on")
OTHERS = {"caustics": "on", "guiding": "on"}


@pytest.mark.parametrize("name", OTHERS)
def test_some_settings_are_not_combined_with_spectral(name: str) -> None:
    with pytest.raises(SettingsError, match=f"spectral cannot be combined with the setting {name}"):
        replace(SETTINGS, **{name: OTHERS[name]})


@pytest.mark.parametrize("integrator", ["whitted", "ao"])
def test_spectral_needs_an_estimating_integrator(integrator: str) -> None:
    with pytest.raises(SettingsError, match="spectral needs the integrator path or direct"):
        replace(SETTINGS, integrator=integrator)


def test_cards_render_by_wavelength_with_guides_and_with_caustics() -> None:
    assert is_for_cards(SETTINGS)
    assert is_for_cards(replace(SETTINGS, spectral="off", guiding="on"))
    assert is_for_cards(replace(SETTINGS, spectral="off", caustics="on"))
    assert not is_for_cards(replace(SETTINGS, spectral="off", integrator="ao"))


def test_settings_of_rgb_are_those_of_older_workers() -> None:
    assert "spectral" not in replace(SETTINGS, spectral="off").to_json()
    assert RenderSettings.from_json(SETTINGS.to_json()) == SETTINGS


def _ball(emission: tuple[float, float, float], albedo: tuple[float, float, float]) -> Material:
    return Material(base_color=albedo, emission=emission, double_sided=True)


@pytest.mark.long
def test_grey_furnace_is_as_in_rgb() -> None:
    compiled = scene([_ball((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))], spheres=(Sphere((0, 0, 0), 1.0),))
    assert_mean(render_frame(compiled, SETTINGS, 256), 1.0, slack=1e-4)


@pytest.mark.long
def test_light_in_a_coloured_furnace_is_a_geometric_series_at_each_wavelength() -> None:
    emission, albedo = (0.9, 0.4, 0.2), (0.1, 0.3, 0.85)
    compiled = scene([_ball(emission, albedo)], spheres=(Sphere((0, 0, 0), 1.0),))
    sums = render_frame(compiled, SETTINGS, 1024)
    found = (sums[COLOR] / sums[SAMPLES] / 2.0**SETTINGS.film_exponent).mean(axis=(1, 2))
    light = at_wavelengths([emission], is_light=True)[0] / (1 - at_wavelengths([albedo])[0])
    np.testing.assert_allclose(found, to_rgb(light), rtol=0.005)
    in_rgb = np.array(emission) / (1 - np.array(albedo))
    assert np.abs(found / in_rgb - 1).max() > 0.02  # else this would not test spectra


@pytest.mark.long
@pytest.mark.parametrize("thickness", [420.0, 700.0])
def test_a_soap_film_has_the_color_of_airys_sum(thickness: float) -> None:
    """Compares the mean colour of a ball of soap film under a white sky with the integral over wavelengths and angles."""
    film = Material(
        kind="metallic_roughness",
        base_color=(0.0, 0.0, 0.0),
        metallic=1.0,
        roughness=0.0,
        iridescence=1.0,
        iridescence_ior=1.33,
        iridescence_thickness=(thickness, thickness),
    )
    compiled = scene([film], spheres=(Sphere((0, 0, 0), 1.0),), environment=Environment((1.0, 1.0, 1.0)))
    view = View((0.0, 0.0, 400.0), (0.0, 0.0, 0.0), fov=0.16)  # within the ball's outline, nearly orthographic
    settings = RenderSettings(16, 16, view, max_depth=2, filter="box", spectral="on")
    sums = render_frame(compiled, settings, 512)
    found = (sums[COLOR] / sums[SAMPLES] / 2.0**settings.film_exponent).mean(axis=(1, 2))
    half = 400.0 * np.tan(np.radians(0.08))
    x, y = np.meshgrid(*[(np.arange(64) + 0.5) / 64 * half] * 2)
    cosines = np.sqrt(1 - x**2 - y**2).ravel()
    spectrum = np.mean([by_matrices(1.0, 1.33, thickness, cosine, WAVELENGTHS) for cosine in cosines], axis=0)
    wanted = DAYLIGHT_WEIGHTS @ spectrum
    np.testing.assert_allclose(found, wanted, rtol=0.01, atol=0.002 * wanted.mean())
    assert np.ptp(wanted) > 0.5 * wanted.mean()


def room_over_a_catcher() -> CompiledScene:
    """Returns a room with lights of three groups over a shadow catcher."""
    described = room(Material(**PBR, roughness=0.4))
    described.lights = [Light("point", (9.0, 3.0, 1.0), (1.0, 2.0, 2.0), light_group="key")]
    described.materials[2].light_group, described.environment_group = "ceiling", "sky"
    floor = replace(described.materials[1], shadow_catcher=True)
    described.materials.append(floor)
    described.meshes[0] = replace(described.meshes[0], material=3)
    return compile_scene(described)


@pytest.mark.long
def test_planes_of_spectral_pictures_add_up_to_the_color(monkeypatch: pytest.MonkeyPatch) -> None:
    """Light groups, light paths, deep samples and alpha over a shadow catcher: exactly, and equal in both backends."""
    compiled = room_over_a_catcher()
    planes = {"light_groups": "key,sky", "light_paths": "on", "deep": 8}
    settings = RenderSettings(24, 20, replace(VIEW, fov=70.0), background="transparent", spectral="on", **planes)
    stats, of_one = RenderStats(), RenderStats()
    pool = render_frame(compiled, settings, 8, stats=stats)
    groups = len(settings.group_names)
    for first, count in ((0, groups), (groups, len(settings.light_planes) - groups)):
        parts = sum(pool[group_planes(k)] for k in range(first, first + count))
        np.testing.assert_array_equal(parts, pool[COLOR])
    assert all(pool[group_planes(k)].any() for k in range(groups))
    np.testing.assert_array_equal(stats.deep.sums[:, LIGHT].sum(axis=0), pool[COLOR].sum(axis=(1, 2)))
    off = {"light_groups": "", "light_paths": "off", "deep": 0, "spectral": "off"}
    in_rgb = render_frame(compiled, replace(settings, **off), 8)
    np.testing.assert_array_equal(pool[-ALPHA_PLANES], in_rgb[-ALPHA_PLANES])
    shade, wanted = (alpha(sums, 24, len(settings.light_planes) if sums is pool else 0).mean() for sums in (pool, in_rgb))
    assert shade == pytest.approx(wanted, rel=0.02)
    with monkeypatch.context() as patched:
        patched.setattr(render, "renderer_of", lambda *_: accumulate._render_special_path)
        patched.setattr(render, "has_variants", lambda _: False)
        one = render_frame(compiled, settings, 8, stats=of_one)
    np.testing.assert_array_equal(one, pool)
    np.testing.assert_array_equal(of_one.deep.sums, stats.deep.sums)


@pytest.mark.long
def test_a_grid_attenuates_each_wavelength_by_beers_law() -> None:
    sigma, depth = (0.1, 0.5, 1.5), 2.0
    place = np.diag((8.0, 8.0, depth, 1.0))
    place[:3, 3] = -4.0, -4.0, -depth / 2
    grid = Volume(np.ones((2, 2, 2), np.float32), place)
    body = box(0)
    body.positions[:] *= np.array((3.0, 3.0, depth / 2), np.float32)
    described = SceneDescription(
        meshes=[body],
        instances=[Instance(0)],
        materials=[Material(kind="interface", sigma_a=sigma, volume="even")],
        volumes={"even": grid},
        environment=Environment(gray(1.0)),
    )
    view = View((0.0, 0.0, 50.0), (0.0, 0.0, 0.0), fov=0.5)
    settings = RenderSettings(8, 8, view, max_depth=4, spectral="on")
    sums = render_frame(compile_scene(described), settings, 4096)
    found = (sums[COLOR] / sums[SAMPLES] / 2.0**settings.film_exponent).mean(axis=(1, 2))
    wanted = to_rgb(np.exp(-depth * at_wavelengths([sigma], is_light=True)[0]))
    np.testing.assert_allclose(found, wanted, rtol=0.01)


def room_by_spectra(is_given: bool = True) -> CompiledScene:
    """Returns a lamp with a temperature over surfaces and a metal by spectra. is_given: False leaves the spectra out."""
    described = room(Material(kind="conductor", eta=(0.3, 0.4, 1.4), k=(4.0, 2.4, 1.6), roughness=0.3))
    band = np.where(np.abs(WAVELENGTHS - 540) < 30, 0.8, 0.05)
    green = given_reflectance((0.2, 0.5, 0.1), band)
    lamp, metal = described.materials[2], described.materials[0]
    described.materials[1].base_color, lamp.emission = green.color, (9.0, 5.0, 2.0)
    index = given_index(metal.eta, metal.k, np.linspace(1.5, 0.2, len(band)), np.linspace(2.0, 4.0, len(band)))
    if is_given:
        described.spectra += [green, black_body(lamp.emission, 3500.0), *index]
    return compile_scene(described)


@pytest.mark.long
def test_given_spectra_have_the_same_bits_in_both_backends(monkeypatch: pytest.MonkeyPatch) -> None:
    """The spectra change the picture."""
    given = room_by_spectra()
    settings = RenderSettings(16, 16, VIEW, max_depth=6, spectral="on")
    pool, without = (render_frame(each, settings, 4) for each in (given, room_by_spectra(is_given=False)))
    assert (pool[COLOR] != without[COLOR]).mean() > 0.5
    monkeypatch.setattr(render, "renderer_of", lambda *_: accumulate._render_special_path)
    monkeypatch.setattr(render, "has_variants", lambda _: False)
    np.testing.assert_array_equal(render_frame(given, settings, 4), pool)
