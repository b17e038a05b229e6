"""Tests of the default studio's floor: it lies below the model, does not move with it, and fades into the horizon."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from renderer.film import mean
from renderer.render import render_frame
from renderer.scene.bounds import bounds_of
from renderer.scene.compile import compile_scene, summarise
from renderer.scene.load import read
from renderer.scene.preview import preview
from renderer.scene.studio import FLOOR
from renderer.settings import RenderSettings, View

_BALL = "shapes: [{type: sphere, center: [0, 3, 0], radius: 1}]\n"
_LIT = _BALL + "environment: {color: 1}\n"


def _has_floor(folder: Path, text: str, floor: str | None) -> bool:
    (folder / "s.yaml").write_text(text)
    return any(mesh.name == FLOOR for mesh in read(folder, "s.yaml", floor=floor).meshes)


@pytest.mark.parametrize(
    ("text", "floor", "expected"),
    [(_BALL, None, False), (_BALL, "auto", True), (_LIT, "auto", False), (_LIT, "on", True)],
)
def test_floor_is_added_on_request(tmp_path: Path, text: str, floor: str | None, expected: bool) -> None:
    assert _has_floor(tmp_path, text, floor) is expected


def test_floor_does_not_change_the_summary(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text("v 0 1 0\nv 1 1 0\nv 0 2 0\nv 0 1 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    plain, floored = (read(tmp_path, "m.obj", floor=floor) for floor in (None, "on"))
    shown, drawn = preview(plain), preview(floored)
    assert shown is not None and drawn is not None and len(shown.triangles) == len(drawn.triangles)
    before, after = (summarise(each, compile_scene(each)) for each in (plain, floored))
    assert after["floor"] and not before["floor"]
    for name in ("bounds", "cameras", "counts"):
        assert after[name] == before[name]


def test_floor_stays_below_a_moving_scene(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(_BALL)
    found = read(tmp_path, "s.yaml", floor="auto")
    floor = found.instances[-1]
    assert found.subject is not None and found.subject.tolist() == [[-1, 2, -1], [1, 4, 1]]
    assert 1.999 < floor.transform[1, 3] < 2
    assert bounds_of(found)[1, 0] > 50


def test_far_floor_matches_the_horizon(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text("shapes: [{type: sphere, center: [0, 1, 0], radius: 1}]\n")
    compiled = compile_scene(read(tmp_path, "s.yaml", floor="auto"))

    def radiance(eye: tuple[float, float, float], target: tuple[float, float, float]) -> float:
        view = View(eye, target, (0.0, 1.0, 0.0), 2.0)
        settings = RenderSettings(8, 8, view=view)
        return float(np.mean(mean(render_frame(compiled, settings, 64), settings.film_exponent)))

    far = radiance((0, 4, 20), (20, 0, 0))
    assert far == pytest.approx(0.5, rel=0.05)
    assert radiance((0, 4, 20), (0, 0, 0.5)) < 0.85 * far


def test_automatic_camera_frames_a_box_whose_bounds_are_rounded(tmp_path: Path) -> None:
    corners = [(x, y, z) for x in (-0.01, 0.01) for y in (-0.01, 0.01) for z in (-0.01, 0.01)]  # all of them on the bounds
    faces = ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4")
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {face}" for face in faces]
    (tmp_path / "m.obj").write_text("\n".join(lines))
    found = read(tmp_path, "m.obj", floor="on")
    assert found.subject is not None
    found.subject = np.nextafter(found.subject.astype(np.float32), np.float32(0)).astype(np.float64)
    plain, floored = (summarise(each, compile_scene(each)) for each in (read(tmp_path, "m.obj"), found))
    assert floored["cameras"] == plain["cameras"]
