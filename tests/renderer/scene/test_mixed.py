"""Tests of replacing a mixture of two materials by one material; tests/peers/test_mitsuba_walls.py renders mixtures."""

from dataclasses import replace

import pytest

from renderer.scene.description import Material
from renderer.scene.readers.material_mix import mix_materials
from tests.renderer.scene.pbrt_files import BALL, HEAD, world

RED, BLUE = Material(base_color=(0.8, 0.2, 0.1)), Material(base_color=(0.0, 0.2, 0.5))
METAL = Material(kind="conductor", eta=(0.2, 0.9, 1.1), k=(3.9, 2.4, 2.2), roughness=0.3)


def test_diffuse_mixtures():
    both = mix_materials(RED, BLUE, 0.25)
    assert (both.kind, both.base_color) == ("diffuse", pytest.approx((0.6, 0.2, 0.2)))
    nothing = Material(opacity=0.0, alpha_mode="blend")
    for made in (mix_materials(nothing, RED, 0.3), mix_materials(RED, nothing, 0.7)):
        assert (made.opacity, made.alpha_mode, made.base_color) == (pytest.approx(0.3), "blend", RED.base_color)
    assert mix_materials(RED, METAL, 0.0) is RED
    assert mix_materials(RED, METAL, 1.0) is METAL


def test_mixture_of_metal_and_diffuse():
    for made in (mix_materials(RED, METAL, 0.3), mix_materials(METAL, RED, 0.7)):
        assert (made.kind, made.metallic, made.roughness, made.specular) == ("metallic_roughness", 0.0, 0.3, pytest.approx(0.3))
        normal_reflectance = ((0.2 - 1) ** 2 + 3.9**2) / ((0.2 + 1) ** 2 + 3.9**2)
        assert made.specular_color[0] * 0.04 == pytest.approx(normal_reflectance)
        assert 0.7 * 0.8 < made.base_color[0] < 0.8  # the paint's share is restored after the metal's reflection


def test_mixture_of_two_glossy_layers_requires_equal_gloss():
    gloss = Material(kind="metallic_roughness", base_color=(0.7, 0.3, 0.2), roughness=0.4)
    same = mix_materials(gloss, replace(gloss, base_color=(0.1, 0.3, 0.2)), 0.5)
    assert (same.specular, same.base_color) == (1.0, pytest.approx((0.4, 0.3, 0.2)))
    assert mix_materials(gloss, METAL, 0.5) is None
    assert mix_materials(gloss, replace(gloss, roughness=0.5), 0.5) is None
    assert mix_materials(RED, Material(kind="glass"), 0.5) is None
    assert mix_materials(replace(RED, base_color_texture=1), replace(BLUE, base_color_texture=2), 0.5) is None
    assert mix_materials(replace(RED, base_color_texture=1), METAL, 0.5).base_color_texture == 1


def test_pbrt_mix_material(scene):
    parts = """MakeNamedMaterial "a" "string type" "diffuse" "rgb reflectance" [.8 .2 .1]
    MakeNamedMaterial "b" "string type" "conductor" "float roughness" 0.1
    MakeNamedMaterial "c" "string type" "dielectric" """
    made = scene("scene.pbrt", world(f'{parts} Material "mix" "string materials" ["a" "b"] "float amount" 0.3 {BALL}', HEAD))
    assert made.materials[0].specular == pytest.approx(0.3)
    assert len(made.warnings) == 1  # the scene has no light
    left = scene("scene.pbrt", world(f'{parts} Material "mix" "string materials" ["a" "c"] {BALL}', HEAD))
    assert any(
        "blends materials that cannot be blended here: the one with the larger weight is rendered" in each
        for each in left.warnings
    )
