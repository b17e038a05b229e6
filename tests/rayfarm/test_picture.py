"""Tests of the options of `render` and `submit`: both have all settings of the renderer."""

from __future__ import annotations

import shlex
from dataclasses import fields
from typing import Any

import pytest
import typer
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from protocol.reproduce import batch_command
from rayfarm.errors import CommandError
from rayfarm.options import Placement
from rayfarm.picture import Picture, takes_picture
from renderer.lens_distortion import LensDistortion
from renderer.settings import (
    FILTERS,
    HEURISTICS,
    INTEGRATORS,
    LIGHT_CHOICES,
    MAX_FLOOR,
    OPTIONAL,
    PROJECTIONS,
    SAMPLERS,
    SAMPLINGS,
    RenderSettings,
    Tile,
    View,
)
from service.models.jobs import JobIn

CAMERAS = [
    {"name": "front", "view": {"eye": [0, 1, 5], "target": [0, 1, 0], "up": [0, 1, 0], "fov": 40.0}},
    {"name": "top", "view": {"eye": [0, 9, 0], "target": [0, 0, 0], "up": [0, 0, -1], "fov": 30.0, "aperture": 0.25}},
]


def parse_picture(arguments: list[str]) -> Picture:
    """Returns the picture requested by these command-line arguments."""
    found: list[Picture] = []
    app = typer.Typer()

    @app.command()
    @takes_picture
    def command(picture: Picture = Picture(), tile: str = "", first: int = 0, threads: int = 1, output: str = "") -> None:
        found.append(picture)

    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    return found[0]


def test_camera_is_selected_by_name_or_number_and_changed() -> None:
    assert parse_picture([]).view(CAMERAS) == View((0, 1, 5), (0, 1, 0), (0, 1, 0), 40.0)
    assert parse_picture(["--camera=top"]).view(CAMERAS).eye == (0, 9, 0)
    assert parse_picture(["--camera=1"]).view(CAMERAS).aperture == 0.25
    changed = parse_picture(["--camera=0", "--eye=1,2,3", "--fov=20", "--projection=orthographic", "--ortho-height=3"])
    assert changed.view(CAMERAS) == View((1, 2, 3), (0, 1, 0), (0, 1, 0), 20.0, "orthographic", height=3.0)
    assert parse_picture(["--camera=top"]).request(CAMERAS)["camera"] == 1
    namesakes = [{**camera, "name": "Camera"} for camera in CAMERAS]
    assert parse_picture(["--camera=1"]).request(namesakes)["camera"] == 1
    assert parse_picture(["--camera=top", "--aperture=0"]).request(CAMERAS)["view"]["aperture"] == 0.0


def test_invalid_view_gives_reason() -> None:
    with pytest.raises(CommandError, match="eye and target are the same point"):
        parse_picture(["--eye=0,1,0"]).view(CAMERAS)
    lens = parse_picture(["--distortion=brown,-0.2,0.05"]).view(CAMERAS).distortion
    assert lens == LensDistortion("brown", (-0.2, 0.05))
    with pytest.raises(CommandError, match="--distortion is 'brown,x'; it takes a model and numbers"):
        parse_picture(["--distortion=brown,x"]).view(CAMERAS)
    with pytest.raises(CommandError, match="known are perspective"):
        parse_picture(["--projection=fish"]).view(CAMERAS)
    with pytest.raises(CommandError, match="0: front, 1: top"):
        parse_picture(["--camera=²"]).view(CAMERAS)


def test_scene_defaults_apply_without_options() -> None:
    defaults = {"width": 100, "height": 50, "sampler": "independent", "max_depth": 3, "roulette": 0.5}
    made = parse_picture(["--max-depth=7"]).settings(CAMERAS, defaults)
    assert (made.width, made.height, made.sampler, made.max_depth, made.roulette) == (100, 50, "independent", 7, 0.5)
    assert made.filter == RenderSettings(1, 1, made.view).filter
    assert (parse_picture([]).settings(CAMERAS, {}).width, parse_picture(["--size=8x9"]).settings(CAMERAS, defaults).height) == (
        960,
        9,
    )


