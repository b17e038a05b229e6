"""Tests of the note on scenes of which nothing can be seen from any side."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.scene import visible_surfaces
from renderer.scene.compile import camera_dicts, compile_scene
from renderer.scene.description import Camera, Environment, Instance, Light, Material, Medium, Mesh, SceneDescription, Sphere
from renderer.scene.studio import add_floor
from renderer.scene.visible_surfaces import INVISIBLE, invisible_note
from renderer.settings import View

CORNERS = {
    "triangle": [(0, 0, 0), (1, 0, 0), (0, 1, 0)],
    "sliver": [(0, 0, 0), (1, 0, 0), (0.5, 1e-4, 0)],
    "line": [(0, 0, 0), (1, 0, 0), (2, 0, 0)],
    "rounded line": [(0.1, 0.1, 0.1), (0.7, 0.7, 0.7), (1.3, 1.3, 1.3000001)],
    "point": [(1, 1, 1)] * 3,
}


def scene(shape: str, material: Material | None = None, **instance: object) -> SceneDescription:
    mesh = Mesh("m", np.array(CORNERS[shape], np.float32), np.array([[0, 1, 2]], np.int32), material=0)
    return SceneDescription(meshes=[mesh], instances=[Instance(0, **instance)], materials=[material or Material()])  # type: ignore[arg-type]


def code(description: SceneDescription) -> str:
    note = invisible_note(description)
    return "" if note is None else note.code


@pytest.mark.parametrize(
    ("shape", "found"), [("triangle", ""), ("sliver", ""), *((name, INVISIBLE[0]) for name in ("line", "rounded line", "point"))]
)
def test_surface_without_area(shape: str, found: str) -> None:
    assert code(scene(shape)) == found
    beside = scene(shape)
    beside.spheres = [Sphere((0, 0, 0), 1.0)]
    assert code(beside) == ""
    beside = scene(shape)
    beside.medium = Medium()
    assert code(beside) == ""


def test_scene_that_takes_long_to_examine_counts_as_visible(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few bytes of a file can place many triangles without an area many times."""
    examined: list[int] = []

    def has_area(positions: np.ndarray, triangles: np.ndarray, transform: np.ndarray) -> bool:
        examined.append(len(triangles))
        return False

    monkeypatch.setattr(visible_surfaces, "has_area", has_area)
    description = scene("line")
    description.meshes[0].triangles = np.zeros((1_500_000, 3), np.int32)
    description.instances *= 2
    assert code(description) == INVISIBLE[0]
    description.instances *= 500
    examined.clear()
    assert code(description) == ""
    assert sum(examined) <= visible_surfaces._MOST_TRIANGLES
    description.meshes[0].triangles = np.zeros((1, 3), np.int32)
    description.instances *= 100
    examined.clear()
    assert code(description) == ""
    assert len(examined) < 20_000


def test_floor_of_the_studio_is_no_surface_of_the_file() -> None:
    description = scene("line")
    add_floor(description, np.array([(0.0, 0, 0), (2.0, 0, 0)]))
    assert code(description) == INVISIBLE[0]


@pytest.mark.parametrize("scale", [(0, 0, 0), (1, 0, 0), (1, 0, 1)])
def test_scale_of_zero_at_one_frame(scale: tuple[float, float, float]) -> None:
    """A surface that is scaled to a point or a line may be larger at another frame if its transform moves."""
    transform = np.diag([*scale, 1.0])
    assert code(scene("triangle", transform=transform)) == INVISIBLE[0]
    assert code(scene("triangle", transform=transform, moves=True)) == INVISIBLE[1]
    assert code(scene("line", transform=transform, moves=True)) == INVISIBLE[0]


@pytest.mark.parametrize(
    ("material", "is_clear"),
    [
        (Material(opacity=0.0, alpha_mode="blend"), True),
        (Material(opacity=0.1, alpha_mode="blend"), False),
        (Material(opacity=0.4, alpha_mode="mask"), True),
        (Material(opacity=0.5, alpha_mode="mask"), False),
        (Material(opacity=0.0), False),
        (Material(opacity=0.0, alpha_mode="blend", emission=(1, 1, 1)), False),
        (Material(unseen=True), True),
    ],
)
def test_transparent_and_hidden_surfaces(material: Material, is_clear: bool) -> None:
    assert code(scene("triangle", material)) == ("scene-invisible" if is_clear else "")
    beside = scene("triangle", material)
    beside.materials.append(Material())
    beside.instances.append(Instance(0, material=1))
    assert code(beside) == ""


def test_note_is_the_first_warning_and_no_camera_is_blamed() -> None:
    """A compiled scene has the note once, before its other warnings; that its camera sees nothing is not said beside it."""
    description = scene("line", Material(emission=(1, 1, 1)), moves=True)
    description.lights = [Light("point", intensity=(1, 1, 1))]
    description.environment = Environment(strength=0.0)
    description.cameras = [Camera("away", View((0, 0, 5), (0, 0, 9)))]
    description.warnings = ["Another."]
    compile_scene(description, threads=1)
    assert [getattr(each, "code", each) for each in description.warnings] == [
        "scene-without-area",
        "Another.",
        "emitters-without-area",
    ]
    bounds = np.array([(0.0, 0, 0), (2.0, 0, 0)])
    assert not any("sees_nothing" in camera for camera in camera_dicts(description, bounds, bounds))
