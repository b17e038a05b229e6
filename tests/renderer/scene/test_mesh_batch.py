"""Tests that small meshes compiled together equal each mesh compiled alone, to the bit."""

import numpy as np
import pytest

from renderer.scene import geometry
from renderer.scene.description import Instance, Material, Mesh, SceneDescription
from renderer.scene.normals import smoothed, smoothed_together

SHAPES = 40


def shapes(rng, bare=False):
    """Returns small meshes, some with second UVs, colours or triangles without area; 1 % of the normals are invalid.

    bare: leaves out the normals.
    """
    found = []
    for i in range(SHAPES):
        count = int(rng.integers(4, 30))
        positions = rng.integers(-2, 3, (count, 3)).astype(np.float32) / np.float32(3)
        mesh = Mesh(f"m{i}", positions, rng.integers(0, count, (count, 3)).astype(np.int32), material=i % 3)
        mesh.normals = None if bare else rng.normal(size=(count, 3)).astype(np.float32)
        mesh.uvs = rng.random((count, 2)).astype(np.float32) if i % 3 else None
        mesh.uvs1 = rng.random((count, 2)).astype(np.float32) if i % 5 == 0 else None
        mesh.colors = rng.random((count, 4)).astype(np.float32) if i % 7 == 0 else None
        found.append(mesh)
    return found


def same(one, other):
    for name in ("positions", "triangles", "normals", "uvs", "uvs1", "colors"):
        mine, theirs = getattr(one, name), getattr(other, name)
        assert (mine is None) == (theirs is None), name
        if mine is not None:
            np.testing.assert_array_equal(mine, theirs, name)


def test_batched_normals_equal_single_ones():
    made = shapes(np.random.default_rng(5), bare=True)
    for mesh, together in zip(made, smoothed_together(made), strict=True):
        same(smoothed(mesh), together)


@pytest.mark.parametrize("odd", [None, "a normal without a direction", "a place beyond all numbers"])
def test_batched_placing_equals_single_placing(monkeypatch, odd):
    rng = np.random.default_rng(6)
    description = SceneDescription(meshes=shapes(rng), materials=[Material(f"{i}") for i in range(4)])
    for i in range(3 * SHAPES):
        place = np.eye(4)
        place[:3] += rng.normal(size=(3, 4))
        description.instances.append(Instance(i % SHAPES, place, 3 if i % 11 == 0 else None, f"i{i}"))
    if odd == "a normal without a direction":
        description.meshes[3].normals[1] = 0
    if odd == "a place beyond all numbers":
        description.instances[7].transform[0, 3] = 1e30
        for many in (True, False):
            monkeypatch.setattr(geometry, "MIN_BATCH_INSTANCES", 8 if many else 10**9)
            with pytest.raises(
                geometry.SceneError, match="Mesh m7: its position is too large for 32-bit numbers; correct its transform"
            ):
                geometry.build_static(description, *sharing(description))
        return
    together = geometry.build_static(description, *sharing(description))
    monkeypatch.setattr(geometry, "MIN_BATCH_INSTANCES", 10**9)
    alone = geometry.build_static(description, *sharing(description))
    assert len(together.geometry.first) == 3 * SHAPES + 1
    for name, array in together.geometry._asdict().items():
        np.testing.assert_array_equal(array, getattr(alone.geometry, name), name)


def sharing(description):
    count = len(description.instances)
    return geometry.Sharing(list(range(count)), [], [], []), list(range(count)), geometry.Team(1)
