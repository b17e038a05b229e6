"""Tests of textures that move while the shutter is open, in files and readers."""

from __future__ import annotations

import base64
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from renderer.scene.animation import Moment
from renderer.scene.compile import compile_scene
from renderer.scene.description import Instance, SceneDescription, Texture
from renderer.scene.load import Shot
from tests.grids import grid
from tests.renderer.builders import square
from tests.renderer.scene.builders import Gltf, clip
from tests.renderer.test_motion_blur import GRAY, UNLIT, described, merged_over_shutter, picture, settings_of, striped

SLIDING_YAML = """
textures: {squares: {checker: {squares: 4, colors: [0.1, 0.9]}, offset: {keys: [[0, [0, 0]], [1, [4, 2]]]}}}
materials: {sheet: {kind: unlit, texture: squares}}
shapes: [{type: quad, material: sheet, transform: [{scale: 2}]}]
environment: {color: 0}
"""


def sliding_glb() -> bytes:
    """Returns a sheet whose texture moves by KHR_texture_transform."""
    g = Gltf()
    squares = np.where(np.indices((4, 4)).sum(0) % 2, 230, 30).astype(np.uint8)
    g.root["extensionsUsed"] = ["KHR_texture_transform", "KHR_materials_unlit"]
    png = io.BytesIO()
    PIL.Image.fromarray(np.stack([squares] * 3, -1)).save(png, "PNG")
    uri = "data:image/png;base64," + base64.b64encode(png.getvalue()).decode()
    info = {"index": g.texture({"uri": uri}), "extensions": {"KHR_texture_transform": {"offset": [0, 0]}}}
    sheet = g.material(pbrMetallicRoughness={"baseColorTexture": info}, extensions={"KHR_materials_unlit": {}})
    corners = np.array([(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)], np.float32)
    uvs = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32)
    g.mesh(corners, np.array([0, 1, 2, 0, 2, 3], np.uint16), material=sheet, TEXCOORD_0=uvs)
    path = "/materials/0/pbrMetallicRoughness/baseColorTexture/extensions/KHR_texture_transform/offset"
    return clip(g, "slide", (path, "pointer", [0, 1], [(0, 0), (4, 2)], "LINEAR")).glb()


@pytest.mark.long
@grid("name", ["sheet.yaml", "sheet.glb"], ordinary=("sheet.glb",))
def test_moving_texture_transforms_are_read(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(SLIDING_YAML.encode() if name.endswith("yaml") else sliding_glb())
    shot = Shot(tmp_path, name)
    moving = shot.over_shutter(Moment(12.0), {"shutter": 1.0})
    assert not any("blurred" in warning for warning in moving.warnings)
    offsets = [(key[2], key[5]) for texture in moving.textures for key in texture.keys]
    np.testing.assert_allclose(offsets, [(2 + k / 24, 1 + k / 48) for k in (-2, -1, 0, 1, 2)], atol=1e-6)
    found = picture(compile_scene(moving), settings_of(size=32), 256)
    moments = [shot.scene_at(Moment(12.0, offset=(k + 0.5) / 48 - 0.5)) for k in range(48)]
    known = np.mean([picture(compile_scene(still), settings_of(size=32), 16) for still in moments], axis=0)
    still = picture(compile_scene(shot.scene_at(Moment(12.0))), settings_of(size=32), 16)
    assert abs(found - known).mean() < 0.01 < 0.02 < abs(still - known).mean()


def test_momentarily_equal_textures_stay_separate() -> None:
    """Textures that are identical at one time but move differently stay separate.

    Readers merge textures that are identical.
    """

    def parting(t: float) -> SceneDescription:
        still, moved = Texture(0), Texture(0, transform=(1.0, 0.0, max(t, 0.0), 0.0, 1.0, 0.0))
        scene = described(meshes=[square((0, 0, 0), (1, 0, 0), (0, 1, 0), UNLIT)], instances=[Instance(0)], images=striped())
        scene.textures = [still] if still == moved else [still, moved]
        for material, number in ((UNLIT, 0), (GRAY, len(scene.textures) - 1)):
            scene.materials[material] = replace(scene.materials[material], base_color_texture=number)
        return scene

    found = merged_over_shutter(parting)
    assert not found.warnings
    standing, sliding = (found.textures[found.materials[k].base_color_texture or 0] for k in (UNLIT, GRAY))
    assert not standing.keys
    assert [key[2] for key in sliding.keys] == [0.0, 0.0, 0.0, 0.25, 0.5]
