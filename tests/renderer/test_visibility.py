"""Tests of visibility by kind of ray and of shadow links, however light is found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from renderer.arrays.rows import LIGHT_ROOT_BIT
from renderer.bvh.layout import RAY_KINDS
from renderer.errors import SceneError, SettingsError
from renderer.film import COLOR, Sums
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.description import Instance, Light, LightLink, Material, SceneDescription, Sphere
from renderer.scene.load import read
from renderer.scene.material import with_visibility
from renderer.settings import RenderSettings, View
from tests.renderer.builders import gray, icosphere, square
from tests.renderer.judge import limit, mean_and_error

SETTINGS = RenderSettings(16, 16, View((0.0, 6.0, 0.001), (0.0, 0.0, 0.0), fov=30.0), max_depth=2)
DIFFUSE = Material(base_color=gray(0.5))
METAL = Material(kind="metallic_roughness", base_color=gray(0.8), metallic=1.0, roughness=0.5)
MIRROR = Material(kind="mirror", base_color=gray(1.0))
PLASTIC = Material(kind="metallic_roughness", base_color=(0.7, 0.3, 0.1), roughness=0.3)
POINT = Light("point", gray(9.0), (0.0, 3.0, 0.0))
NOT = {"diffuse": DIFFUSE, "glossy": METAL}


def _hidden(material: Material, *kinds: str) -> Material:
    return with_visibility(material, dict.fromkeys(kinds, False))


def _floor(material: Material, *hidden_from: str, blocker: bool = False, **more: Any) -> SceneDescription:
    """Returns a floor below a glowing ball that is hidden from some kinds of rays. blocker: whether a square is in between."""
    glow = _hidden(Material(base_color=gray(0.0), emission=gray(8.0)), *hidden_from)
    meshes, instances = [square((0, 0, 0), (2, 0, 0), (0, 0, -2), 0)], [Instance(0, name="floor")]
    if blocker:
        meshes.append(square((1.5, 0.7, 0.0), (0.6, 0, 0), (0, 0, -1.5), 2))
        instances.append(Instance(1, name="blocker"))
    return SceneDescription(
        meshes=meshes,
        instances=instances,
        spheres=more.pop("spheres", [Sphere((0.0, 1.5, 2.0), 0.5, 1)]),
        materials=[material, glow, Material(base_color=gray(0.2))],
        light_links={"none": LightLink(()), "but blocker": LightLink(None, ("blocker",))},
        **more,
    )


def _render(description: SceneDescription, spp: int = 16, **settings: Any) -> Sums:
    return render_frame(compile_scene(description), replace(SETTINGS, **settings), spp)


def _mean(description: SceneDescription, spp: int, **settings: Any) -> tuple[float, float]:
    return mean_and_error(_render(description, spp, **{"sampler": "independent", **settings}))


def _agree(a: tuple[float, float], b: tuple[float, float], tests: int) -> None:
    assert min(a[0] / a[1], b[0] / b[1]) > 12
    assert abs(a[0] - b[0]) < limit(tests) * np.hypot(a[1], b[1])


@pytest.mark.long
@pytest.mark.parametrize("light", [None, POINT], ids=["ball", "point"])
@pytest.mark.parametrize("kind", ["diffuse", "glossy"])
def test_a_lobe_whose_rays_do_not_see_a_light_receives_none_of_it(kind: str, light: Light | None) -> None:
    """Hides a light from one kind of ray: a material of that lobe alone is black, one of another lobe keeps its bits."""
    for of, material in NOT.items():
        if light is None:
            every, hidden = _render(_floor(material)), _render(_floor(material, kind))
        else:
            every, hidden = (
                _render(_floor(material, spheres=[], lights=[replace(light, hidden_from=kinds)])) for kinds in ((), (kind,))
            )
        assert every[COLOR].any()
        if of == kind:
            assert not hidden[COLOR].any()
        else:
            assert (hidden[COLOR] == every[COLOR]).all()


@pytest.mark.long
def test_mirrors_and_glass_do_not_show_what_their_rays_do_not_see() -> None:
    down = View((0.0, 2.0, -4.0), (0.0, 0.0, 0.0), fov=30.0)  # sees the ball in the mirror
    through = View((0.0, 1.5, -4.0), (0.0, 1.5, 2.0), fov=20.0)
    glass = _floor(Material(kind="glass", thin=True))
    glass.meshes[0] = square((0, 1.5, 0), (2, 0, 0), (0, 2, 0), 0)
    for description, kind, view in ((_floor(MIRROR), "glossy", down), (glass, "transmission", through)):
        every = _render(description, view=view)
        description.materials[1] = _hidden(description.materials[1], kind)
        assert every[COLOR].any()
        assert not _render(description, view=view)[COLOR].any()


@pytest.mark.long
@pytest.mark.parametrize("sampling", ["light", "bsdf"])
@pytest.mark.parametrize("kind", ["diffuse", "glossy"])
def test_visibility_does_not_depend_on_how_light_is_found(sampling: str, kind: str) -> None:
    """Light sampling and BSDF sampling alone have the mean of their combination, with both lobes and interreflection."""
    description = _floor(PLASTIC, kind)
    description.meshes.append(square((0, 1, -1), (2, 0, 0), (0, 1, 0), 0))
    description.instances.append(Instance(1, name="wall"))
    description.spheres[0] = replace(description.spheres[0], radius=0.9)
    scene, settings = compile_scene(description), replace(SETTINGS, max_depth=4, width=8, height=4, sampler="independent")
    a, b = (mean_and_error(render_frame(scene, replace(settings, sampling=chosen), 4000)) for chosen in ("mis", sampling))
    _agree(a, b, 4)


@pytest.mark.long
def test_lobes_add_up() -> None:
    """Plastic under a light hidden from one lobe, plus that hidden from the other, is plastic under the whole light.

    A third object, hidden from one kind, makes paths choose a lobe, which must not change the mean.
    """
    whole, chosen = _floor(PLASTIC), _floor(PLASTIC)
    chosen.meshes.append(square((0, 1, 50), (1, 0, 0), (0, 1, 0), 2))
    chosen.instances.append(Instance(1, name="far away"))
    chosen.materials[2] = _hidden(chosen.materials[2], "glossy")
    both, also = (_mean(each, 2000, splitting=2) for each in (whole, chosen))
    _agree(both, also, 2)
    parts = [_mean(_floor(PLASTIC, kind), 2000) for kind in ("diffuse", "glossy")]
    _agree((parts[0][0] + parts[1][0], float(np.hypot(parts[0][1], parts[1][1]))), both, 2)


@pytest.mark.long
@pytest.mark.parametrize("material", [DIFFUSE, PLASTIC], ids=["diffuse", "plastic"])
@pytest.mark.parametrize("kind", ["ball", "point"])
def test_objects_outside_of_a_shadow_link_block_nothing(material: Material, kind: str) -> None:
    """With a blocker outside of the link the floor is as bright as without it; in the link the blocker casts its shadow.

    The camera does not see the blocker, and paths have one vertex.
    """

    def mean(blocker: bool, link: str) -> tuple[float, float]:
        if kind == "point":
            lights = [replace(POINT, position=(2.0, 1.5, 0.0), shadow_link=link)]
            description = _floor(material, blocker=blocker, spheres=[], lights=lights)
        else:
            description = _floor(material, blocker=blocker)
            description.spheres[0] = replace(description.spheres[0], center=(2.0, 1.5, 0.0))
            description.materials[1] = replace(description.materials[1], shadow_link=link)
        description.materials[2] = _hidden(description.materials[2], "camera")
        return _mean(description, 500)

    free, blocked = mean(False, ""), mean(True, "")
    assert blocked[0] < 0.8 * free[0]
    _agree(mean(True, "but blocker"), free, 4)
    _agree(mean(True, "none"), free, 4)


@pytest.mark.long
def test_instanced_objects_can_be_outside_of_a_shadow_link() -> None:
    """A blocker that is stored once and shown many times is left out of the trees of shadow rays, too."""

    def film(link: str, count: int) -> Sums:
        description = _floor(DIFFUSE, spheres=[], lights=[replace(POINT, shadow_link=link)])
        description.meshes.append(icosphere(5, 2, 0.1))
        for k in range(count):
            place = np.eye(4)
            place[:3, 3] = 0.2 * (k % 8) - 0.7, 1.5, 0.2 * (k // 8) - 0.7
            description.instances.append(Instance(1, place, name="blocker"))
        description.materials[2] = Material(base_color=gray(0.0))
        view = View((0.0, 0.9, 0.001), (0.0, 0.0, 0.0), fov=60.0)  # below the blockers
        scene = compile_scene(description)
        assert (len(scene.to_world) > 0) == (count > 0)
        return render_frame(scene, replace(SETTINGS, view=view), 4)

    free = film("", 0)
    assert (film("but blocker", 64)[COLOR] == free[COLOR]).all()
    assert film("", 64)[COLOR].sum() < 0.7 * free[COLOR].sum()


def test_scene_file_hides_objects_and_links_shadows(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text("""
light_links: {ball: {include: [ball]}}
lights: [{type: point, position: [0, 3, 0], shadow_link: ball, visible_to: [diffuse]}]
materials: {lamp: {emission: 4}}
shapes:
  - {type: sphere, name: ball, radius: 1, visible_to: [camera, shadow, diffuse]}
  - type: group
    visible_to: [diffuse, glossy, transmission, volume]
    shapes: [{type: quad, name: lamp, material: lamp}]
  - {type: quad, name: floor}
