"""Tests of converting frame numbers to times: frame n is at n / fps seconds."""

import pytest

from renderer.errors import SettingsError
from renderer.scene.animation import Moment


def test_frame_time_is_number_over_fps():
    assert Moment().seconds() == 0
    assert Moment(36).seconds() == 1.5
    assert Moment(36).seconds(own_fps=12) == 3
    assert Moment(36, fps=48).seconds(own_fps=12) == 0.75, "what is asked for goes before the file's"
    assert Moment(0.5, fps=25).seconds() == 0.02


@pytest.mark.parametrize("frame", [-1, 0.3, float("nan"), float("inf"), 1e9])
def test_invalid_frame_numbers_are_rejected(frame):
    with pytest.raises(SettingsError, match=r"frame is .*; it must be from 0 to 10000000 in steps of a half"):
        Moment(frame)


@pytest.mark.parametrize("fps", [0, -24, float("nan"), 1e6])
def test_fps_out_of_range_is_rejected(fps):
    with pytest.raises(SettingsError, match=r"fps is .*; it must be from 0.001 to 10000"):
        Moment(0, fps)
