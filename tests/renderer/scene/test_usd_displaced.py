"""Tests of displacement in USD: heights displace the mesh."""

import numpy as np
import pytest
from PIL import Image
from pxr import Sdf, UsdShade

from renderer.scene.displacement.apply import displace
from renderer.scene.frame_reuse import ShotCache
from tests.renderer.scene.test_usd_materials import shaded  # noqa: F401
from tests.renderer.scene.usd_files import TYPES, material, texture

F, TOKEN = TYPES.Float, TYPES.Token


@pytest.fixture
def heights(tmp_path):
    """Returns the name of an image whose heights rise linearly to the right."""
    row = (np.arange(64) * 2).astype(np.uint8)
    Image.fromarray(np.stack([np.tile(row, (8, 1))] * 3, axis=-1)).save(tmp_path / "h.png")
    return "h.png"


def rising(made, file, scale):
    clamp = {"wrapS": (TOKEN, "clamp"), "wrapT": (TOKEN, "clamp")}
    return texture(made, "/look/heights", file, "r", scale=(TYPES.Float4, (scale,) * 4), **clamp)


def preview(made, file, scale):
    look, shader = material(made, "/look", displacement=(F, rising(made, file, scale)))
    look.CreateDisplacementOutput().ConnectToSource(shader.ConnectableAPI(), "displacement")
    return look


def materialx(made, file, scale):
    look, _ = material(made, "/look", "ND_standard_surface_surfaceshader", "mtlx")
    shader = UsdShade.Shader.Define(made, "/look/displacement")
    shader.CreateIdAttr("ND_displacement_float")
    shader.CreateInput("scale", F).Set(scale)
    picture = UsdShade.Shader.Define(made, "/look/picture")
    picture.CreateIdAttr("ND_image_float")
    picture.CreateInput("file", TYPES.Asset).Set(Sdf.AssetPath(file))
    for axis in ("u", "v"):
        picture.CreateInput(f"{axis}addressmode", TYPES.String).Set("clamp")
    shader.CreateInput("displacement", F).ConnectToSource(picture.CreateOutput("out", F))
    look.CreateDisplacementOutput("mtlx").ConnectToSource(shader.ConnectableAPI(), "out")
    return look


@pytest.mark.parametrize("look", [preview, materialx])
def test_heights_displace_the_mesh(shaded, heights, look):  # noqa: F811
    found, made = shaded(lambda stage: look(stage, heights, 0.5))
    before = found.meshes[0]
    made.displacement_rate = 50.0
    mesh = displace(found, ShotCache()).meshes[-1]
    normal = np.cross(*(before.positions[before.triangles[0, k]] - before.positions[before.triangles[0, 0]] for k in (1, 2)))
    height = (mesh.positions - before.positions[0]) @ (normal / np.linalg.norm(normal))
    inside = np.abs(mesh.uvs[:, 0] - 0.5) < 0.49
    expected = 0.5 * 2 / 255 * (64 * mesh.uvs[:, 0] - 0.5)
    np.testing.assert_allclose(height[inside], expected[inside], atol=1e-4)
    assert made.normal_texture is None
    assert not any("isplacement" in warning for warning in found.warnings)


def test_displacement_without_value_causes_no_warning(shaded):  # noqa: F811
    """A displacement output without a value, which exporters always connect, causes no warning."""

    def make(stage):
        look, shader = material(stage, "/look")
        look.CreateDisplacementOutput().ConnectToSource(shader.ConnectableAPI(), "displacement")
        return look

    found, made = shaded(make)
    assert made.normal_texture is None
    assert not any("isplacement" in warning for warning in found.warnings)


def test_constant_displacement_causes_a_warning(shaded):  # noqa: F811
    found, _ = shaded(lambda stage: material(stage, "/look", displacement=(F, 0.25))[0])
    assert any("Displacement that is not by a texture is left out" in warning for warning in found.warnings)
