"""Tests of light paths: their planes add up to the colour, integer by integer, and each holds the light through its lobe."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from renderer import aovs, film, render
from renderer.errors import SettingsError
from renderer.film import COLOR, Sums, group_planes, plane_count
from renderer.jit import entry
from renderer.kernel import accumulate
from renderer.kernel.light_groups import GROUP_ROW
from renderer.kernel.light_paths import (
    EMISSION,
    OTHER_ROWS,
    PathShare,
    add_path_light,
    add_sampled_path_light,
    share_after_vertex,
    store_sampled_share,
    store_share,
)
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Light, Material
from renderer.settings import LIGHT_PATHS, RenderSettings, light_planes
from tests.renderer.kernel.backends.features import VIEW, gray, lamps, made, room

SETTINGS = RenderSettings(40, 30, VIEW, light_paths="on")
_ONE = np.float32(1.0)
PLAIN = ("diffuse", "glass")
FULL = ("textures", "half clear lights", "unlit", "many lights", "lights without a body")


class Rows(NamedTuple):
    """The only field of the kernel's Options that these functions read."""

    groups: Any


def _by_path(sums: Sums, groups: int = 0) -> dict[str, Sums]:
    return {name: sums[group_planes(groups + k)] for k, name in enumerate(LIGHT_PATHS)}


@entry
def _divide(table, options, diffuse, f, wi, is_surface, bounces, sampled):
    """Adds light of 1 to a path whose first vertex scattered it into wi, or of which `sampled` is the light sample."""
    share, row, light = share_after_vertex(diffuse, f, wi, is_surface), np.uint32(0), (_ONE, _ONE, _ONE)
    if sampled:
        store_share(table, row, options, PathShare((_ONE, _ONE, _ONE), _ONE))
        store_sampled_share(table, row, options, share)
        add_sampled_path_light(table, row, options, light, bounces, True)
    else:
        store_share(table, row, options, share)
        add_path_light(table, row, options, light, bounces, EMISSION, True)


def test_light_is_divided_by_the_lobes_of_the_first_vertex() -> None:
    options = Rows(np.uint32(0))
    reflected, transmitted = (0.0, 0.6, 0.8), (0.0, 0.6, -0.8)

    def light(wi: tuple[float, ...], bounces: int, is_surface: bool = True, sampled: bool = False) -> dict[str, list[float]]:
        """Returns the light of each plane with some; half of the red light is diffuse, all of the green, and there is no blue."""
        table = np.zeros((1 + OTHER_ROWS) * GROUP_ROW, np.float32)
        diffuse, f = ((0.25, 0.25, 0.0), (0.5, 0.25, 0.0)) if is_surface else ((0.0,) * 3, (0.5,) * 3)
        vectors = (tuple(map(np.float32, each)) for each in (diffuse, f, wi))
        _divide(table, options, *vectors, is_surface, np.float32(bounces), sampled)
        planes = table.reshape(-1, GROUP_ROW)[1 : 1 + len(LIGHT_PATHS), :3]
        return {name: plane.tolist() for name, plane in zip(LIGHT_PATHS, planes, strict=True) if plane.any()}

    assert light(reflected, 0) == {"emission": [1, 1, 1]}
    assert light(reflected, 1) == {"diffuse_direct": [0.5, 1, 0], "glossy_direct": [0.5, 0, 1]}
    assert light(transmitted, 2) == {"diffuse_indirect": [0.5, 1, 0], "transmission_indirect": [0.5, 0, 1]}
    assert light(reflected, 1, is_surface=False) == {"volume_direct": [1, 1, 1]}
    assert light(transmitted, 3, is_surface=False) == {"volume_indirect": [1, 1, 1]}
    assert light(reflected, 1, sampled=True) == light(reflected, 1)  # at the first vertex the light sample's own share,
    assert light(reflected, 2, sampled=True) == {"diffuse_indirect": [1, 1, 1]}  # then the path's


@pytest.mark.long
@pytest.mark.parametrize("name", [*PLAIN, *FULL, "milk in glass"])
def test_paths_sum_to_the_unchanged_color(name: str) -> None:
    scene, settings = made(name)
    sums = render_frame(scene, replace(settings, light_paths="on"), 4)
    assert sums.shape[0] == plane_count(len(LIGHT_PATHS))
    np.testing.assert_array_equal(sums[: film.CHANNELS], render_frame(scene, settings, 4))
    planes = _by_path(sums)
    np.testing.assert_array_equal(sum(planes.values()), sums[COLOR])
    assert all((plane >= 0).all() for plane in planes.values())
    assert planes["diffuse_direct"].any()
    assert planes["transmission_indirect"].any() == (name in ("glass", "milk in glass"))


