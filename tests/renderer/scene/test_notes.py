"""Tests that a scene's warnings are accurate: materials and lights that are replaced cause none."""

import json

import numpy as np
import pytest

from renderer.image.encode import encode
from renderer.scene.compile import compile_scene
from renderer.scene.studio import NO_LIGHTS_WARNING, WEAK_LIGHTS_WARNING
from tests.renderer.scene.builders import Gltf

TILE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
LIT = {"environment": {"color": 1}}
SKY = {"sky.exr": encode(np.ones((2, 4, 3), np.float32), "exr")}


def placed(file, **shape):
    material = {"materials": {"grey": {"color": 0.5}}}
    return json.dumps({**LIT, **material, "shapes": [{"type": "mesh", "file": file, **shape}]})


def missing_texture():
    g = Gltf()
    g.mesh(material=g.material(pbrMetallicRoughness={"baseColorTexture": {"index": g.texture({"uri": "gone.png"})}}))
    return g.glb()


@pytest.mark.parametrize(
    ("file", "data", "note"),
    [
        ("a.obj", TILE, "names no material; the only image beside it, skin.png, is used as its texture"),
        (
            "b.obj",
            "mtllib gone.mtl\nusemtl a\n" + TILE,
            "its material files gone.mtl are not among the files; add them. Rendered in grey until then",
        ),
        ("c.obj", "mtllib c.mtl\nusemtl other\n" + TILE, "no material file defines other"),
        ("d.obj", "mtllib d.mtl\nusemtl a\n" + TILE, "kd bright is unknown"),
        ("e.glb", missing_texture(), "its texture gone.png is not among the files"),
    ],
)
def test_material_warnings_are_dropped_with_a_replaced_material(scene, png, file, data, note):
    others = {file: data, "skin.png": png(1, 2, 3), "c.mtl": "newmtl a\n", "d.mtl": "newmtl a\nKd bright\n"}
    own = scene("own.yaml", placed(file), others)
    assert [note in w for w in own.warnings] == [True]
    replaced = scene("replaced.yaml", placed(file, material="grey"), others)
    assert replaced.warnings == []
    assert replaced.images == []
    both = placed(file).replace(
        '"shapes": [', '"shapes": [' + json.dumps({"type": "mesh", "file": file, "material": "grey"}) + ", "
    )
    assert [note in w for w in scene("both.yaml", both, others).warnings] == [True]


def test_shape_warnings_are_kept_with_a_replaced_material(scene):
    description = scene("s.yaml", placed("a.obj", material="grey"), {"a.obj": TILE + "l 1 2\n"})
    assert [w for w in description.warnings if "have no surface" in w] == description.warnings != []


def test_environment_image_is_not_taken_for_a_texture(scene, png, tmp_path):
    for environment in ("sky.exr", "sky:30,120"):
        alone = scene("a.obj", TILE, SKY, environment=environment)
        assert alone.warnings == []
        assert alone.textures == []
    (tmp_path / "sky.exr").unlink()
    lit = scene("a.obj", TILE, {"photo.png": png(1, 2, 3)}, environment="photo.png")
    assert lit.warnings == []
    assert lit.textures == []
    (tmp_path / "photo.png").unlink()
    textured = scene("a.obj", TILE, {"skin.png": png(1, 2, 3), **SKY}, environment="sky.exr")
    assert "names no material" in textured.warnings[0]
    assert [i.name for i in textured.images] == ["skin.png", "sky.exr"]


def test_given_environment_replaces_the_studio(scene):
    assert scene("a.obj", TILE).warnings == [NO_LIGHTS_WARNING]
    for environment in ("sky.exr", "sky:30,120"):
        assert scene("a.obj", TILE, SKY, environment=environment).warnings == []


def accents():
    """Returns a GLB file of a mesh whose material emits very little light."""
    g = Gltf()
    g.mesh(material=g.material(emissiveFactor=[1e-4, 0, 0]))
    return g.glb()


def test_model_with_accents_and_environment_gets_no_studio(scene):
    weak = scene("a.glb", accents())
    compile_scene(weak)
    assert weak.warnings == [WEAK_LIGHTS_WARNING]
    lit = scene("a.glb", accents(), SKY, environment="sky.exr")
    compile_scene(lit)
    assert lit.warnings == []
