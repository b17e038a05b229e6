"""Tests that values of our readers equal Blender's to 1e-4, for files by Blender's exporters with all features of these.

Needs a Python with bpy, which `python3 farm.py peers` installs. The files are those of values_kit.py. Each joint is checked by
the vertices that only this joint moves.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from renderer.scene.animation import Moment
from renderer.scene.load import Shot
from tests.grids import grid
from tests.peers.blender import TO_Y_UP, written_by
from tests.peers.values import cameras_apart, lights_apart, materials_apart, meshes_apart, soup_apart

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]

ANIMATED = (
    *("gltf.glb", "gltf-instanced.glb", "gltf-separate.gltf"),
    *("fbx.fbx", "fbx-units.fbx", "fbx-all.fbx", "fbx-axes.fbx"),
    *("usd.usdc", "usd-instanced.usda", "usd-centimeters.usdc", "usd-turned.usdc"),
)
SCENES = ("hierarchy", "rig", "instances", "seen", "paints")
AS_SOUP = {
    "obj.obj": TO_Y_UP,
    "obj-axes.obj": np.eye(3),
    "ply.ply": TO_Y_UP,
    "stl.stl": TO_Y_UP @ TO_Y_UP,  # STL has no axis; it is read with Z up
    "stl-text.stl": TO_Y_UP,
}
FIRST = {"gltf": 0, "fbx": 0, "usd": -1, "dae": 0}  # Blender's frame that corresponds to our frame 0

# What the exporter omits or changes: Blender's own importer reads the same, or the format cannot store it.
FLAT = "one matrix for what hangs in others, which cannot be sheared"
HALF = "scales of joints in half precision, as UsdSkel has them"
LOST = {
    ("instances", "fbx"): {"leaf 1: the nearest body is": FLAT},
    ("rig", "usd"): {"skin: the nearest body is 1.": HALF, "at b4: the nearest body is 1.": HALF},
    ("seen", "gltf"): {
        "shifted: shift": "no shift",
        "sharp: ": "no depth of field",
        "plain: field": "lenses that change, unless by pointers",
        ": radius": "points without a body",
        "sun: angle": "the same",
        "spot: full": "a softness of its own",
        **dict.fromkeys(("square: no light", "oblong: no light", "disk: no light"), "no area lights"),
    },
    ("seen", "fbx"): {
        "tall: field": "how a sensor is fitted",
        "sharp: ": "no apertures",
        ": radius": "points without a body",
        "sun: angle": "the same",
        "sharp spot: watts": "a white light comes as 0.8: the template's value is not overwritten",
    },
    ("seen", "usd"): {
        "plan: no camera": "orthographic cameras are not written",
        "disk: watts": "a disk is drawn with 256 corners, whose area is 1e-4 less",
    },
    ("seen", "dae"): {
        "tall: field": "how a sensor is fitted",
        "plain: field": "lenses that change",
        "sharp: ": "no apertures",
        ": radius": "points without a body",
        "sun: angle": "the same",
        "spot: full": "a softness of its own",
    },
}
PLAIN = ("base_color", "metallic", "roughness", "opacity", "emission", "specular")
COAT = ("clearcoat", "clearcoat_roughness")
KNOWN = {
    "gltf.glb": (*PLAIN, *COAT, "transmission", "sheen_roughness", "specular_color", "anisotropy"),
    "fbx.fbx": PLAIN,
    "usd.usdc": (*PLAIN, *COAT, "ior"),
    "obj.obj": (*PLAIN, "ior"),
    "obj-physical.obj": (*PLAIN, *COAT, "ior", "transmission", "anisotropy"),
    "dae.dae": ("base_color", "opacity"),
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Yields the folder written by values_kit.py, and Blender's values."""
    with written_by("values_kit.py", tmp_path_factory.mktemp("values")) as folder:
        yield folder, json.loads((folder / "told.json").read_text())


def unexplained(sentences: Iterator[str], lost: dict[str, str]) -> list[str]:
    return [each for each in sentences if not any(words in each for words in lost)]


@pytest.mark.parametrize("kind", ANIMATED)
@pytest.mark.parametrize("scene", SCENES)
def test_places_lenses_and_lights_are_blenders(scene: str, kind: str, made: tuple[Path, dict[str, Any]]) -> None:
    folder, told = made
    form = kind.split(".")[0].split("-")[0]
    lost = LOST.get((scene, form), {})
    shot = Shot(folder, f"{scene}-{kind}")
    for frame, said in told[scene].items():
        if frame == "materials":
            continue
        found = shot.scene_at(Moment(int(frame) + FIRST[form]))
        apart = unexplained(meshes_apart(found, said), lost)
        apart += unexplained(cameras_apart(found, said), lost) + unexplained(lights_apart(found, said), lost)
        assert apart == [], f"frame {frame}"


@pytest.mark.parametrize("scene", ["hierarchy", "seen", "paints"])  # for bones, even Blender's own importer yields other poses
def test_collada_has_the_places_and_lenses(scene: str, made: tuple[Path, dict[str, Any]]) -> None:
    folder, told = made
    shot = Shot(folder, f"{scene}-dae.dae")
    lost = LOST.get((scene, "dae"), {})
    for frame, said in told[scene].items():
        if frame != "materials":
            found = shot.scene_at(Moment(int(frame)))
            apart = unexplained(meshes_apart(found, said), lost)
            assert apart + unexplained(cameras_apart(found, said), lost) + unexplained(lights_apart(found, said), lost) == []


@grid(("scene", "kind"), [(scene, kind) for scene in SCENES for kind in AS_SOUP if (scene, kind) != ("rig", "ply.ply")])
def test_corners_are_blenders(scene: str, kind: str, made: tuple[Path, dict[str, Any]]) -> None:
    folder, told = made
    assert list(soup_apart(Shot(folder, f"{scene}-{kind}").scene_at(), told[scene]["1"], AS_SOUP[kind])) == []


@pytest.mark.parametrize("kind", KNOWN)
def test_materials_are_blenders(kind: str, made: tuple[Path, dict[str, Any]]) -> None:
    """Materials have Blender's values, except two that Blender's glTF exporter omits: sheen weight, and index of transmission."""
    folder, told = made
    found = Shot(folder, f"paints-{kind}").scene_at()
    lost = {"velvet: ": "its physical extension has one number"} if kind == "obj-physical.obj" else {}
    assert unexplained(materials_apart(found, told["paints"]["materials"], KNOWN[kind]), lost) == []
