"""Tests of light groups: their planes add up to the colour, integer by integer, however a frame is rendered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer import aovs, film, render
from renderer.errors import SceneError, SettingsError
from renderer.film import COLOR, SAMPLES, Sums, group_planes, plane_count
from renderer.jit import entry
from renderer.kernel import accumulate
from renderer.kernel.light_groups import GROUP_ROW, add_sample_by_group, add_to_plane
from renderer.render import render_batch, render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Light, Material, SceneDescription
from renderer.scene.light_groups import names_of
from renderer.scene.load import read
from renderer.settings import RenderSettings, check_light_groups, tiles_of
from tests.renderer.kernel.backends.features import GROUPS, VIEW, gray, grouped, made, room

SETTINGS = RenderSettings(40, 30, VIEW)
SCALE = np.float32(2.0**24)
PLAIN = ("diffuse", "glass", "nothing but a sky", "a clamp", "long paths")
FULL = ("textures", "half clear lights", "unlit", "copies", "many lights", "lights without a body", "lights with pictures")


@entry
def _split(planes, table, count, radiance):
    for k in range(len(radiance)):
        place, row = np.uintp(k), np.uintp(2 * count * k)
        light = radiance[k, 0], radiance[k, 1], radiance[k, 2]
        add_sample_by_group(
            planes, place, np.uintp(len(radiance)), table, row, row + np.uintp(count), count, light, SCALE, add_to_plane
        )


def _settings(name: str, groups: str = ",".join(GROUPS)) -> RenderSettings:
    return replace(made(name)[1], light_groups=groups)


def _lit_by(*lights: Light) -> SceneDescription:
    """Returns a room with these lights, in which nothing else shines."""
    found = room(Material())
    found.materials[2].emission = (0.0, 0.0, 0.0)
    return replace(found, lights=[*lights], environment=None)


def _total(sums: Sums) -> Sums:
    return sums[film.CHANNELS :].reshape(-1, 3, *sums.shape[1:]).sum(axis=0)


@pytest.mark.parametrize("count", [1, 2, 5, 17])
def test_the_groups_of_a_sample_add_up_to_its_colour(count: int) -> None:
    """Also if sums are far above the film's limit, negative, or differ from the colour by the rounding of float32."""
    random = np.random.default_rng(count)
    samples = 400
    light = (random.random((samples, 2, count, 3)) ** 8 * 10.0 ** random.integers(-6, 8, (samples, 1, 1, 3))).astype(np.float32)
    light[random.random(light.shape) < 0.5] = 0
    light[:20] *= -1
    light[20:60] *= random.choice([-1, 1], light[20:60].shape)
    table = np.zeros((samples, 2, count, GROUP_ROW), np.float32)
    table[..., :3] = light
    radiance = light.sum(axis=(1, 2), dtype=np.float32)
    planes = np.zeros((count, 3, samples), np.int64)
    shape = (GROUP_ROW, -1) if count == 17 else (-1,)  # a graphics card's table has two dimensions
    _split(planes.reshape(-1), table.reshape(shape), count, radiance)
    colour = np.rint(np.clip(radiance, -film.SAMPLE_MAX, film.SAMPLE_MAX).astype(np.float64) * 2.0**24).astype(np.int64)
    assert (planes.sum(axis=0) == colour.T).all()
    of_groups = (light[:, 0] + light[:, 1]).transpose(1, 2, 0)
    assert (planes[of_groups == 0] == 0).all()
    assert (planes[..., 60:] >= 0).all()
    inside = np.abs(light).sum(axis=(1, 2)).max(axis=1) < film.SAMPLE_MAX
    off = np.abs(planes - of_groups.astype(np.float64) * 2.0**24)[..., inside]
    # Rounding of float32 sums of 2 * count + 2 terms; the scale, 2**24, and the relative error, 2**-24, cancel.
    unsure = np.abs(light).sum(axis=(1, 2)).T[:, inside] * (2 * count + 2)
    assert (off <= 1 + unsure).all()


@pytest.mark.long
@pytest.mark.parametrize("name", [*PLAIN, *FULL, "milk in glass"])
def test_groups_sum_to_the_unchanged_color(name: str) -> None:
    scene, settings = grouped(name), _settings(name)
    sums = render_frame(scene, settings, 4)
    assert sums.shape[0] == plane_count(4) == film.CHANNELS + 12
    np.testing.assert_array_equal(sums[: film.CHANNELS], render_frame(scene, replace(settings, light_groups=""), 4))
    np.testing.assert_array_equal(_total(sums), sums[COLOR])
    alone = render_frame(scene, replace(settings, light_groups="sky"), 4)
    np.testing.assert_array_equal(_total(alone), sums[COLOR])
    assert sum(sums[group_planes(k)].any() for k in range(4)) > (name != "nothing but a sky")


