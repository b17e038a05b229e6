"""Tests of when a locally rendered frame with a target noise is finished, of layers that it cannot have, and of notes on black
pictures."""

from pathlib import Path

import numpy as np
import pytest

from rayfarm.commands.render import print_darkness_note
from rayfarm.frame import PictureOrder, render_to
from rayfarm.picture import Picture
from rayfarm.rendering import Clock, whole_frame
from renderer import film, render
from renderer.errors import SettingsError
from renderer.render import RenderStats
from renderer.settings import RenderSettings, View
from tests.rayfarm.program import rayfarm


@pytest.mark.parametrize(("side", "spp", "ends"), [(1, 1024, 512), (2, 1024, 128), (8, 1024, 16), (2, 5, 5)])
def test_noise_ends_no_frame_before_each_pixel_has_enough_samples(monkeypatch, side, spp, ends) -> None:
    """A noise target ends no frame before each pixel has enough samples, since a few samples can agree by chance.

    The noise estimate is replaced by 0. Frames of 1, 2 and 8 pixels a side end after 512, 128 and 16 samples per pixel.
    """
    settings = RenderSettings(side, side, View((0, 0, 1), (0, 0, 0)))
    monkeypatch.setattr(render, "_prepared", lambda scene, settings: scene)

    def batch(scene, settings, tile, first, count, log=None):
        sums = np.zeros((film.CHANNELS, tile.h, tile.w), np.int64)
        sums[film.SAMPLES] = count
        return film.BatchSums(sums, [], 0), 0

    monkeypatch.setattr(render, "_render", batch)
    monkeypatch.setattr(film, "noise", lambda sums, exponent: 0.0)
    sums = whole_frame(None, settings, spp, 1, 0.5, None, RenderStats(), lambda part, whole: None)
    assert (sums[film.SAMPLES] == ends).all()


def test_alpha_of_an_opaque_picture_is_refused_before_rendering(tmp_path: Path) -> None:
    settings = RenderSettings(4, 4, View((0, 0, 1), (0, 0, 0)))
    order = PictureOrder(Picture(), ["alpha"], False, 0.0, "neutral", None, 0, None, 1)
    with pytest.raises(SettingsError, match="opaque background"):
        render_to(tmp_path / "a.exr", order, None, {"defaults": {}}, settings, Clock(), lambda part, whole: None)


@pytest.mark.parametrize(
    ("objects", "other_camera", "said"),
    [
        (1, "auto", "no light reaches what the camera sees. --env studio lights it."),
        (0, "auto", "the camera sees no object. --camera auto frames the scene."),
        (0, "", "the camera sees no object. `rayfarm info` shows the bounds"),
    ],
)
def test_black_picture_is_noted_with_its_reason(
    capsys: pytest.CaptureFixture[str], objects: int, other_camera: str, said: str
) -> None:
    seen = np.zeros((4, 4), np.float32)
    seen[0, 0] = objects
    print_darkness_note(np.zeros((4, 4, 3), np.float32), seen, Path("out.exr"), 0.0, other_camera)
    assert f"note: The picture is black: {said}" in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.parametrize(("z", "said"), [(0, "no light reaches what the camera sees"), (9, "--camera auto frames the scene")])
def test_render_notes_why_a_picture_is_black(tmp_path: Path, z: int, said: str) -> None:
    """A scene whose only light is an environment without radiance, with its sphere before the camera or behind it."""
    (tmp_path / "black.yaml").write_text(
        f"cameras: [{{name: front, eye: [0, 0, 5], target: [0, 0, 0]}}]\nenvironment: {{color: 0}}\n"
        f"materials: {{grey: {{color: 0.5}}}}\nshapes: [{{type: sphere, material: grey, center: [0, 0, {z}], radius: 1}}]\n"
    )
    done = rayfarm("render", tmp_path / "black.yaml", "--size=8x8", "--spp=1", "-o", tmp_path / "out.png")
    assert done.returncode == 0 and said in done.stderr


@pytest.mark.long
def test_render_advises_no_camera_for_a_scene_without_area(tmp_path: Path) -> None:
    (tmp_path / "flat.obj").write_text("v 0.1 0.1 0.1\nv 0.7 0.7 0.7\nv 1.3 1.3 1.3000001\nf 1 2 3\n")
    done = rayfarm(
        "render", tmp_path / "flat.obj", "--size=8x8", "--spp=1", "--background=transparent", "-o", tmp_path / "out.png"
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("Nothing is visible, since no surface of the file has an area") == 1
    assert "--camera" not in done.stderr and "The picture is black" not in done.stderr
