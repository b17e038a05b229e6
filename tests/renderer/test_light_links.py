"""Tests of light links: a light illuminates the objects of its link set, and no others, however the light is found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from renderer.errors import SceneError, SettingsError
from renderer.film import COLOR, Sums
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.description import Instance, Light, LightLink, Material, SceneDescription, Sphere
from renderer.scene.load import read
from renderer.scene.object_ids import number_objects
from renderer.settings import RenderSettings, View
from tests.renderer.builders import gray, square
from tests.renderer.judge import limit, mean_and_error

SETTINGS = RenderSettings(32, 16, View((0.0, 6.0, 0.001), (0.0, 0.0, 0.0), fov=40.0), max_depth=2)
LINKS = {"left": LightLink(("left",)), "but left": LightLink(None, ("left",))}


def _pair(light: Light | None = None, link: str = "", **more: Any) -> SceneDescription:
    """Returns two squares side by side, `left` and `right`, below a light.

    light: a light without a surface; None for a glowing ball. link: its link set.
    """
    ball = Material(base_color=gray(0.0), emission=gray(8.0), light_link="" if light else link)
    return SceneDescription(
        meshes=[square((x, 0, 0), (0.9, 0, 0), (0, 0, -0.9), 0) for x in (-1, 1)],
        instances=[Instance(0, name="left"), Instance(1, name="right")],
        spheres=[] if light else [Sphere((0.0, 1.5, 2.0), 0.4, 1)],
        materials=[Material(base_color=gray(0.5)), ball],
        lights=[replace(light, light_link=link)] if light else [],
        light_links=dict(LINKS),
        **more,
    )


def _render(description: SceneDescription, spp: int = 16, **settings: Any) -> Sums:
    return render_frame(compile_scene(description), replace(SETTINGS, **settings), spp)


def _halves(sums: Sums) -> tuple[np.ndarray, np.ndarray]:
    """Returns the colour planes of the left and of the right half of the picture."""
    return sums[COLOR, :, :15], sums[COLOR, :, 17:]


POINT = Light("point", gray(9.0), (0.0, 2.0, 0.0))
SUN = Light("directional", gray(1.0), direction=(0.2, -1.0, 0.1), angle=30.0, seen="always")
SPOT = Light("spot", gray(9.0), (0.0, 3.0, 0.0), radius=0.2, outer_cone=60.0)


@pytest.mark.long
@pytest.mark.parametrize("light", [POINT, SUN, SPOT, None], ids=["point", "sun", "spot", "ball"])
@pytest.mark.parametrize("link", ["left", "but left"])
def test_linked_light_illuminates_its_objects_and_no_others(light: Light | None, link: str) -> None:
    """The objects of the set look as without links, bit by bit; the others are black."""
    every, linked = _halves(_render(_pair(light))), _halves(_render(_pair(light, link)))
    lit, dark = (0, 1) if link == "left" else (1, 0)
    assert (linked[lit] == every[lit]).all()
    assert every[dark].any()
    assert not linked[dark].any()


@pytest.mark.long
def test_linked_light_is_visible_to_the_camera() -> None:
    view = View((0.0, 1.5, 6.0), (0.0, 1.5, 2.0), fov=20.0)
    every, linked = (_render(_pair(None, link), view=view) for link in ("", "left"))
    assert every[COLOR].any()
    assert (every == linked).all()


@pytest.mark.long
@pytest.mark.parametrize("sampling", ["light", "bsdf"])
def test_links_do_not_depend_on_how_light_is_found(sampling: str) -> None:
    """Light sampling and BSDF sampling alone have the mean of their combination, with links and interreflection."""
    description = _pair(None, "left")
    description.meshes.append(square((0, 1, -1), (2, 0, 0), (0, 1, 0), 0))
    description.instances.append(Instance(2, name="wall"))
    description.spheres[0] = replace(description.spheres[0], radius=1.2)
    scene = compile_scene(description)
    settings = replace(SETTINGS, max_depth=4, width=8, height=4)
    settings = replace(settings, sampler="independent")
    (a, a_error), (b, b_error) = (
        mean_and_error(render_frame(scene, replace(settings, sampling=chosen), 4000)) for chosen in ("mis", sampling)
    )
    assert min(a / a_error, b / b_error) > 12
    assert abs(a - b) < limit(2) * np.hypot(a_error, b_error)


@pytest.mark.long
def test_light_behind_a_pane_of_glass_is_linked_to_the_pane() -> None:
    """Light that reaches an object through glass comes from the glass: the link of the glass counts."""
    pane = Material(kind="glass", thin=True)
    description = _pair(None, "left")
    description.materials.append(pane)
    description.meshes.append(square((0, 1, 0), (3, 0, 0), (0, 0, -3), 2))
    description.instances.append(Instance(2, name="pane"))
    description.spheres[0] = replace(description.spheres[0], center=(0.0, 2.5, 0.0), radius=0.5)
    view = View((0.0, 0.5, 3.0), (0.0, 0.0, 0.0), fov=60.0)
    seen = _render(description, 64, view=view, max_depth=6)
    description.light_links["left"] = LightLink(("left", "pane"))
    lit = _render(description, 64, view=view, max_depth=6)
    assert lit[COLOR].sum() > 2 * seen[COLOR].sum()


def test_scene_file_declares_link_sets(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text("""
light_links:
  hero: {include: [ball]}
  rest: {exclude: [ball, floor]}
lights:
  - {type: point, position: [0, 3, 0], light_link: hero}
  - {type: point, position: [0, 3, 0]}
materials: {lamp: {emission: 4, light_link: rest}}
shapes:
  - {type: sphere, name: ball, radius: 1}
  - {type: quad, name: floor, instances: [[{translate: [0, -1, 0]}], [{translate: [0, -2, 0]}]]}
  - {type: quad, name: lamp, material: lamp}
""")
    description = read(tmp_path, "scene.yaml")
    scene = compile_scene(description)
    numbers = dict(zip(number_objects(description).names, scene.object_links.tolist(), strict=True))
    assert numbers == {"floor [0]": 1, "floor [1]": 1, "lamp": 1 | 4, "ball": 1 | 2}
    assert sorted(scene.light_link.tolist()) == [0, 1, 2]  # the quad is one light


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"light_links": {}}, "no link set left"),
        ({"light_links": {"left": LightLink(("lift",))}}, "names lift.*there are left, right"),
        ({"light_links": {"left": LightLink(None, ("lift",))}}, "names lift"),
    ],
)
def test_unknown_names_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        compile_scene(replace(_pair(POINT, "left"), **change))


def test_more_link_sets_than_bits_are_refused() -> None:
    description = _pair(POINT)
    description.light_links = {f"set {k}": LightLink(("left",)) for k in range(32)}
    description.lights = [replace(POINT, light_link=name) for name in description.light_links]
    with pytest.raises(SceneError, match=r"32 link sets.*at most 31"):
        compile_scene(description)


def test_whitted_refuses_light_links() -> None:
    with pytest.raises(SettingsError, match="whitted does not support"):
        _render(_pair(POINT, "left"), 1, integrator="whitted")


@pytest.mark.long
def test_ambient_occlusion_ignores_light_links() -> None:
    every, linked = (_render(_pair(POINT, link), 4, integrator="ao") for link in ("", "left"))
    assert (every == linked).all()