@pytest.mark.long
@pytest.mark.parametrize("size", [7, 16, 40])
def test_groups_do_not_depend_on_batches_and_threads(size: int) -> None:
    """Random tiles, ranges of samples in any order, any number of threads."""
    scene, settings = grouped("many lights"), _settings("many lights")
    whole = render_frame(scene, settings, 6, threads=1)
    np.testing.assert_array_equal(render_frame(scene, settings, 6, threads=3), whole)
    work = [(tile, first, count) for tile in tiles_of(settings.width, settings.height, size) for first, count in ((0, 1), (1, 5))]
    sums = np.zeros_like(whole)
    for k in np.random.default_rng(size).permutation(len(work)):
        tile, first, count = work[k]
        sums[:, tile.y : tile.y + tile.h, tile.x : tile.x + tile.w] += render_batch(scene, settings, tile, first, count).sums
    np.testing.assert_array_equal(sums, whole)


@pytest.mark.long
@pytest.mark.parametrize("name", ["many lights", "textures"])
def test_both_backends_have_the_same_bits(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pool = render_frame(grouped(name), _settings(name), 4)
    monkeypatch.setattr(render, "renderer_of", lambda *_: accumulate._render_special_path)
    monkeypatch.setattr(render, "has_variants", lambda _: False)
    np.testing.assert_array_equal(render_frame(grouped(name), _settings(name), 4), pool)


@pytest.mark.long
def test_group_equals_rendering_with_its_lights_alone() -> None:
    """The mean of a group equals a rendering in which all other lights are switched off."""
    spp = 1024

    def described(lit: str) -> SceneDescription:

        found = room(Material(base_color=(0.8, 0.5, 0.3)))
        found.materials[2].light_group, found.environment_group = "key", "sky"
        found.lights = [Light("point", (3.0, 3.0, 3.0), (1.0, 2.0, 2.0), light_group="point")]
        if lit not in ("", "key"):
            found.materials[2].emission = (0.0, 0.0, 0.0)
        if lit not in ("", "point"):
            found.lights = []
        if lit not in ("", "sky"):
            found.environment = Environment(gray(0.0))
        return found

    settings = replace(SETTINGS, light_groups="key,point,sky")
    sums = render_frame(compile_scene(described("")), settings, spp)
    for k, name in enumerate(("key", "point", "sky")):
        alone = render_frame(compile_scene(described(name)), SETTINGS, spp)
        ours, theirs = (film.mean(s, 24, planes) for s, planes in ((sums, group_planes(k)), (alone, COLOR)))
        assert abs(ours.mean() / theirs.mean() - 1) < 0.01, name
        error = np.abs(ours - theirs).mean(axis=2)
        assert np.median(error) < 0.05 * theirs.mean(), name
    assert not sums[group_planes(3)].any()


def test_the_groups_of_a_scene_file_are_compiled(tmp_path) -> None:
    text = """
environment: {color: 0.2, light_group: sky}
lights:
  - {type: point, position: [0, 2, 0], light_group: key}
  - {type: point, position: [0, 3, 0]}
materials: {lamp: {color: 0, emission: 3, light_group: practical}, wall: {color: 0.5}}
shapes:
  - {type: sphere, center: [0, 0, 0], radius: 1, material: lamp}
  - {type: quad, material: wall}
"""
    (tmp_path / "s.yaml").write_text(text)
    scene = compile_scene(read(tmp_path, "s.yaml"))
    assert names_of(scene) == ["key", "practical", "sky"]
    assert scene.environment_group.tolist() == [3]
    assert sorted(scene.light_group.tolist()) == [0, 1, 2]
    sphere = len(scene.triangle)
    assert scene.light_group[scene.light_primitive == sphere].tolist() == [2]
    for wrong in ("a.b", " x", "n" * 41):
        (tmp_path / "s.yaml").write_text(text.replace("practical", f'"{wrong}"'))
        with pytest.raises(SceneError):
            read(tmp_path, "s.yaml")


def test_each_lamp_is_a_group_in_a_scene_that_names_none(tmp_path) -> None:
    text = """
environment: {color: 0.2}
lights: [{type: point, position: [0, 2, 0]}, {type: point, position: [0, 3, 0]}]
materials: {"lamp.1": {color: 0, emission: 3}, unused: {color: 0, emission: 3}, wall: {color: 0.5}}
shapes:
  - {type: sphere, center: [0, 0, 0], radius: 1, material: lamp.1}
  - {type: quad, material: wall}
"""
    (tmp_path / "s.yaml").write_text(text)
    scene = compile_scene(read(tmp_path, "s.yaml"))
    names = names_of(scene)
    assert names == ["environment", "lamp_1", "light 0", "light 1"]
    assert scene.environment_group.tolist() == [1]
    assert sorted(scene.light_group.tolist()) == [2, 3, 4]
    assert replace(SETTINGS, light_groups=",".join(names)).group_names == (*names, "rest")
    (tmp_path / "s.yaml").write_text(text.replace("[0, 3, 0]}", "[0, 3, 0], light_group: key}"))
    assert names_of(compile_scene(read(tmp_path, "s.yaml"))) == ["key"]


def test_lamps_beyond_the_limit_and_odd_names() -> None:
    """The setting takes the names of every scene: at most 16, none of them reserved."""
    lamps = [
        Light("point", name=name) for name in ("rest", "environment", "", " a/b ", "x" * 50, *(f"lamp {k}" for k in range(20)))
    ]
    scene = compile_scene(replace(_lit_by(*lamps), environment=Environment((1.0, 1.0, 1.0))))
    names = names_of(scene)
    assert {"lamp", "a_b", "x" * 40, "environment"} < set(names)
    assert len(names) == 16
    assert replace(SETTINGS, light_groups=",".join(names)).group_names == (*names, "rest")
    assert names_of(compile_scene(replace(_lit_by(), environment=Environment((1.0, 1.0, 1.0))))) == []


def test_light_groups_setting_is_parsed() -> None:
    settings = replace(SETTINGS, light_groups=" key ,  Fenster süd,b_2-c ")
    assert settings.light_groups == "key,Fenster süd,b_2-c"
    assert settings.group_names == ("key", "Fenster süd", "b_2-c", "rest")
    assert RenderSettings.from_json(settings.to_json()) == settings
    assert SETTINGS.group_names == ()
    assert "light_groups" not in SETTINGS.to_json()  # an older worker can render it
    for wrong in ("a,a", ",".join("abcdefghijklmnopq"), "a,,b", "a.b", "x" * 41, "rest"):
        with pytest.raises(SettingsError):
            replace(SETTINGS, light_groups=wrong)
    with pytest.raises(SettingsError, match="integrator"):
        replace(SETTINGS, light_groups="a", integrator="ao")
    assert render.is_for_cards(settings)


def test_names_of_groups_as_aovs() -> None:
    groups = ("key", "rest")
    assert aovs.parse_names(["lights"], groups) == ["light:key", "light:rest"]
    assert aovs.parse_names(["light:key", "depth", "lights"], groups) == ["light:key", "depth", "light:rest"]
    assert aovs.parse_names(["all"], groups) == [*aovs.AOVS, "light:key", "light:rest"]
    assert aovs.parse_names(aovs.parse_names(["all"], None), groups) == [*aovs.AOVS, "light:key", "light:rest"]
    assert aovs.channels("light:key") == ("Combined_key.R", "Combined_key.G", "Combined_key.B")
    with pytest.raises(SettingsError, match="it has key, rest"):
        aovs.parse_names(["light:fill"], groups)
    with pytest.raises(SettingsError, match="no light groups"):
        aovs.parse_names(["lights"])
    sums = np.zeros((plane_count(2), 2, 3), np.int64)
    sums[SAMPLES], sums[group_planes(1)] = 2, 3 << 24
    assert (aovs.values(sums, 24, "light:rest", groups) == 1.5).all()
    assert not aovs.values(sums, 24, "light:key", groups).any()
    assert aovs.planes("light:rest", groups) == (*range(film.CHANNELS + 3, film.CHANNELS + 6), SAMPLES)


def test_groups_and_caustics_are_not_combined() -> None:
    with pytest.raises(SettingsError, match="light_groups cannot be combined with caustics"):
        replace(made("diffuse")[1], light_groups="key", caustics="on")


def test_unknown_group_error_lists_the_groups() -> None:
    check_light_groups("", [])
    check_light_groups("key,fill", ["fill", "key", "rim"])
    with pytest.raises(SettingsError, match="names kye, which no light of the scene has; it has key, rim"):
        check_light_groups("key,kye", ["key", "rim"])
    with pytest.raises(SettingsError, match="no light of the scene has a light_group"):
        check_light_groups("key", [])