def test_every_setting_has_an_option() -> None:
    assert parse_picture([]).given_settings().keys() == set(OPTIONAL)
    view = parse_picture([])._view().keys()
    assert view == {field.name for field in fields(View)}


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], Placement(None, "auto")),
        (["--up-axis=auto"], Placement(None, "auto")),
        (["--up-axis=-Z", "--no-floor"], Placement("-z", None)),
        (["--env=1,1,1"], Placement(None, None)),
        (["--env=studio", "--floor"], Placement(None, "on")),
    ],
)
def test_default_placement_equals_page(words: list[str], expected: Placement) -> None:
    assert parse_picture(words).placement() == expected


def test_unknown_axis_is_rejected() -> None:
    with pytest.raises(CommandError, match="--up-axis is 'w'; it takes one of auto, y, z, x, -y, -z, -x"):
        parse_picture(["--up-axis=w"]).check()
    with pytest.raises(CommandError, match="--up-axis z"):
        parse_picture(["--up=z"]).check()


numbers = st.floats(-1e6, 1e6).map(lambda v: v + 0.0)
lengths = st.floats(1e-3, 1e6)


@st.composite
def any_settings(draw: Any) -> RenderSettings:
    eye = draw(st.tuples(numbers, numbers, numbers))
    target = (eye[0] + draw(lengths) + 1.0, eye[1], eye[2])
    aperture = draw(st.sampled_from([0.0, 0.5]))
    view = View(
        eye,
        target,
        (0.0, 0.0, 1.0),
        draw(st.floats(1, 170)),
        draw(st.sampled_from(PROJECTIONS)),
        aperture,
        draw(lengths) if aperture else None,
        draw(lengths),
    )
    return RenderSettings(
        draw(st.integers(1, 4096)),
        draw(st.integers(1, 4096)),
        view,
        max_depth=draw(st.integers(1, 64)),
        seed=draw(st.integers(0, (1 << 32) - 1)),
        integrator=draw(st.sampled_from(INTEGRATORS)),
        sampler=draw(st.sampled_from(SAMPLERS)),
        filter=draw(st.sampled_from(FILTERS)),
        sampling=draw(st.sampled_from(SAMPLINGS)),
        heuristic=draw(st.sampled_from(HEURISTICS)),
        light_choice=draw(st.sampled_from(LIGHT_CHOICES)),
        roulette_floor=draw(st.floats(0, MAX_FLOOR)),
        clamp_indirect=draw(st.floats(0, 100)),
        roulette=draw(st.just(0.0) | st.floats(0.05, 1)),
        light_samples=draw(st.integers(1, 64)),
        splitting=draw(st.integers(1, 2)),
        ao_distance=draw(st.floats(0, 10)),
        environment=draw(st.none() | st.tuples(*[st.floats(0, 10)] * 3)),
        environment_strength=draw(st.floats(0, 10)),
        environment_rotation=draw(st.floats(-360, 360)),
    )


@pytest.mark.long
@given(any_settings())
@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_reproduce_command_gives_equal_settings(wanted: RenderSettings) -> None:
    words = shlex.split(batch_command(wanted, Tile(1, 2, 3, 4), 5, 6))
    assert words[:4] == ["rayfarm", "render", "SCENE", "-o"]
    got = parse_picture(words[5:]).settings(CAMERAS, {"filter": "box", "max_depth": 2})
    assert got == wanted


@given(any_settings())
@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_farm_request_is_valid(wanted: RenderSettings) -> None:
    words = shlex.split(batch_command(wanted, Tile(1, 2, 3, 4), 5, 6))
    JobIn(scene="scene", **parse_picture(words[5:]).request(CAMERAS))
