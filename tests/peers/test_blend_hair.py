"""Tests that hair of .blend and Alembic files is where Blender has it, as fibres of its shader.

Needs a Python with bpy, which `python3 farm.py peers` installs.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from renderer.scene.load import read
from tests.peers.blender import TO_Y_UP, written_by

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]

SIDES = 6


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Yields the folder written by hair_kit.py; meanwhile, our reader opens .blend files with the Blender that wrote them."""
    with written_by("hair_kit.py", tmp_path_factory.mktemp("hair")) as folder:
        yield folder


def test_hair_curves_and_particle_hair_are_fibres(made: Path) -> None:
    """Axes and diameters of fibres are Blender's, with all children that it renders; their material is hair of its colour."""
    found = read(made, "hair.blend")
    shown = {each.name.split("/")[1]: each for each in found.instances}
    assert shown.keys() == {"Sphere", "Sphere fur", "strands hair", "carrier instance"}
    np.testing.assert_allclose(shown["carrier instance"].transform[:3, 3], (0, 5, 0), atol=1e-6)
    told = np.array(json.loads((made / "told.json").read_text())) @ TO_Y_UP.T
    mesh = found.meshes[shown["Sphere fur"].mesh]
    place = shown["Sphere fur"].transform
    axis = mesh.positions.reshape(*told.shape[:2], SIDES, 3).mean(axis=2) @ place[:3, :3].T + place[:3, 3]
    np.testing.assert_allclose(axis, told, atol=1e-5)
    assert mesh.diameters is not None and mesh.tangents is not None
    widened = np.pi / SIDES / np.sin(np.pi / SIDES)
    ends = mesh.diameters.reshape(*told.shape[:2], SIDES)[:, [0, -1], 0]
    np.testing.assert_allclose(ends, np.broadcast_to((0.02 * widened, 0), ends.shape), atol=1e-6)  # with closed tips
    along = mesh.tangents.reshape(*told.shape[:2], SIDES, 4)[:, 0, 0, :3] @ place[:3, :3].T
    steps = told[:, 1] - told[:, 0]
    np.testing.assert_allclose(along, steps / np.linalg.norm(steps, axis=1, keepdims=True), atol=1e-4)
    for name in ("Sphere fur", "strands hair", "carrier instance"):
        hair = found.materials[found.meshes[shown[name].mesh].material]
        assert hair.kind == "hair" and hair.beta_m == pytest.approx(0.25)
        np.testing.assert_allclose(hair.base_color, (0.5, 0.25, 0.125), rtol=1e-5)
    assert not any("hair" in warning.lower() for warning in found.warnings)


def test_hair_of_alembic_is_read(made: Path) -> None:
    """Curves of an Alembic file become tubes along them."""
    found = read(made, "hair.abc")
    (mesh,) = found.meshes
    axis = mesh.positions.reshape(20, 4, SIDES, 3).mean(axis=2)
    at = np.array([[(0.1 * k, 0.2 * i, -2 + 0.3 * i) for i in range(4)] for k in range(20)]) @ TO_Y_UP.T
    place = found.instances[0].transform
    np.testing.assert_allclose(axis @ place[:3, :3].T + place[:3, 3], at, atol=1e-5)
    assert np.linalg.norm(mesh.positions.reshape(20, 4, SIDES, 3) - axis[:, :, None], axis=3).max() == pytest.approx(
        0.01 * np.pi / SIDES / np.sin(np.pi / SIDES), rel=1e-3
    )
