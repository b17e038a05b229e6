"""Tests of render settings: accepted values, and the error sentences for others."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from renderer.errors import SettingsError
from renderer.settings import (
    FILTERS,
    HEURISTICS,
    INTEGRATORS,
    LIGHT_CHOICES,
    MAX_DEPTH,
    MAX_FLOOR,
    MAX_LIGHT_SAMPLES,
    MAX_SIZE,
    MAX_SPLITTING,
    MISTAKES,
    SAMPLERS,
    SAMPLINGS,
    RenderSettings,
    Tile,
    View,
    tiles_of,
)

VIEW = View((0, 1, 5), (0, 1, 0))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("width", 0),
        ("height", MAX_SIZE + 1),
        ("max_depth", 0),
        ("max_depth", MAX_DEPTH + 1),
        ("seed", -1),
        ("seed", 1 << 32),
        ("integrator", "magic"),
        ("environment_strength", -1.0),
        ("environment_rotation", 361.0),
        ("environment_strength", math.nan),
        ("environment", (0.0, -1.0, 0.0)),
        ("environment", (0.0, math.nan, 0.0)),
        ("environment", (0.0, math.inf, 0.0)),
        ("sampler", "halton"),
        ("filter", "gauss"),
        ("sampling", "luck"),
        ("mistake", "all of them"),
        ("clamp_indirect", -1.0),
        ("clamp_indirect", math.nan),
        ("roulette", 0.01),
        ("roulette_floor", -0.1),
        ("roulette_floor", 0.96),
        ("heuristic", "maximum"),
        ("light_choice", "luck"),
        ("roulette", 1.1),
        ("roulette", math.nan),
        ("light_samples", 0),
        ("light_samples", MAX_LIGHT_SAMPLES + 1),
        ("splitting", 0),
        ("splitting", MAX_SPLITTING + 1),
        ("ao_distance", -1.0),
        ("ao_distance", math.inf),
        ("ambient", (0.0, -1.0, 0.0)),
        ("ambient", (0.0, math.nan, 0.0)),
        ("film_exponent", 25),
        ("film_exponent", -1),
    ],
)
def test_setting_out_of_range_is_named(field, value):
    with pytest.raises(SettingsError, match=f"^{field} is"):
        RenderSettings(**{"width": 8, "height": 8, "view": VIEW, field: value})


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"fov": 0.0}, "fov is 0"),
        ({"fov": 180.0}, "fov is 180"),
        ({"fov": math.nan}, "fov is nan"),
        ({"eye": (0, 1, 0)}, "same point"),
        ({"up": (0, 0, 1)}, "parallel to the line of sight"),
        ({"up": (0, 0, 0)}, "parallel to the line of sight"),
        ({"eye": (math.nan, 0, 3)}, "^eye is"),
        ({"target": (math.inf, 0, 3)}, "^target is"),
        ({"up": (math.nan, 0, 3)}, "^up is"),
        ({"eye": (1e300, 0, 3)}, "^eye is"),
        ({"projection": "fisheye"}, "^projection is"),
        ({"aperture": -0.1}, "^aperture is"),
        ({"aperture": math.nan}, "^aperture is"),
        ({"focus": 0.0}, "^focus is"),
        ({"height": 0.0}, "^height is"),
        ({"near": -1.0}, "^near is"),
        ({"near": math.nan}, "^near is"),
    ],
)
def test_invalid_view_is_rejected(changes, sentence):
    with pytest.raises(SettingsError, match=sentence):
        View(**{"eye": (0, 1, 5), "target": (0, 1, 0), **changes})


@given(
    st.builds(
        RenderSettings,
        width=st.integers(1, MAX_SIZE),
        height=st.integers(1, MAX_SIZE),
        view=st.just(VIEW)
        | st.builds(
            View,
            eye=st.just((0, 1, 5)),
            target=st.just((0, 1, 0)),
            aperture=st.floats(0, 9),
            focus=st.none() | st.floats(0.1, 9),
            near=st.floats(0, 9),
        ),
        seed=st.integers(0, 2**32 - 1),
        integrator=st.sampled_from(INTEGRATORS),
        sampler=st.sampled_from(SAMPLERS),
        filter=st.sampled_from(FILTERS),
        sampling=st.sampled_from(SAMPLINGS),
        mistake=st.sampled_from(MISTAKES),
        heuristic=st.sampled_from(HEURISTICS),
        light_choice=st.sampled_from(LIGHT_CHOICES),
        roulette=st.just(0.0) | st.floats(0.05, 1),
        roulette_floor=st.floats(0, MAX_FLOOR),
        ambient=st.tuples(*[st.floats(0, 1e9)] * 3),
        environment=st.none() | st.tuples(*[st.floats(0, 1e9)] * 3),
        environment_strength=st.floats(0, 1e6),
        environment_rotation=st.floats(-360, 360),
    )
)
def test_settings_round_trip_through_json(settings):
    assert RenderSettings.from_json(json.loads(json.dumps(settings.to_json()))) == settings


@given(st.integers(1, 200), st.integers(1, 200), st.integers(1, 64))
def test_tiles_cover_every_pixel_once(width, height, size):
    covered = np.zeros((height, width), int)
    for tile in tiles_of(width, height, size):
        assert isinstance(tile, Tile)
        assert 1 <= tile.w <= size
        assert 1 <= tile.h <= size
        covered[tile.y : tile.y + tile.h, tile.x : tile.x + tile.w] += 1
    assert (covered == 1).all()


def test_color_may_be_a_list():
    assert RenderSettings(8, 8, VIEW, ambient=[0.1, 0.2, 0.3]).ambient == (0.1, 0.2, 0.3)


def test_new_settings_are_sent_only_if_set() -> None:
    """Settings unknown to older workers are sent only if they are set, so that jobs and stored fingerprints stay valid."""
    assert "transparency_depth" not in RenderSettings(8, 8, VIEW).to_json()
    asked = RenderSettings(8, 8, VIEW, transparency_depth=5)
    assert asked.to_json()["transparency_depth"] == 5
    assert RenderSettings.from_json(asked.to_json()) == asked
    assert RenderSettings.from_json(RenderSettings(8, 8, VIEW).to_json()).transparency_depth == 0


def test_settings_of_an_older_release_are_read():
    """Settings stored by an older release load: null for roulette by throughput, and no roulette floor."""
    stored = RenderSettings(8, 8, VIEW).to_json() | {"roulette": None}
    del stored["roulette_floor"]
    assert RenderSettings.from_json(stored) == RenderSettings(8, 8, VIEW)
    with pytest.raises(SettingsError, match="another release"):
        RenderSettings.from_json(stored | {"of the next release": 1})
    with pytest.raises(SettingsError, match="another release"):
        RenderSettings.from_json(stored | {"view": {**stored["view"], "tilt": 1}})
    with pytest.raises(SettingsError, match="another release"):
        RenderSettings.from_json({"width": 8, "height": 8})


def test_numbers_are_converted_to_the_field_type():
    """Numbers are converted to the type of their field, for which kernels are compiled: an integer field given 8.0 becomes 8."""
    made = RenderSettings(np.int64(8), 8.0, View([0, 1, 5], (np.float32(0.5), 1, 0)), max_depth=5.0, clamp_indirect=1)
    assert (type(made.width), type(made.height), type(made.max_depth), type(made.clamp_indirect)) == (int, int, int, float)
    assert made.view.target == (0.5, 1.0, 0.0)
    assert {type(part) for part in (*made.view.eye, *made.view.target)} == {float}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("max_depth", 2.5),
        ("max_depth", True),
        ("seed", "7"),
        ("ambient", (1, 2)),
        ("ambient", 1),
        ("clamp_indirect", "much"),
        ("integrator", 3),
        pytest.param("max_depth", 10**5000, id="5001 digits"),
        ("seed", None),
    ],
)
def test_non_number_is_named_in_the_error(name, value):
    with pytest.raises(SettingsError, match=f"^{name} is .*; ") as caught:
        RenderSettings(8, 8, VIEW, **{name: value})
    assert len(str(caught.value)) < 200
