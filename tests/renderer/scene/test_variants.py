"""Tests of KHR_materials_variants: the variants are listed, and one of them can be chosen."""

import json

import pytest

from renderer.errors import SceneError
from renderer.scene.compile import compile_scene, summarise
from tests.renderer.scene.builders import VARIANTS, Gltf, shoe


def colors(description):
    return [description.materials[m.material].base_color for m in description.meshes]


@pytest.mark.parametrize(
    ("variant", "color"),
    [(None, (1, 0, 0)), ("beach", (0, 1, 0)), ("night", (0, 0, 1)), ("day", (0, 1, 0)), ("1", (0, 0, 1)), ("0", (0, 1, 0))],
)
def test_variant_is_selected_by_name_or_number(scene, variant, color):
    description = scene("shoe.glb", shoe().glb(), variant=variant)
    assert colors(description) == [color, (0, 0, 0)]
    assert summarise(description, compile_scene(description))["variants"] == ["beach", "night", "day"]
    assert [w for w in description.warnings if "light" not in w] == []


@pytest.mark.parametrize("variant", ["winter", "3", "-1", "²", "1" * 5000, ""])
def test_unknown_variant_error_lists_the_variants(scene, variant):
    with pytest.raises(SceneError, match=r"shoe\.glb has no variant .*; its variants are 0: beach, 1: night, 2: day"):
        scene("shoe.glb", shoe().glb(), variant=variant)


def test_variant_of_a_file_without_variants_is_an_error(scene):
    g = Gltf()
    g.mesh()
    with pytest.raises(SceneError, match=r"a\.glb has no variants; leave the variant out"):
        scene("a.glb", g.glb(), variant="beach")
    with pytest.raises(SceneError, match=r"a.obj has no variants; only glTF and USD files have them. Leave the variant out"):
        scene("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", variant="beach")
    with pytest.raises(SceneError, match=r"s\.yaml has no variants"):
        scene("s.yaml", "shapes: [{type: quad}]", variant="0")


def test_unnamed_variant_is_selected_by_number(scene):
    g = shoe()
    g.root["extensions"][VARIANTS]["variants"][1] = {}
    description = scene("shoe.glb", g.glb(), variant="variant 1")
    assert description.variants == ["beach", "variant 1", "day"]
    assert colors(description)[0] == (0, 0, 1)


@pytest.mark.parametrize(
    ("mappings", "why", "where"),
    [
        (
            [{"material": 9, "variants": [0]}],
            "is 9; valid are 0 to 3",
            "mappings[0].material",
        ),
        ([{"material": 1, "variants": [7]}], "is not a list of numbers from 0 to 2", "mappings[0].variants"),
        ([{"variants": [0]}], "is missing", "mappings[0].material"),
        ("x", "is not a list", "mappings"),
    ],
)
def test_damaged_variant_mappings_cause_warnings(scene, mappings, why, where):
    """With a damaged mapping the primitive keeps its own material, and one warning names the mapping."""
    warnings = scene("shoe.glb", shoe(mappings=mappings).glb(), variant="0").warnings
    (told,) = [warning for warning in warnings if "unusable" in warning]
    assert told.startswith(f"shoe.glb: 1 unusable part is left out ({why}")
    assert told.endswith(f".{where}.")


def test_scene_file_with_two_variants(scene):
    shapes = [{"type": "mesh", "file": "shoe.glb", **chosen} for chosen in ({}, {"variant": "night"}, {"variant": 0})]
    description = scene("s.yaml", json.dumps({"shapes": shapes}), {"shoe.glb": shoe().glb()})
    assert colors(description)[::2] == [(1, 0, 0), (0, 0, 1), (0, 1, 0)]
    assert description.variants == []  # variants of a mesh file are chosen by the scene file
    with pytest.raises(SceneError, match=r"shoe\.glb has no variant 'x'"):
        scene("t.yaml", "shapes: [{type: mesh, file: shoe.glb, variant: x}]")
    with pytest.raises(SceneError, match=r"shapes\[0\]\.variant: is not allowed here"):
        scene("u.yaml", "shapes: [{type: quad, variant: x}]")