""")
    scene = compile_scene(read(tmp_path, "scene.yaml"))
    assert len(scene.bvh.ray_roots) == len(RAY_KINDS) + 1
    roots = dict(zip((*RAY_KINDS, "link"), scene.bvh.ray_roots.tolist(), strict=True))
    assert roots["diffuse"] == 0  # sees all
    assert roots["camera"] == roots["shadow"] != 0  # do not see the lamp
    assert roots["glossy"] == roots["transmission"] == roots["volume"] not in (0, roots["camera"])  # nor these the ball
    assert roots["link"] not in (0, roots["shadow"])
    seen, root = scene.light_visibility & 0b111111, scene.light_visibility >> LIGHT_ROOT_BIT
    assert sorted(zip(seen.tolist(), root.tolist(), strict=True)) == [(0b000111, 6), (0b111111, 1)]


def test_a_scene_without_hidden_objects_has_two_root_nodes() -> None:
    scene = compile_scene(_floor(DIFFUSE))
    assert scene.bvh.ray_roots.tolist() == [0, 0]
    assert len(scene.light_visibility) == 0


def test_unknown_shadow_links_are_refused() -> None:
    description = _floor(DIFFUSE, lights=[replace(POINT, shadow_link="gone")])
    with pytest.raises(SceneError, match="no link set gone"):
        compile_scene(description)


def test_whitted_refuses_visibility_by_kind() -> None:
    with pytest.raises(SettingsError, match="whitted does not support the visibility"):
        _render(_floor(DIFFUSE, "glossy"), 1, integrator="whitted")
