"""Tests of the elementary functions against NumPy's in float64, over their stated ranges."""

import math

import numpy as np
import pytest

from renderer.jit import entry
from renderer.kernel import polynomial

ULP = 2.0**-24  # relative rounding error of float32: half a unit in the last place


@entry
def _call(which, x, y, out, second):
    for i in range(len(x)):
        if which == 0:
            second[i], out[i] = polynomial.sincos_turns(x[i])
        elif which == 1:
            out[i] = polynomial.atan2(y[i], x[i])
        elif which == 2:
            out[i] = polynomial.acos(x[i])
        elif which == 3:
            out[i] = polynomial.exp2(x[i])
        elif which == 4:
            out[i] = polynomial.log2(x[i])
        elif which == 5:
            out[i] = polynomial.exp(x[i])
        elif which == 6:
            out[i] = polynomial.log(x[i])
        elif which == 7:
            out[i] = polynomial.power(x[i], y[i])
        elif which == 8:
            out[i] = polynomial.erf(x[i])
        elif which == 9:
            out[i] = polynomial.erf_inverse(x[i])
        else:
            out[i] = np.float32(polynomial.floor(x[i]))


NAMES = ("sincos", "atan2", "acos", "exp2", "log2", "exp", "log", "power", "erf", "erf_inverse", "floor")


def call(name, x, y=0.0):
    x = np.atleast_1d(np.asarray(x, np.float32))
    y = np.array(np.broadcast_to(y, x.shape), np.float32)
    out, second = np.empty_like(x), np.empty_like(x)
    _call(NAMES.index(name), x, y, out, second)
    return (second.astype(float), out.astype(float)) if name == "sincos" else out.astype(float)


def double(x):
    return np.asarray(x, np.float32).astype(float)


def ulps(found, expected):
    """Returns the error in units in the last place of the expected float32."""
    return np.abs(found - expected) / np.spacing(np.abs(expected).astype(np.float32)).astype(float)


@pytest.mark.parametrize("reach", [1.0, 100.0, 2.0**20])
def test_sine_and_cosine(reach):
    x = np.linspace(-reach, reach, 400_001)
    sine, cosine = call("sincos", x)
    turn = 2 * np.pi * (double(x) % 1)
    assert np.abs(sine - np.sin(turn)).max() < 4e-7
    assert np.abs(cosine - np.cos(turn)).max() < 4e-7
    assert np.abs(sine).max() <= 1 + 4 * ULP
    assert np.abs(cosine).max() <= 1 + 4 * ULP
    np.testing.assert_allclose(sine**2 + cosine**2, 1, atol=8e-7)


def test_sine_is_odd_and_cosine_even():
    x = np.random.default_rng(0).uniform(0, 4, 10_000)
    for sign, (one, other) in zip((-1, 1), zip(call("sincos", x), call("sincos", -x), strict=True), strict=True):
        np.testing.assert_array_equal(one, sign * other)


def test_atan2():
    rng = np.random.default_rng(1)
    x, y = (rng.standard_normal(300_000) * 10.0 ** rng.uniform(-15, 15, 300_000) for _ in range(2))
    assert np.abs(call("atan2", x, y) - np.arctan2(double(y), double(x))).max() < 4e-7
    axes = np.array([(1, 0), (0, 1), (-1, 0), (0, -1), (0, 0), (1, -0.0), (-1, -0.0), (1, 1), (-1, -1)])
    expected = np.arctan2(axes[:, 1], axes[:, 0])
    np.testing.assert_allclose(call("atan2", axes[:, 0], axes[:, 1]), expected, atol=4e-7)


def test_acos():
    x = np.linspace(-1, 1, 400_001)
    assert np.abs(call("acos", x) - np.arccos(double(x))).max() < 6e-7
    np.testing.assert_allclose(call("acos", [1.5, -1.5, 1, -1, 0]), [0, np.pi, 0, np.pi, np.pi / 2], atol=6e-7)
    near = 1 - np.geomspace(2**-24, 1e-2, 1000)  # where the square root dominates the error
    expected = np.arccos(double(near))
    assert (np.abs(call("acos", near) - expected) < 4e-7 * expected + 1e-9).all()


def test_exp2():
    x = np.linspace(-126, 127.999, 400_001)
    found = call("exp2", x)
    expected = np.exp2(double(x))
    assert np.abs(found / expected - 1).max() < 3e-7
    assert ulps(found, expected).max() < 5
    whole = np.arange(-126, 128)
    np.testing.assert_array_equal(call("exp2", whole), 2.0**whole)
    np.testing.assert_array_equal(call("exp2", [128, 200, np.inf, -127, -np.inf]), [np.inf, np.inf, np.inf, 0, 0])
    assert np.isnan(call("exp2", np.nan))


def test_log2():
    rng = np.random.default_rng(2)
    x = np.concatenate([np.exp2(rng.uniform(-126, 127.99, 300_000)), np.linspace(0.5, 2, 100_001)])
    expected = np.log2(double(x))
    error = np.abs(call("log2", x) - expected)
    assert (error < 2e-7 * np.maximum(np.abs(expected), 1)).all()
    whole = np.arange(-126, 128)
    np.testing.assert_array_equal(call("log2", 2.0**whole), whole)
    assert np.isneginf(call("log2", [0, 1e-40])).all()
    assert np.isposinf(call("log2", np.inf))
    assert np.isnan(call("log2", [-1, np.nan])).all()


def test_log2_near_one_keeps_its_relative_precision():
    step = np.geomspace(2**-22, 0.1, 2000)
    x = np.concatenate([1 + step, 1 - step])
    expected = np.log2(double(x))
    assert (np.abs(call("log2", x) - expected) < 3e-7 * np.abs(expected)).all()


def test_exp_and_log():
    x = np.linspace(-87, 88, 300_001)
    expected = np.exp(double(x))
    assert (np.abs(call("exp", x) / expected - 1) < 3e-7 + 1e-7 * np.abs(double(x))).all()
    x = np.geomspace(1e-37, 1e38, 300_001)
    expected = np.log(double(x))
    assert (np.abs(call("log", x) - expected) < 3e-7 * np.maximum(np.abs(expected), 1)).all()


def test_erf_and_its_inverse():
    x = np.linspace(-5, 5, 2001)
    assert np.abs(call("erf", x) - [math.erf(v) for v in double(x)]).max() < 4e-7
    x = double(np.linspace(-0.9999, 0.9999, 2001))
    np.testing.assert_allclose([math.erf(v) for v in call("erf_inverse", x)], x, atol=1e-6)


def test_power():
    rng = np.random.default_rng(3)
    x, y = np.exp2(rng.uniform(-20, 20, 300_000)), rng.uniform(-5, 5, 300_000)
    expected = double(x) ** double(y)
    sensitivity = 1 + np.abs(double(y) * np.log2(double(x)))
    assert (np.abs(call("power", x, y) / expected - 1) < 3e-7 * sensitivity).all()
    np.testing.assert_array_equal(call("power", [0, 0, 1, 2], [0, 2, 9, 0]), [1, 0, 1, 1])


def test_floor():
    x = np.array([0, -0.0, 0.5, -0.5, 1, -1, 1.5, -1.5, 2**23 - 0.5, -(2**23) + 0.5, 2.0**40, -(2.0**40)], np.float32)
    np.testing.assert_array_equal(call("floor", x), np.floor(x))
