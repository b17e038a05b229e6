"""Tests of the up axis for files that state none: as requested, by the format's convention, or guessed from the model's base."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.formats import UP_AXES
from renderer.scene.bounds import bounds_of
from renderer.scene.load import read
from renderer.scene.readers.up_axis import ROTATIONS

# A pyramid, 2 x 2 and 3 high, with its base where the third coordinate is 0.
_CORNERS = ((-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (0, 0, 3))
_FACES = ((1, 4, 3), (1, 3, 2), (1, 2, 5), (2, 3, 5), (3, 4, 5), (4, 1, 5))
_ORDERS = {"y": (0, 2, 1), "z": (0, 1, 2)}


def _obj(up: str, at: float = 0.0) -> str:
    rows = [[(corner[0], corner[1], corner[2] + at)[k] for k in _ORDERS[up]] for corner in _CORNERS]
    return "".join(f"v {x} {y} {z}\n" for x, y, z in rows) + "".join(f"f {a} {b} {c}\n" for a, b, c in _FACES)


@pytest.mark.parametrize("up", ["y", "z"])
def test_up_axis_is_guessed_from_a_flat_bottom(tmp_path: Path, up: str) -> None:
    (tmp_path / "m.obj").write_text(_obj(up))
    found = read(tmp_path, "m.obj")
    assert found.up_axis == up
    assert bounds_of(found).tolist() == [[-1, 0, -1], [1, 3, 1]]
    assert [w.code for w in found.warnings if getattr(w, "code", "") == "up-axis-guessed"] == ["up-axis-guessed"] * (up == "z")


def test_up_axis_defaults_to_the_format_convention(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text(_obj("z", at=-1.0))  # the base is below the origin
    assert read(tmp_path, "m.obj").up_axis == "y"


def test_stl_files_have_z_up_unless_the_model_stands_on_y(tmp_path: Path) -> None:
    for up in ("y", "z"):
        rows = np.array(_CORNERS)[:, _ORDERS[up]]
        facets = "".join(
            "facet normal 0 0 0\nouter loop\n"
            + "".join(f"vertex {' '.join(map(str, rows[n - 1]))}\n" for n in face)
            + "endloop\nendfacet\n"
            for face in _FACES
        )
        (tmp_path / f"{up}.stl").write_text(f"solid m\n{facets}endsolid m\n")
        found = read(tmp_path, f"{up}.stl")
        assert found.up_axis == up
        assert bounds_of(found).tolist() == [[-1, 0, -1], [1, 3, 1]]


def test_requested_up_axis_is_used(tmp_path: Path) -> None:
    assert tuple(ROTATIONS) == UP_AXES
    (tmp_path / "m.obj").write_text("v 1 0 0\nv 0 2 0\nv 0 0 3\nf 1 2 3\n")
    for up in UP_AXES:
        found = read(tmp_path, "m.obj", up=up)
        mesh, place = found.meshes[0], found.instances[0].transform[:3, :3]
        axis = np.zeros(3)
        axis["xyz".index(up[-1])] = -1.0 if up[0] == "-" else 1.0
        assert (place @ axis).tolist() == [0, 1, 0]
        assert np.linalg.det(place) == 1
        assert mesh.positions.max() == 3
        assert not any("up axis" in warning for warning in found.warnings)


def test_up_axis_is_rejected_for_other_formats(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text(_obj("y"))
    with pytest.raises(SceneError, match="'w' is no axis"):
        read(tmp_path, "m.obj", up="w")
    (tmp_path / "s.yaml").write_text("shapes: [{type: sphere, radius: 1}]\n")
    with pytest.raises(SceneError, match="state which axis is up"):
        read(tmp_path, "s.yaml", up="z")
