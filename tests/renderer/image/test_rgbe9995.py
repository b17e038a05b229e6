"""Tests of RGB9E5 encoding against the equations of EXT_texture_shared_exponent, evaluated for one pixel at a time."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from renderer.image.rgbe9995 import MAX, pack, unpack

radiance = st.floats(0, 1e6, width=32)


def word_by_specification(rgb):
    clamped = [max(0.0, min(float(c), MAX)) for c in rgb]
    brightest = max(clamped)
    preliminary = max(-16, math.floor(math.log2(brightest)) if brightest > 0 else -16) + 1 + 15
    top = math.floor(brightest / 2.0 ** (preliminary - 15 - 9) + 0.5)
    exponent = preliminary + (top == 2**9)
    r, g, b = (math.floor(c / 2.0 ** (exponent - 15 - 9) + 0.5) for c in clamped)
    return r | g << 9 | b << 18 | exponent << 27


@given(st.tuples(radiance, radiance, radiance))
def test_words_are_those_of_the_specification(rgb):
    assert int(pack(np.array(rgb, np.float32))) == word_by_specification(rgb)


@given(st.tuples(radiance, radiance, radiance))
def test_round_trip_is_within_half_a_step_of_the_brightest_channel(rgb):
    expected = np.minimum(np.array(rgb, np.float32), MAX)
    step = max(2.0**-24, 2.0 ** (math.floor(math.log2(max(expected.max(), 1e-30) * (1 + 2.0**-10))) - 8))
    assert np.abs(unpack(pack(expected)) - expected).max() <= step / 2


def test_unrepresentable_values_are_clamped():
    words = pack(np.array([[np.nan, 1, -3], [1e9, 0, np.inf]], np.float32))
    assert unpack(words).tolist() == [[0, 1, 0], [MAX, 0, MAX]]


def test_shape_is_kept():
    assert pack(np.zeros((3, 5, 3), np.float32)).shape == (3, 5)
    assert unpack(np.zeros((3, 5), np.uint32)).shape == (3, 5, 3)
