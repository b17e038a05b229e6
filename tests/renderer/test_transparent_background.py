"""Tests of the transparent background: its alpha is the exact coverage, and compositing gives back the opaque picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer import film, render
from renderer.arrays.scene import CompiledScene
from renderer.errors import SettingsError
from renderer.film import COLOR, DEPTH, OBJECT, SAMPLES, Sums, alpha_plane, plane_count
from renderer.kernel import accumulate
from renderer.render import pixel_samples, render_batch, render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Instance, Light, Material, SceneDescription
from renderer.settings import RenderSettings, View, tiles_of
from tests.renderer.builders import gray, icosphere, square
from tests.renderer.kernel.backends.features import made

ALPHA = alpha_plane(0)
ONE = 1 << 24
BALL = View((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), fov=40.0)
SKY = (0.3, 0.5, 0.8)


def ball(material: Material, environment: tuple[float, float, float] = SKY) -> CompiledScene:
    """Returns a ball of radius 1 around the origin before a constant environment."""
    return compile_scene(
        SceneDescription(
            meshes=[icosphere(4)], instances=[Instance(0)], materials=[material], environment=Environment(environment)
        )
    )


def transparent(settings: RenderSettings) -> RenderSettings:
    """Returns the settings with a transparent background."""
    return replace(settings, background="transparent")


def means(sums: Sums, plane: int | slice = COLOR) -> np.ndarray:
    """Returns the means of planes of a film."""
    return film.mean(sums, 24, plane).astype(np.float64)


def test_alpha_counts_the_samples_that_hit_something() -> None:
    """Sample by sample: alpha is 1 where the depth is not 0, else 0; and what is not covered is black."""
    settings = transparent(RenderSettings(24, 16, BALL))
    scene = ball(Material(base_color=gray(0.5)))
    sums = np.zeros((plane_count(0, True), 16, 24), np.int64)
    for sample in range(4):
        (tile,) = tiles_of(24, 16, 32)
        one = render_batch(scene, settings, tile, sample, 1).sums
        np.testing.assert_array_equal(one[ALPHA], np.where(one[DEPTH] > 0, ONE, 0))
        assert not one[COLOR][:, one[DEPTH] == 0].any()
        sums += one
    assert 0 < (sums[ALPHA] % (4 * ONE) != 0).mean() < 0.5
    np.testing.assert_array_equal(render_frame(scene, settings, 4), sums)


def test_a_transparent_picture_over_the_environment_is_the_opaque_one() -> None:
    """Exactly, sample by sample: behind the ball's edge there is the constant environment, and the light on it is the same."""
    settings = RenderSettings(24, 16, BALL)
    scene = ball(Material(base_color=(0.8, 0.5, 0.3)))
    over, opaque = render_frame(scene, transparent(settings), 16), render_frame(scene, settings, 16)
    behind = (over[SAMPLES] * ONE - over[ALPHA])[..., None] * np.array(SKY, np.float32).astype(np.float64)
    composite = np.moveaxis(over[COLOR], 0, -1) + behind
    assert np.abs(composite - np.moveaxis(opaque[COLOR], 0, -1)).max() <= 16  # a rounding per sample
    others = [plane for plane in range(film.CHANNELS) if plane not in (*range(6),)]
    np.testing.assert_array_equal(over[others], opaque[others])


def test_settings_with_a_transparent_background() -> None:
    settings = transparent(RenderSettings(4, 4, BALL))
    assert RenderSettings.from_json(settings.to_json()) == settings
    assert "background" not in RenderSettings(4, 4, BALL).to_json()
    for wrong in ("whitted", "ao"):
        with pytest.raises(SettingsError, match="alpha"):
            replace(settings, integrator=wrong)
    with pytest.raises(SettingsError, match="visible"):
        replace(settings, background="none")


@pytest.mark.parametrize(("groups", "planes"), [(0, 24), (2, 30), (17, 75)])
def test_planes_of_the_alpha_are_the_last(groups: int, planes: int) -> None:
    assert plane_count(groups, True) == planes == alpha_plane(groups) + film.ALPHA_PLANES
    assert film.is_plane_count(planes)
    assert film.is_plane_count(planes - film.ALPHA_PLANES)
    assert not film.is_plane_count(planes - 2)


