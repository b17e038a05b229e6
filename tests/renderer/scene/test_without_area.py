"""Tests of emissive triangles without area: they emit nothing and do not prevent rendering."""

import numpy as np
import pytest

from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Instance, Mesh, SceneDescription
from tests.renderer.builders import emitter, gray, square


def line(material: int, deforms: bool) -> Mesh:
    """Returns two triangles whose corners are collinear or coincide."""
    corners = np.array([[0, 0, 0], [1, 1, 0], [2, 2, 0], [3, 3, 0]], np.float32)
    return Mesh("line", corners, np.array([[0, 1, 2], [3, 3, 3]], np.int32), material=material, deforms=deforms)


@pytest.mark.parametrize("lamp", [False, True])
@pytest.mark.parametrize("deforms", [False, True])
def test_zero_area_emitters_are_counted_and_emit_nothing(lamp: bool, deforms: bool) -> None:
    meshes = [line(0, deforms), square((0, 0, -1), (1, 0, 0), (0, 1, 0), 0 if lamp else 1)]
    description = SceneDescription(
        meshes=meshes,
        instances=[Instance(0), Instance(1)],
        materials=[emitter(3.0), emitter(0.0, albedo=0.5)],
        environment=Environment(color=gray(1.0)),
    )
    scene = compile_scene(description)
    assert description.warnings == ["Emitting triangles without an area give no light: 2."]
    assert len(scene.light_primitive) == (1 if lamp else 0)
    assert (scene.light_area > 0).all()
