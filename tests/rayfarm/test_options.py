"""Tests of options that `render` and `submit` parse by the same code; their errors show a valid example."""

from pathlib import Path

import pytest

from rayfarm import options
from rayfarm.errors import CommandError
from renderer.scene.studio import NO_LIGHTS_WARNING, WEAK_LIGHTS_WARNING
from renderer.settings import Tile

CAMERAS = [
    {"name": "front", "view": {"eye": [0, 1, 5], "target": [0, 1, 0], "up": [0, 1, 0], "fov": 40.0}},
    {"name": "top", "view": {"eye": [0, 9, 0], "target": [0, 0, 0], "up": [0, 0, -1], "fov": 30.0}},
]


def test_numbers_are_parsed() -> None:
    assert options.parse_vec3("1,-2.5,3e2", "--eye") == (1.0, -2.5, 300.0)
    assert options.parse_size("1920X1080") == (1920, 1080)
    assert options.parse_tile("8,16,32,64") == Tile(8, 16, 32, 64)


@pytest.mark.parametrize("text", ["1,2", "1,2,x", "", "1,2,nan", "1,2,inf"])
def test_invalid_vector_error_names_option(text: str) -> None:
    with pytest.raises(CommandError, match="--target is"):
        options.parse_vec3(text, "--target")


@pytest.mark.parametrize("text", ["1920", "x", "10x", "1.5x2"])
def test_invalid_size_error_has_example(text: str) -> None:
    with pytest.raises(CommandError, match="as --size 1920x1080"):
        options.parse_size(text)


def test_environment_is_file_or_colour(tmp_path: Path) -> None:
    sky = tmp_path / "sky,1,2.exr"
    sky.touch()
    assert options.environment_of(str(sky)) == options.Env(image=sky)
    assert options.environment_of("1,0.5,0") == options.Env(color=(1.0, 0.5, 0.0))
    assert options.environment_of("sky:30") == options.Env(sky=(30.0, 0.0))
    assert options.environment_of("sky:-5,120") == options.Env(sky=(-5.0, 120.0))
    assert options.environment_of("studio") == options.Env(preset="studio")
    assert options.environment_of(None) == options.Env()
    for wrong in ("sky:", "sky:high", "sky:91", "sky:1,2,3", "sky:nan"):
        with pytest.raises(CommandError, match="as --env sky:30,120"):
            options.environment_of(wrong)
    with pytest.raises(CommandError, match="no such file"):
        options.environment_of("sky.exr")
    with pytest.raises(CommandError, match="cannot be negative"):
        options.environment_of("1,-1,1")


def test_unknown_camera_error_lists_cameras() -> None:
    for wanted in ("side", "²", "9" * 5000, "-1"):
        with pytest.raises(CommandError, match="0: front, 1: top") as caught:
            options.find_camera(CAMERAS, wanted)
        assert len(str(caught.value)) < 200
    with pytest.raises(CommandError, match="--camera is number 2; the scene has 2, counted from 0"):
        options.find_camera(CAMERAS, "2")


def test_no_studio_warning_with_environment() -> None:
    warnings = ["Not supported and left out: X.", NO_LIGHTS_WARNING, WEAK_LIGHTS_WARNING]
    assert options.relevant_warnings(warnings, options.environment_of(None)) == warnings
    for env in ("1,1,1", "sky:30"):
        assert options.relevant_warnings(warnings, options.environment_of(env)) == warnings[:1]
