"""Tests of the default camera of scenes with a wide, flat floor: it frames what stands on the floor, and cuts nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.scene.compile import camera_dicts
from renderer.scene.default_camera import frame
from renderer.scene.description import Mesh, Sphere
from renderer.scene.standing import standing_box
from tests.renderer.scene.floors import FLOOR, FRAMED_WHOLE, FRAMED_WITHOUT_FLOOR, cuboid, scene


def test_automatic_camera_frames_what_stands_on_a_floor() -> None:
    description = scene(FLOOR, cuboid((-3, 0, -0.7), (-1.6, 1.4, 0.7)), spheres=[Sphere((2.4, 0.7, 0), 0.7)])
    expected = [(-3, 0, -0.7), (3.1, 1.4, 0.7)]
    found = standing_box(description)
    assert found is not None
    np.testing.assert_allclose(found, expected, atol=1e-6)
    corners = np.array([mesh.positions for mesh in description.meshes], np.float64).reshape(-1, 3)
    bounds = np.array([(-4, -0.05, -4), (4, 1.4, 4)])
    view = camera_dicts(description, bounds, corners)[-1]["view"]
    assert np.linalg.norm(np.subtract(view["eye"], view["target"])) < 0.8 * np.linalg.norm(
        np.subtract(frame(corners).eye, frame(corners).target)
    )


def test_floor_with_z_up_and_things_that_sink_into_it() -> None:
    description = scene(cuboid((-9, -9, -0.1), (9, 9, 0)), cuboid((0, 0, -0.04), (1, 1, 2)), up=(0.0, 0.0, 1.0))
    found = standing_box(description)
    assert found is not None
    np.testing.assert_allclose(found, [(0, 0, -0.04), (1, 1, 2)], atol=1e-6)


@pytest.mark.parametrize("parts", FRAMED_WITHOUT_FLOOR)
def test_floor_is_left_out(parts: list[Mesh]) -> None:
    found = standing_box(scene(*parts))
    assert found is not None
    assert np.ptp(found, axis=0).max() < 7


@pytest.mark.parametrize("parts", FRAMED_WHOLE)
def test_other_scenes_are_framed_whole(parts: list[Mesh]) -> None:
    assert standing_box(scene(*parts)) is None
