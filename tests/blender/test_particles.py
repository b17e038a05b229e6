"""Tests that particle hair is read as strands."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from blender.rayfarm_addon.scene import particles
from blender.rayfarm_addon.scene.particles import hair_systems, strands_of

# World-space paths of two parents and three children; Blender gives zeros beyond a path's end.
PATHS = np.zeros((5, 5, 3))
PATHS[:, 0] = [(10, k, 0) for k in range(5)]
for _step in range(1, 5):
    PATHS[:, _step] = PATHS[:, _step - 1] + (0, 0, 0.25 * _step)
PATHS[3, 3:] = 0


class Matrix(np.ndarray):
    def inverted_safe(self) -> Any:
        return np.linalg.inv(np.asarray(self))


def hair(**changed: Any) -> tuple[Any, Any]:
    """Returns (object, particle system): an object at (10, 0, 0) with hair. changed: settings."""
    values = {"type": "HAIR", "render_type": "PATH", "child_type": "INTERPOLATED", "use_parent_particles": False, "kink": "NO"}
    values |= {"render_step": 2, "display_step": 1, "shape": 0.0, "root_radius": 1.0, "tip_radius": 0.5, "radius_scale": 0.2}
    settings = SimpleNamespace(**{**values, "use_close_tip": False, **changed})
    system = SimpleNamespace(name="fur", settings=settings, particles=[0] * 2, child_particles=[0] * 3)
    system.co_hair = lambda thing, particle_no, step: tuple(PATHS[particle_no, step])
    place = np.eye(4)
    place[0, 3] = 10
    modifier = SimpleNamespace(type="PARTICLE_SYSTEM", particle_system=system, show_render=True, show_viewport=False)
    return SimpleNamespace(modifiers=[modifier], particle_systems=[system], matrix_world=place.view(Matrix)), system


def test_children_are_strands_in_the_object_space() -> None:
    thing, system = hair()
    found = strands_of(thing, system, True)
    assert found is not None and found.first.tolist() == [0, 5, 8, 13]
    np.testing.assert_allclose(found.points[:5], PATHS[2] - (10, 0, 0))
    np.testing.assert_allclose(found.points[5:8], PATHS[3, :3] - (10, 0, 0))
    np.testing.assert_allclose(found.radii[:5], 0.1 - 0.05 * np.array([0, 1, 3, 6, 10]) / 10, rtol=1e-6)
    np.testing.assert_allclose(found.radii[7], 0.05)
    closed = strands_of(*hair(use_close_tip=True, use_parent_particles=True), True)
    assert closed is not None and len(closed.first) == 6
    assert closed.radii[closed.first[1:] - 1].tolist() == [0] * 5
    coarse = strands_of(thing, system, False)
    assert coarse is not None and coarse.first.tolist() == [0, 3, 6, 9]


def test_only_shown_hair_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    thing, system = hair()
    assert [each.name for each in hair_systems(thing, True)] == ["fur"]
    assert list(hair_systems(thing, False)) == []
    assert list(hair_systems(hair(render_type="OBJECT")[0], True)) == []
    monkeypatch.setattr(particles, "MOST_POINTS", 14)
    assert strands_of(thing, system, True) is None