@pytest.mark.long
@pytest.mark.parametrize(
    "name", ["diffuse", "glass", "textures", "half clear lights", "unlit", "lights without a body", "milk in glass", "fog"]
)
def test_both_backends_have_the_same_bits(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, settings = made(name)
    settings = transparent(settings)
    pool = render_frame(scene, settings, 4)
    monkeypatch.setattr(render, "renderer_of", lambda *_: accumulate._render_special_path)
    monkeypatch.setattr(render, "has_variants", lambda _: False)
    np.testing.assert_array_equal(render_frame(scene, settings, 4), pool)
    assert pool[ALPHA].any()


@pytest.mark.long
def test_alpha_of_a_half_clear_ball() -> None:
    """Both sides let half of the light through: a quarter is uncovered. Glass covers all."""
    settings = transparent(RenderSettings(9, 9, replace(BALL, fov=10.0)))
    clear = ball(Material(base_color=gray(0.5), opacity=0.5, alpha_mode="blend"))
    alpha = means(render_frame(clear, settings, 1024), ALPHA)
    assert abs(alpha.mean() - 0.75) < 4 * np.sqrt(0.75 * 0.25 / (1024 * 81))
    glass = ball(Material(kind="glass", base_color=gray(1.0), roughness=0.0))
    assert (render_frame(glass, settings, 16)[ALPHA] == 16 * ONE).all()


@pytest.mark.long
def test_light_groups_add_up_to_the_colour_before_alpha() -> None:
    scene, settings = made("many lights")
    settings = replace(transparent(settings), light_groups="key")
    with_groups, without = render_frame(scene, settings, 4), render_frame(scene, replace(settings, light_groups=""), 4)
    np.testing.assert_array_equal(
        with_groups[film.CHANNELS : alpha_plane(2)].reshape(2, 3, *with_groups.shape[1:]).sum(axis=0), without[COLOR]
    )
    np.testing.assert_array_equal(with_groups[-film.ALPHA_PLANES :], without[ALPHA:])


@pytest.mark.long
def test_pixel_samples_are_those_of_the_film() -> None:
    scene, settings = made("diffuse")
    settings = transparent(settings)
    values, _ = pixel_samples(scene, settings, 3, 3, 4)
    np.testing.assert_array_equal(values.sum(axis=0), render_frame(scene, settings, 4)[COLOR, 3, 3])


FLOOR = View((0.0, 3.0, 4.0), (0.0, 0.0, 0.0), fov=40.0)


def over_a_floor(floor: Material, ball: Material, has_ball: bool = True) -> CompiledScene:
    """Returns a ball above a floor, under a sun and a dim sky."""
    meshes = [square((0, 0, 0), (0, 0, 4), (4, 0, 0), 0), icosphere(3, material=1, scale=0.6, center=(0.0, 0.9, 0.0))]
    return compile_scene(
        SceneDescription(
            meshes=meshes,
            instances=[Instance(k) for k in range(1 + has_ball)],
            materials=[floor, ball],
            lights=[Light("directional", (3.0, 3.0, 3.0), direction=(0.6, -1.0, -0.3))],
            environment=Environment(gray(0.3)),
        )
    )


def test_a_holdout_cuts_a_hole_into_the_picture() -> None:
    """Sample by sample: black and uncovered where it is met first; everything else, its shadow included, has the same bits."""
    settings, grey = transparent(RenderSettings(24, 16, FLOOR)), Material(base_color=gray(0.5))
    (tile,) = tiles_of(24, 16, 32)
    held = render_batch(over_a_floor(grey, Material(base_color=gray(0.5), holdout=True)), settings, tile, 0, 1).sums
    whole = render_batch(over_a_floor(grey, grey), settings, tile, 0, 1).sums
    hole = whole[OBJECT] == 2
    assert 0.02 < hole.mean() < 0.5
    assert not held[ALPHA, hole].any()
    assert not held[:, hole][[*range(3), DEPTH, OBJECT]].any()
    np.testing.assert_array_equal(held[:, ~hole], whole[:, ~hole])


def test_a_shadow_catcher_covers_as_much_as_its_light_is_blocked() -> None:
    """Against two renders of the direct light on an ordinary floor, with and without the ball."""
    settings = RenderSettings(12, 12, replace(FLOOR, target=(0.9, 0.0, -0.4), fov=12.0), filter="box", integrator="direct")
    white, ball = Material(base_color=gray(0.8)), Material(base_color=gray(0.8), unseen=True)
    spp = 1024
    catcher = render_frame(over_a_floor(replace(white, shadow_catcher=True), ball), transparent(settings), spp)
    assert not catcher[COLOR].any()
    alpha = film.alpha(catcher, 24, 0).astype(np.float64)
    lit = means(render_frame(over_a_floor(white, ball, has_ball=False), settings, spp)).mean(axis=-1)
    shaded = means(render_frame(over_a_floor(white, ball), settings, spp)).mean(axis=-1)
    assert alpha.max() - alpha.min() > 0.5
    assert np.abs(alpha - (1 - shaded / lit)).max() < 0.04
    assert abs((alpha - (1 - shaded / lit)).mean()) < 0.003


@pytest.mark.long
@pytest.mark.parametrize("kind", ["diffuse", "metallic_roughness", "mirror", "glass", "unlit"])
def test_both_backends_have_the_same_bits_of_holdouts_and_catchers(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = transparent(RenderSettings(24, 16, FLOOR))
    floor = Material(kind=kind, base_color=gray(0.7), emission=gray(0.1), shadow_catcher=True)
    scene = over_a_floor(floor, Material(kind=kind, base_color=(0.9, 0.5, 0.2), emission=gray(0.1), holdout=True))
    pool = render_frame(scene, settings, 16)
    monkeypatch.setattr(render, "renderer_of", lambda *_: accumulate._render_special_path)
    monkeypatch.setattr(render, "has_variants", lambda _: False)
    np.testing.assert_array_equal(render_frame(scene, settings, 16), pool)
    assert pool[ALPHA + 1].any()
    assert not pool[COLOR].any()


@pytest.mark.long
def test_light_groups_of_a_shadow_catcher_are_black() -> None:
    settings = replace(transparent(RenderSettings(24, 16, FLOOR)), light_groups="key")
    grey = Material(base_color=gray(0.5), light_group="key")
    sums = render_frame(over_a_floor(replace(grey, shadow_catcher=True), grey), settings, 4)
    groups = sums[film.CHANNELS : alpha_plane(2)].reshape(2, 3, *sums.shape[1:])
    np.testing.assert_array_equal(groups.sum(axis=0), sums[COLOR])
    assert sums[alpha_plane(2) + 1].any()


@pytest.mark.long  # compiles the kernel for reflection catchers
@pytest.mark.parametrize("kind", ["diffuse", "metallic_roughness", "mirror", "glass", "unlit"])
def test_both_backends_have_the_same_bits_of_reflections(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = replace(transparent(RenderSettings(24, 16, FLOOR)), light_groups="key")
    floor = Material(kind=kind, base_color=gray(0.7), roughness=0.2, emission=gray(0.1), reflection_catcher=True)
    scene = over_a_floor(floor, Material(base_color=(0.9, 0.5, 0.2), light_group="key", emission=gray(0.2)))
    pool = render_frame(scene, settings, 16)
    monkeypatch.setattr(render, "renderer_of", lambda *_: accumulate._render_special_path)
    monkeypatch.setattr(render, "has_variants", lambda _: False)
    np.testing.assert_array_equal(render_frame(scene, settings, 16), pool)
    groups = pool[film.CHANNELS : alpha_plane(2)].reshape(2, 3, *pool.shape[1:])
    np.testing.assert_array_equal(groups.sum(axis=0), pool[COLOR])
    on_catcher = (pool[OBJECT] == 1) & (pool[ALPHA + 6] == 0)
    assert pool[COLOR][:, on_catcher].any() == (kind != "unlit")


@pytest.mark.long  # likewise
@pytest.mark.parametrize(
    ("kind", "roughness"), [("diffuse", None), ("metallic_roughness", 0.2), ("mirror", None), ("glass", None)]
)
def test_a_catcher_over_the_floor_is_the_whole_picture(kind: str, roughness: float | None) -> None:
    """A floor that catches shadows and reflections, over the picture of the floor alone, is the picture of both.

    The lights are grey, as a pixel has one alpha. The floor is flat, so it reflects no light that it has reflected already.
    """
    settings = RenderSettings(12, 12, replace(FLOOR, target=(0.5, 0.0, -0.2), fov=25.0), filter="box")
    floor, ball = Material(kind=kind, base_color=gray(0.7), roughness=roughness), Material(base_color=(0.9, 0.5, 0.2))
    whole, plate = (means(render_frame(over_a_floor(floor, ball, has_ball), settings, 1024)) for has_ball in (True, False))
    catcher = replace(floor, shadow_catcher=True, reflection_catcher=True)
    sums = render_frame(over_a_floor(catcher, ball), transparent(settings), 1024)
    alpha = film.alpha(sums, 24, 0).astype(np.float64)[..., None]
    composite = means(sums) + (1 - alpha) * plate
    assert np.abs(plate - whole).max() > 0.1
    assert np.abs(composite - whole).max() < 0.02
    assert abs((composite - whole).mean()) < 3e-4
