"""Tests that scenes/cornell-box.yaml has the contents of Mitsuba's cornell_box()."""

from pathlib import Path

import numpy as np
import pytest

from renderer.film import mean
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings

SCENES = Path(__file__).parents[3] / "scenes"


@pytest.fixture(scope="module")
def theirs():
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    return mitsuba.cornell_box()


@pytest.fixture(scope="module")
def ours():
    return read(SCENES, "cornell-box.yaml")


def test_shapes_match_mitsuba(ours, theirs):
    shapes = {
        name: shape for name, shape in theirs.items() if isinstance(shape, dict) and "to_world" in shape and name != "sensor"
    }
    assert {m.name for m in ours.meshes} == set(shapes)
    for instance in ours.instances:
        mesh = ours.meshes[instance.mesh]
        shape = shapes[mesh.name]
        assert len(mesh.triangles) == {"rectangle": 2, "cube": 12}[shape["type"]]
        np.testing.assert_allclose(instance.transform, np.array(shape["to_world"].matrix), atol=1e-6)
        material = ours.materials[mesh.material]
        assert material.name == ("light" if mesh.name == "light" else shape["bsdf"]["id"])
        assert material.base_color == tuple(theirs[shape["bsdf"]["id"]]["reflectance"]["value"])
        assert material.emission == tuple(shape.get("emitter", {}).get("radiance", {}).get("value", (0, 0, 0)))
        assert material.kind == "diffuse"


def test_camera_matches_mitsuba(ours, theirs):
    sensor = theirs["sensor"]
    view = ours.cameras[0].view
    assert view.fov == sensor["fov"]  # the field of view is along the shorter side; the picture is square
    matrix = np.array(sensor["to_world"].matrix)
    np.testing.assert_allclose(view.eye, matrix[:3, 3], atol=1e-6)
    forward = np.subtract(view.target, view.eye)
    np.testing.assert_allclose(forward / np.linalg.norm(forward), matrix[:3, 2], atol=1e-6)
    np.testing.assert_allclose(view.up, matrix[:3, 1], atol=1e-6)
    assert ours.defaults["max_depth"] == theirs["integrator"]["max_depth"]


def test_scene_has_no_warnings(ours):
    assert ours.warnings == []
    assert ours.environment is None


@pytest.mark.long
def test_mean_radiance_matches_mitsuba(ours):
    """The mean over R, G and B equals Mitsuba's, 0.1471 at depth 8.

    A wider pixel filter also sees beyond the walls, and would lower the mean by 1 %.
    """
    scene = compile_scene(ours)
    means = []
    for seed in range(8):
        settings = RenderSettings(96, 96, ours.cameras[0].view, max_depth=8, filter="box", seed=seed)
        means.append(mean(render_frame(scene, settings, 16), settings.film_exponent).mean(dtype=np.float64))
    standard_error = np.std(means, ddof=1) / np.sqrt(len(means))
    assert standard_error < 0.001 * 0.1471  # so that the next assertion's 0.4 % are four standard errors
    assert np.mean(means) == pytest.approx(0.1471, rel=0.004)
