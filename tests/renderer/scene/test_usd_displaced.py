"""Tests of displacement in USD: heights become slopes along the sides of the mesh."""

import numpy as np
import pytest
from PIL import Image
from pxr import Sdf, UsdShade

from tests.renderer.scene.test_usd_materials import shaded  # noqa: F401
from tests.renderer.scene.usd_files import TYPES, material, texture

F, TOKEN = TYPES.Float, TYPES.Token
STEP = 2 / 255 * 64  # slope of the image per its width


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
def test_heights_are_converted_to_slopes(shaded, heights, look):  # noqa: F811
    found, made = shaded(lambda stage: look(stage, heights, 0.5))
    mesh = found.meshes[0]
    order = np.argsort(mesh.uvs[:, 0])
    wide = np.linalg.norm(np.ptp(mesh.positions[order][[0, -1]], axis=0)[[0]])
    pixels = found.images[found.textures[made.normal_texture].image].pixels
    normal = pixels[4, 20, :3] / (np.iinfo(pixels.dtype).max / 2) - 1
    assert normal[0] / normal[2] * made.normal_scale == pytest.approx(-0.5 * STEP / wide, rel=0.03)
    assert abs(normal[1]) < 0.01
    assert any("Displacement is shown as bumps" in warning for warning in found.warnings)


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
    assert any("Displacement is not supported and left out" in warning for warning in found.warnings)