@pytest.mark.long
@pytest.mark.parametrize("name", ["textures", "many lights"])
def test_both_backends_have_the_same_bits(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, settings = made(name)
    settings = replace(settings, light_paths="on")
    pool = render_frame(scene, settings, 4)
    monkeypatch.setattr(render, "renderer_of", lambda *_: accumulate._render_special_path)
    monkeypatch.setattr(render, "has_variants", lambda _: False)
    np.testing.assert_array_equal(render_frame(scene, settings, 4), pool)


@pytest.mark.long
def test_planes_equal_renderings_of_their_lobes_alone() -> None:
    """Diffuse light is proportional to the base colour, and glossy light does not depend on it; with max_depth 2 it is direct."""
    spp = 512

    def picture(base: float) -> Sums:
        found = room(
            Material(kind="metallic_roughness", base_color=gray(base), metallic=0.0, roughness=0.3),
            environment=Environment(gray(0.4)),
        )
        found.materials[1] = Material(base_color=gray(0.0))  # the ball sees the lamp and the sky only
        found.lights = [Light("point", (3.0, 3.0, 3.0), (4.0, 4.0, 4.0))]
        return render_frame(compile_scene(found), replace(SETTINGS, max_depth=2), spp)

    grey, black = _by_path(picture(0.6)), picture(0.0)
    ball = black[film.MATERIAL] == 1
    assert ball.any()
    of_black = _by_path(black)
    assert not of_black["diffuse_direct"][:, ball].any()
    ours, theirs = (each["glossy_direct"][:, ball].mean() for each in (grey, of_black))
    assert abs(ours / theirs - 1) < 0.02
    darker = _by_path(picture(0.3))
    ours, theirs = (each["diffuse_direct"][:, ball].mean() for each in (grey, darker))
    assert abs(ours / theirs / 2 - 1) < 0.02
    indirect = sum(plane.sum() for name, plane in grey.items() if name.endswith("_indirect"))
    assert indirect < 0.01 * sum(plane.sum() for plane in grey.values())  # of rays that hit their own facet again


@pytest.mark.long
@pytest.mark.parametrize("lit_by", ["a lamp and the sky", "many lamps"])
def test_light_groups_and_paths_together(lit_by: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each partition adds up to the colour, in both backends, with the planes that it has alone."""
    found = room(Material(base_color=(0.8, 0.5, 0.3), roughness=0.4)) if lit_by == "a lamp and the sky" else lamps(40)
    found.materials[2].light_group, found.environment_group = "key", "sky"
    scene, both = compile_scene(found), replace(SETTINGS, light_groups="key" if lit_by == "many lamps" else "key,sky")
    groups = len(both.group_names)
    sums = render_frame(scene, both, 4)
    assert sums.shape[0] == plane_count(groups + len(LIGHT_PATHS))
    assert all(sums[group_planes(k)].any() for k in range(groups - 1))
    np.testing.assert_array_equal(sum(sums[group_planes(k)] for k in range(groups)), sums[COLOR])
    np.testing.assert_array_equal(sum(_by_path(sums, groups).values()), sums[COLOR])
    paths = render_frame(scene, replace(both, light_groups=""), 4)
    np.testing.assert_array_equal(paths, np.concatenate([sums[: film.CHANNELS], sums[film.CHANNELS + 3 * groups :]]))
    by_group = render_frame(scene, replace(both, light_paths="off"), 4)
    np.testing.assert_array_equal(by_group, sums[: len(by_group)])
    monkeypatch.setattr(render, "renderer_of", lambda *_: accumulate._render_special_path)
    monkeypatch.setattr(render, "has_variants", lambda _: False)
    np.testing.assert_array_equal(render_frame(scene, both, 4), sums)


def test_light_paths_setting_and_its_planes() -> None:
    assert RenderSettings.from_json(SETTINGS.to_json()) == SETTINGS
    assert "light_paths" not in replace(SETTINGS, light_paths="off").to_json()  # an older worker can render it
    assert render.is_for_cards(SETTINGS)
    with pytest.raises(SettingsError, match="light_paths"):
        replace(SETTINGS, integrator="ao")
    with pytest.raises(SettingsError, match="light_paths"):
        replace(SETTINGS, caustics="on")
    planes = light_planes("key", "on")
    assert planes == ("key", "rest", *(f"path:{name}" for name in LIGHT_PATHS))
    assert aovs.parse_names(["path:glossy_direct", "lights"], planes) == ["path:glossy_direct", "light:key", "light:rest"]
    assert aovs.parse_names(["paths"], planes) == [f"path:{name}" for name in LIGHT_PATHS]
    assert aovs.parse_names(aovs.parse_names(["all"], None), planes)[-10:] == [*planes[2:]]
    assert aovs.channels("path:glossy_direct") == ("GlossDir.R", "GlossDir.G", "GlossDir.B")
    assert aovs.planes("path:emission", planes)[0] == group_planes(2).start
    with pytest.raises(SettingsError, match="no light paths"):
        aovs.parse_names(["paths"], ("key", "rest"))
    with pytest.raises(SettingsError, match="there are"):
        aovs.parse_names(["path:warm"], planes)
