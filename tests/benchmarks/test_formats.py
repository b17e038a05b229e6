"""Tests of row `formats` of the comparison: the mesh that it writes in each format is read back unchanged."""

import numpy as np
import pytest

from renderer.scene.load import read
from tests.benchmarks.peers.formats import WRITERS
from tests.benchmarks.peers.meshes import displaced_sphere
from tests.benchmarks.peers.targets import TABLE


@pytest.mark.parametrize("name", [name for name in WRITERS if not name.endswith((".blend", ".glb"))])
def test_written_mesh_is_read_back_unchanged(tmp_path, name):
    mesh = displaced_sphere(400)
    WRITERS[name](tmp_path / name, mesh)
    description = read(tmp_path, name)
    (found,) = description.meshes
    assert len(found.triangles) == len(mesh.triangles)
    assert len(found.positions) < 2 * len(mesh.positions)  # corners share vertices
    place = description.instances[0].transform[:3, :3]
    corners = found.positions[found.triangles].astype(float) @ place.T
    size = np.ptp(corners.reshape(-1, 3), axis=0)
    unit = 0.01 if name in ("a.usdc", "a.fbx") else 1.0  # formats without a unit are read as centimetres
    np.testing.assert_allclose(np.sort(size), np.sort(np.ptp(mesh.positions, axis=0)) * unit, rtol=1e-4)


def test_every_format_has_targets():
    wanted = {f"{name}, {what}" for name in WRITERS if name != "a.obj" for what in ("seconds", "bytes each")}
    assert set(TABLE["formats"].lines) == wanted
