"""Tests that a scene far from the origin, in every format, is read as the same scene as at the origin, with the same picture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from renderer.film import mean
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.description import SceneDescription
from renderer.scene.load import read
from renderer.settings import RenderSettings, View
from tests.grids import grid
from tests.renderer.scene.far_files import EYE, FILES

FARS = [(447612.4, 5411234.7, 312.8), (4075580.1, 931.25, -4801568.9)]
NEAR = (0.0, 0.0, 0.0)


def _read(folder: Path, name: str, offset: tuple[float, float, float]) -> SceneDescription:
    file, make = FILES[name]
    data = make(offset)
    (folder / file).write_bytes(data if isinstance(data, bytes) else data.encode())
    return read(folder, file)


def _corners(description: SceneDescription) -> np.ndarray:
    """Returns all triangle corners in world space, (n, 3) float64."""
    found = []
    for instance in description.instances:
        mesh, place = description.meshes[instance.mesh], np.asarray(instance.transform, np.float64)
        points = mesh.positions[mesh.triangles.reshape(-1)].astype(np.float64)
        found.append(points @ place[:3, :3].T + place[:3, 3])
    return np.concatenate(found)


def _middle(description: SceneDescription) -> np.ndarray:
    """Returns the centre of all meshes in our axes, whatever the file's axes.

    An offset of the scene changes the centre by this offset.
    """
    corners = _corners(description)
    return (corners.min(axis=0) + corners.max(axis=0)) / 2


def _shape(description: SceneDescription) -> dict[str, np.ndarray]:
    """Returns the values of a scene description, by kind, that a translation of the scene must not change.

    Positions are relative to the centre of all meshes.
    """
    middle = _middle(description)
    views = [camera.view for camera in description.cameras]
    ways = [np.subtract(view.target, view.eye) for view in views]
    places = {
        "corners": _corners(description) - middle,
        "spheres": [np.append(np.subtract(ball.center, middle), ball.radius) for ball in description.spheres],
        "lights": [np.subtract(light.position, middle) for light in description.lights],
        "directions": [light.direction for light in description.lights],
        "intensities": [light.intensity for light in description.lights],
        "eyes": [np.subtract(view.eye, middle) for view in views],
        "ways": [way / np.linalg.norm(way) for way in ways],
        "fields of view": [view.fov for view in views],
    }
    return {name: np.array(values) for name, values in places.items()}


@grid("far", FARS, ordinary=(FARS[1],))
@pytest.mark.parametrize("name", FILES)
def test_far_file_keeps_relative_positions(name, far, tmp_path):
    near, away = _shape(_read(tmp_path, name, NEAR)), _shape(_read(tmp_path, name, far))
    assert len(near["corners"]) >= 3 * 14
    for what, values in near.items():
        np.testing.assert_allclose(away[what], values, atol=1e-6, rtol=1e-6, err_msg=what)


@grid("name", FILES)
def test_far_file_renders_like_its_near_copy(name, tmp_path):
    pictures = []
    for place in (NEAR, FARS[0]):
        description = _read(tmp_path, name, place)
        if description.cameras:
            view = replace(description.cameras[0].view, near=0.0)
        else:
            middle = _middle(description)
            view = View(tuple(np.add(middle, EYE).tolist()), tuple(middle.tolist()))
        compiled = compile_scene(description)
        pictures.append(mean(render_frame(compiled, RenderSettings(24, 18, view, max_depth=3), 16), 24))
    near, away = pictures
    assert near.mean() > 1e-3
    assert near.std() > 0.05 * near.mean()
    assert np.median(np.abs(away - near)) < 1e-4 * near.mean(), "the same, but for samples at edges"
    assert np.sqrt(((away - near) ** 2).mean()) < 0.02 * near.mean()
