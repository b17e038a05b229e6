"""Tests of the AOV planes (depth, normals, ids, ...): their values, their channels in files, and their colours on the screen."""

import numpy as np
import pytest

from renderer import aovs, film
from renderer.errors import SettingsError


def sums_of(h=4, w=6):
    """Returns the sums of two samples per pixel at the quantum 2**-4: normals +Z, depths increasing to the right, two objects."""
    sums = np.zeros((film.CHANNELS, h, w), np.int64)
    sums[film.SAMPLES] = 2
    sums[film.SAMPLES_HALF] = 1
    sums[film.ALBEDO] = 2 * 8
    sums[film.NORMAL][2] = 2 * 16
    sums[film.DEPTH] = 2 * 16 * np.arange(w)
    sums[film.POSITION][0] = 2 * 16 * np.arange(w)
    sums[film.OBJECT, :, 1:] = 7
    sums[film.MATERIAL, :, 1:] = 3
    return sums


def test_aov_values():
    values = {name: aovs.values(sums_of(), 4, name) for name in aovs.AOVS}
    for name, plane in values.items():
        assert plane.dtype == np.float32
        assert plane.shape == ((4, 6, 3) if aovs.size(name) == 3 else (4, 6))
    assert (values["albedo"] == 0.5).all()
    assert (values["normal"] == (0, 0, 1)).all()
    assert (values["depth"] == np.arange(6)).all()
    assert (values["object"][:, 1:] == 7).all()
    assert (values["object"][:, 0] == 0).all()
    assert (values["samples"] == 2).all()
    assert (values["error"] == 0).all()


def test_aov_channels_are_distinct():
    planes = {name: aovs.values(sums_of(), 4, name) for name in aovs.AOVS}
    layers = aovs.layers(planes)
    assert len(layers) == sum(3 if aovs.size(name) == 3 else 1 for name in aovs.AOVS)
    assert all(plane.shape == (4, 6) for plane in layers.values())
    np.testing.assert_array_equal(layers["Position.X"], planes["position"][..., 0])


def test_every_aov_can_be_displayed():
    for name in aovs.AOVS:
        shown = aovs.visible(name, aovs.values(sums_of(), 4, name))
        assert (shown.dtype, shown.shape) == (np.uint8, (4, 6, 3))
        empty = aovs.visible(name, np.zeros((2, 2, 3) if aovs.size(name) == 3 else (2, 2), np.float32))
        assert empty.shape == (2, 2, 3)
    depth = aovs.visible("depth", aovs.values(sums_of(), 4, "depth"))[0, :, 0].astype(int)
    assert depth[0] == 0, "nothing is hit"
    assert (np.diff(depth[1:]) < 0).all(), "near is light"


def test_id_color_is_the_same_in_every_picture():
    many = aovs.visible("object", np.arange(200, dtype=np.float32).reshape(10, 20))
    one = aovs.visible("object", np.full((1, 1), 57, np.float32))
    assert (many[2, 17] == one[0, 0]).all()
    assert not many[0, 0].any()
    assert len(np.unique(many.reshape(-1, 3), axis=0)) == 200


def test_unknown_error_is_shown_as_maximum():
    plane = np.array([[0.0, 1.0, np.inf]], np.float32)
    shown = aovs.visible("error", plane).astype(int).sum(axis=-1)[0]
    assert shown[0] == 0
    assert shown[2] >= shown[1] > 400


def test_names():
    assert aovs.parse_names(["depth", "normal"]) == ["depth", "normal"]
    assert aovs.parse_names(["depth", "all"]) == list(aovs.AOVS)
    with pytest.raises(SettingsError, match="known are albedo"):
        aovs.parse_names(["mood"])
