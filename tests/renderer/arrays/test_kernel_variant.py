"""Tests of kernel variants: a scene uses the smallest variant that has all its features, and all variants render one picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer import render
from renderer.arrays import rows
from renderer.arrays.kernel_variant import strip_absent_features, variant_of
from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.bvh.layout import RAY_KINDS
from renderer.film import mean
from renderer.render import render_frame, variant_for
from renderer.scene.compile import compile_scene
from renderer.scene.description import Image, Instance, Light, Material, SceneDescription, Sphere, Texture
from renderer.settings import RenderSettings, View
from tests.renderer.builders import gray, icosphere, square

PLAIN = (
    Material(base_color=gray(0.5)),
    Material(kind="mirror"),
    Material(kind="glass", roughness=0.0),
    Material(kind="metallic_roughness", metallic=0.5, roughness=0.3),
    Material(kind="conductor", roughness=0.3, eta=(0.2, 0.4, 1.4), k=(4.0, 2.4, 1.6)),
)
NEEDS_MORE = {
    "a texture": Material(base_color_texture=0),
    "alpha": Material(opacity=0.5, alpha_mode="blend"),
    "a brushed metal": Material(kind="conductor", roughness=0.3, anisotropy=0.5),
    "layers": Material(kind="metallic_roughness", clearcoat=1.0),
    "coloured glass": Material(kind="glass", roughness=0.0, attenuation_color=(0.5, 0.9, 0.9), attenuation_distance=1.0),
    "a prism": Material(kind="glass", roughness=0.0, dispersion=1.0),
    "a highlight of Blinn's": Material(kind="blinn_phong"),
    "a metal of Beckmann's facets": Material(kind="conductor", roughness=0.3, distribution="beckmann"),
    "plastic": Material(kind="plastic", roughness=0.3),
    "an interface of nothing": Material(kind="interface"),
}


def described(*materials: Material) -> SceneDescription:
    """Returns a scene with a floor of the first material, a ball of each material, and an emissive ball."""
    materials = (*materials, Material(base_color=gray(0.0), emission=gray(5.0)))
    return SceneDescription(
        meshes=[square((0, 0, 0), (5, 0, 0), (0, 0, -5), 0)],
        instances=[Instance(0)],
        spheres=[Sphere((i - 1.0, 0.5, 0.0), 0.4, i) for i in range(len(materials))],
        materials=list(materials),
        images=[Image("white", np.ones((2, 2, 3), np.float32), srgb=False)],
        textures=[Texture(0)],
    )


def test_common_scene_uses_the_plain_variant() -> None:
    assert variant_of(compile_scene(described(*PLAIN))) == "plain"


def test_undeclared_material_kind_is_rejected() -> None:
    scene = compile_scene(described(*PLAIN))
    scene = scene._replace(material_kind=np.full_like(scene.material_kind, len(rows.KINDS)))
    with pytest.raises(ValueError, match=r"kinds \[13\] are not declared; add them to KINDS in renderer/arrays/rows.py"):
        variant_of(scene)


@pytest.mark.parametrize("name", NEEDS_MORE)
def test_feature_selects_a_larger_variant(name: str) -> None:
    assert variant_of(compile_scene(described(NEEDS_MORE[name]))) == "full"


def test_hair_selects_a_variant_with_hair() -> None:
    hair = Material(kind="hair")
    assert variant_of(compile_scene(described(hair))) == "hair"
    assert variant_of(compile_scene(described(hair)), camera_moves=True) == "moving-hair"
    hair = replace(hair, model="huang")
    assert variant_of(compile_scene(described(hair, Material(kind="hair")))) == "huang"
    assert variant_of(compile_scene(described(hair)), camera_moves=True) == "moving-huang"


def test_catchers_of_reflections_select_a_variant_with_them() -> None:
    """Not those of kind unlit, which reflect nothing."""
    catcher = Material(reflection_catcher=True)
    assert variant_of(compile_scene(described(catcher))) == "catchers"
    assert variant_of(compile_scene(described(catcher)), camera_moves=True) == "moving-catchers"
    assert variant_of(compile_scene(described(replace(catcher, kind="unlit")))) == "plain"


def test_punctual_lights_and_instances_select_a_larger_variant() -> None:
    scene = described(PLAIN[0])
    scene.lights.append(Light("point", position=(0, 3, 0)))
    assert variant_of(compile_scene(scene)) == "full"
    scene = described(PLAIN[0])
    scene.meshes.append(icosphere(4))
    for i in range(20):
        place = np.eye(4)
        place[0, 3] = 3.0 * i
        scene.instances.append(Instance(1, place))
    compiled = compile_scene(scene)
    assert len(compiled.to_world) == 20
    assert variant_of(compiled) == "full"


@pytest.mark.parametrize("more", [{"integrator": "whitted"}, {"integrator": "ao"}, {"sampling": "bsdf"}, {"caustics": "on"}])
def test_rare_kernels_have_no_plain_variant(more: dict[str, str]) -> None:
    scene = compile_scene(described(*PLAIN))
    settings = RenderSettings(8, 8, View((0, 0, 5), (0, 0, 0)))
    assert variant_for(settings, scene) == "plain"
    assert variant_for(replace(settings, **more), scene) == "full"


def test_absent_features_are_none_for_the_kernel() -> None:
    scene = compile_scene(described(*PLAIN))
    for name, has in KERNEL_VARIANTS.items():
        given = strip_absent_features(scene, name)
        assert given.has == has
        assert (given.bvh.instances is None) == (has.instances is None)
        assert has.visibility is None or len(given.bvh.ray_roots) == len(RAY_KINDS)


@pytest.mark.parametrize("others", [["full"], pytest.param([*KERNEL_VARIANTS][2:], marks=pytest.mark.long)])
def test_variants_render_the_same_picture(monkeypatch: pytest.MonkeyPatch, others: list[str]) -> None:
    """More than 99 % of the pixels of two kernel variants' pictures agree to a relative error of 1e-3.

    The compiler fuses different operations in each variant, which changes last bits, and so the course of a few paths.
    """
    scene = compile_scene(described(*PLAIN))
    settings = RenderSettings(48, 32, View((0.5, 2.5, 5.0), (0.8, 0.3, 0.0), fov=45), max_depth=6)
    pictures = []
    for name in ("plain", *others):
        monkeypatch.setattr(render, "variant_of", lambda *_, name=name: name)
        pictures.append(mean(render_frame(scene, settings, 8), settings.film_exponent))
    plain, *rest = pictures
    assert plain.mean() > 0.05
    for other in rest:
        same = np.isclose(plain, other, rtol=1e-3, atol=1e-4).all(axis=-1)
        assert same.mean() > 0.99


def test_lamps_in_glass_select_the_variant_with_targets() -> None:
    scene = described(*PLAIN)
    scene.spheres.append(Sphere((1.0, 0.5, 0.0), 0.2, len(PLAIN)))  # in the ball of glass
    compiled = compile_scene(scene)
    settings = RenderSettings(8, 8, View((0, 0, 5), (0, 0, 0)))
    assert variant_for(settings, compiled) == "aimed"
    assert variant_for(replace(settings, views=(settings.view, View((1, 0, 5), (0, 0, 0)))), compiled) == "complete"
    assert variant_for(replace(settings, sampling="mixture"), compiled) == "full"
    assert variant_for(replace(settings, integrator="ao"), compiled) == "full"


def test_motion_selects_a_larger_variant() -> None:
    scene = compile_scene(described(*PLAIN))
    view, further = View((0, 0, 5), (0, 0, 0)), View((1, 0, 5), (0, 0, 0))
    settings = RenderSettings(8, 8, view, shutter=0.5)
    assert variant_for(settings, scene) == "plain"
    assert variant_for(replace(settings, views=(view, further)), scene) == "moving"
    assert variant_for(replace(settings, views=(view, further), integrator="ao"), scene) == "moving"
