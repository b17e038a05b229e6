"""Tests of rendering files, dicts and arrays from Python: the same bits as by the command, and errors with a remedy."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
import trimesh
import yaml

import rayfarm
from rayfarm.library.arguments import parse_arguments
from renderer.errors import SceneError, SettingsError
from tests.helpers import ROOT

CORNELL = ROOT / "scenes" / "cornell-box.yaml"
SMALL = {"width": 32, "height": 24, "max_depth": 4}


def box() -> dict[str, object]:
    """Returns a lit box built from arrays, with a texture, as arguments of `render`."""
    cube = trimesh.creation.box()
    uvs = cube.vertices[:, :2] + 0.5
    return {
        "cameras": [{"eye": [1, 1, 3], "target": [0, 0, 0]}],
        "environment": {"color": np.float32(0.5)},
        "textures": {"half": {"pixels": np.array([[[255, 0, 0], [0, 0, 255]]], np.uint8), "filter": "nearest"}},
        "materials": {"paint": {"texture": "half"}},
        "shapes": [{"type": "mesh", "material": "paint", "positions": cube.vertices, "triangles": cube.faces, "uvs": uvs}],
    }


def test_file_and_dict_give_equal_pictures(tmp_path: Path) -> None:
    image = rayfarm.render(CORNELL, spp=3, **SMALL)
    assert repr(image).startswith("<Image 32x24, 3 of 3 samples")
    assert np.array_equal(image["color"], rayfarm.render(yaml.safe_load(CORNELL.read_text()), spp=3, **SMALL)["color"])
    image.save(tmp_path / "cornell.exr")
    assert rayfarm.render(str(CORNELL), spp=3, aovs="depth", **SMALL).keys() == {"color", "depth"}
    file = oiio.ImageInput.open(str(tmp_path / "cornell.exr"))
    names = file.spec().channelnames
    pixels = file.read_image(oiio.FLOAT)
    file.close()
    assert np.array_equal(pixels[..., names.index("Depth.Z")], image["depth"])
    assert np.array_equal(pixels[..., :3], image["color"])
    assert image._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(KeyError, match="it has color, albedo"):
        image["colour"]


def test_height_is_in_pixels_and_never_that_of_an_orthographic_camera() -> None:
    given = parse_arguments({"width": 64, "height": 48, "ortho_height": 3.5}).picture.given
    assert given["size"] == (64, 48) and given["ortho_height"] == 3.5
    assert "ortho_height" not in parse_arguments({"width": 64, "height": 48}).picture.given


def test_arrays_and_pixels_are_placed_correctly() -> None:
    """The box's front is red on its left half and blue on its right, at the depth computed from the geometry."""
    image = rayfarm.render(box(), width=64, height=48, spp=4, eye=(0, 0, 3), fov=30)
    left, right = image["albedo"][24, 26], image["albedo"][24, 38]
    np.testing.assert_allclose(left, [1, 0, 0], atol=0.02)
    np.testing.assert_allclose(right, [0, 0, 1], atol=0.02)
    assert image["depth"][24, 32] == pytest.approx(2.5, rel=0.01)
    assert image["object"][0, 0] == 0


@pytest.mark.long
def test_progressive_passes_end_in_final_picture() -> None:
    images = list(rayfarm.progressive(CORNELL, spp=8, **SMALL))
    assert [image.is_final for image in images] == [False] * (len(images) - 1) + [True]
    assert images[-1].spp == 8 and images[-1].of == 8
    assert np.array_equal(images[-1]["color"], rayfarm.render(CORNELL, spp=8, **SMALL)["color"])
    for image in rayfarm.progressive(CORNELL, spp=100_000, **SMALL):
        assert image.spp < 100_000
        break
    assert not [thread for thread in threading.enumerate() if thread.name == "rayfarm-passes"]


def test_trimesh_is_rendered() -> None:
    with pytest.warns(rayfarm.SceneWarning, match="no light"):
        image = rayfarm.render(trimesh.creation.icosphere(2), spp=1, **SMALL)
    assert image["object"][12, 16] == 1


def test_point_cloud_is_rendered_as_spheres() -> None:
    with pytest.warns(rayfarm.SceneWarning, match="points are shown as spheres"):
        image = rayfarm.render(trimesh.PointCloud(np.eye(3)), spp=1, environment="even-white", **SMALL)
    assert (image["object"] > 0).any()


@pytest.mark.parametrize(
    ("scene", "settings", "kind", "sentence"),
    [
        (CORNELL, {"sp": 3}, TypeError, "did you mean 'spp'"),
        (CORNELL, {"spp": 0}, SettingsError, "spp is 0; it lies between 1 and"),
        (CORNELL, {"width": 3}, SettingsError, "go together"),
        (CORNELL, {"environment": "nowhere"}, SettingsError, "there is no such file"),
        (CORNELL, {"environment": (1, -1, 1)}, SettingsError, "three numbers from 0"),
        (CORNELL, {"aovs": "depht"}, SettingsError, "known are"),
        (CORNELL, {"camera": "back"}, rayfarm.RayfarmError, "camera"),
        (Path("nowhere.glb"), {}, rayfarm.RayfarmError, "There is no file nowhere.glb"),
        (3, {}, SceneError, "this is int"),
        ({"shapes": [{"type": "mesh", "file": "nowhere.obj"}]}, {}, SceneError, r"scene.shapes\[0\]: there is no file"),
        ({"textures": {"a": {"pixels": np.zeros(3)}}}, {}, SceneError, "scene.textures.a: pixels are"),
        ({"shapes": [{"type": "sphere", "radius": object()}]}, {}, SceneError, r"scene.shapes\[0\].radius is object"),
        ({"type": "scene", "ball": {"type": "sphere"}}, {}, SceneError, "one of Mitsuba's"),
        ({"shapes": [{"type": "spher"}]}, {}, SceneError, "spher"),
        (CORNELL, {"device": "gpu"}, SettingsError, "device is 'gpu'; give 'cpu', 'cuda'"),
        (CORNELL, {"device": "cuda:-1"}, SettingsError, "device is 'cuda:-1'"),
        (CORNELL, {"device": 0}, SettingsError, "device is 0"),
        (CORNELL, {"device": "cuda", "farm": "http://127.0.0.1:1"}, SettingsError, "device is for rendering in this process"),
    ],
)
def test_invalid_arguments_raise_errors_with_advice(
    scene: object, settings: dict[str, object], kind: type[Exception], sentence: str
) -> None:
    with pytest.raises(kind, match=sentence):
        rayfarm.render(scene, **settings)
