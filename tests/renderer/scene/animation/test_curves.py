"""Tests of interpolation between animation keys, against numbers computed by hand."""

import decimal
import math
from fractions import Fraction

import numpy as np
import pytest

from renderer.scene.animation.curves import Curve, eased, slerp, smooth
from renderer.trigonometry import angle_between, sin_cos

TIMES = np.array([1.0, 2.0, 4.0])
VALUES = np.array([[0.0, 10.0], [4.0, 10.0], [8.0, 30.0]])


def quaternion(degrees, axis=(0.0, 0.0, 1.0)):
    half = math.radians(degrees) / 2
    return np.array([*(math.sin(half) * np.array(axis)), math.cos(half)])


@pytest.mark.parametrize(
    ("time", "value"),
    [(-5, [0, 10]), (1, [0, 10]), (1.5, [2, 10]), (1.75, [3, 10]), (2, [4, 10]), (2.5, [5, 15]), (4, [8, 30]), (9, [8, 30])],
)
def test_linear_interpolation_and_constant_extrapolation(time, value):
    assert Curve(TIMES, VALUES).values_at(time) == value


@pytest.mark.parametrize(("time", "value"), [(0, 0), (1, 0), (1.999, 0), (2, 4), (3.9, 4), (4, 8), (7, 8)])
def test_step_interpolation_holds_values(time, value):
    assert Curve(TIMES, VALUES, is_step=True).values_at(time)[0] == value


def test_cubic_splines_match_the_specification():
    """Cubic splines equal glTF 2.0, C.5, evaluated in fractions:

    v(t) = (2t^3 - 3t^2 + 1) v + d (t^3 - 2t^2 + t) b + (-2t^3 + 3t^2) w + d (t^3 - t^2) a.
    """
    values = [[1], [5]]
    arriving, leaving = [[0], [Fraction(3)]], [[Fraction(-2)], [0]]
    slopes = np.array([[a, b] for a, b in zip(arriving, leaving, strict=True)], np.float64)
    curve = Curve(np.array([0.0, 2.0]), np.array(values, np.float64), slopes=slopes)
    for t in (Fraction(1, 4), Fraction(1, 2), Fraction(3, 4)):
        d = 2
        expected = (
            (2 * t**3 - 3 * t**2 + 1) * 1
            + d * (t**3 - 2 * t**2 + t) * Fraction(-2)
            + (-2 * t**3 + 3 * t**2) * 5
            + d * (t**3 - t**2) * 3
        )
        assert curve.values_at(float(2 * t))[0] == pytest.approx(float(expected), rel=1e-15)
    assert curve.values_at(1.0)[0] == 1.75  # by hand at t = 1/2: 1/2 - 1/2 + 5/2 - 3/4


def test_rotations_follow_the_shorter_arc_uniformly():
    curve = Curve(np.array([0.0, 1.0]), np.array([quaternion(0), quaternion(90)]), is_rotation=True)
    for share in (0.25, 0.5, 0.9):
        np.testing.assert_allclose(curve.values_at(share), quaternion(90 * share), atol=1e-15)
    # -q is the same rotation: from 10 to 30 degrees it turns by 20, whichever sign the file has.
    np.testing.assert_allclose(np.abs(slerp(quaternion(10), -quaternion(30), 0.5)), quaternion(20), atol=1e-15)
    # The shorter arc is taken: from 0 to 270 degrees, half way is -45.
    half = np.array(slerp(quaternion(0), quaternion(270), 0.5))
    np.testing.assert_allclose(half * np.sign(half[3]), quaternion(-45), atol=1e-15)


def test_slerp_of_near_equal_and_opposite_rotations():
    for other in (0.0, 1e-12, 180.0, 359.9999999):
        values = slerp(quaternion(0), quaternion(other, (1.0, 0.0, 0.0)), 0.25)
        assert np.isfinite(values).all()
        assert np.linalg.norm(values) == pytest.approx(1, abs=1e-9)
    assert slerp((0, 0, 0, 0), (0, 0, 0, 0), 0.5) == [0, 0, 0, 1]


def test_value_at_a_key_is_exact():
    values = np.array([quaternion(17.3), quaternion(62.1), quaternion(-11)]) * 1.0000001
    curve = Curve(TIMES, values, is_rotation=True)
    for time, value in zip(TIMES, values, strict=True):
        assert curve.values_at(float(time)) == value.tolist()


def test_last_of_several_keys_at_one_time_is_used():
    curve = Curve(np.array([0.0, 1.0, 1.0, 2.0]), np.array([[0.0], [1.0], [5.0], [6.0]]))
    assert [curve.values_at(t)[0] for t in (0.5, 1.0, 1.5, 2.0)] == [0.5, 5.0, 5.5, 6.0]
    assert Curve(np.array([3.0]), np.array([[7.0]])).values_at(0.0) == [7.0]


def test_smooth_curve_has_no_overshoot():
    times, values = np.array([0.0, 1.0, 2.0, 5.0, 6.0]), np.array([[0.0], [1.0], [1.0], [4.0], [2.0]])
    curve = smooth(times, values)
    assert [curve.values_at(float(t)) for t in times] == values.tolist()
    dense = np.array([curve.values_at(float(t))[0] for t in np.linspace(0, 6, 2001)])
    assert dense.min() == 0
    assert 3.9999 < dense.max() <= 4
    assert abs(curve.values_at(1e-4)[0]) < 1e-7, "it starts at rest"
    assert abs(curve.values_at(6 - 1e-4)[0] - 2) < 1e-7
    kink = (curve.values_at(2 + 1e-5)[0] - 2 * curve.values_at(2.0)[0] + curve.values_at(2 - 1e-5)[0]) / 1e-5
    assert abs(kink) < 1e-3
    # With two keys the curve is Hermite's 3u^2 - 2u^3.
    assert smooth(np.array([0.0, 4.0]), np.array([[0.0], [8.0]])).values_at(1.0)[0] == pytest.approx(
        8 * (3 / 16 - 2 / 64), rel=1e-15
    )


def test_inner_slopes_are_weighted_harmonic_means():
    # Slopes 1 and 4 over spans of 1 and 2: (w1 + w2) / (w1 / 1 + w2 / 4), w1 = 2 * 2 + 1, w2 = 2 + 2 * 1.
    curve = smooth(np.array([0.0, 1.0, 3.0]), np.array([[0.0], [1.0], [9.0]]))
    measured = (curve.values_at(1 + 1e-6)[0] - curve.values_at(1 - 1e-6)[0]) / 2e-6
    assert measured == pytest.approx((5 + 4) / (5 / 1 + 4 / 4), rel=1e-5)


def test_bezier_easing_remaps_time():
    straight = (1 / 3, 1 / 3, 2 / 3, 2 / 3)
    for u in (0.1, 0.5, 0.77):
        assert eased(straight, u) == pytest.approx(u, abs=1e-12)
    # CSS's ease-in-out is symmetric; its value at x(s), s = 1/4, computed by hand: x = 3 * 9/64 * 0.42 + 3 * 3/64 * 0.58 + 1/64.
    ease = (0.42, 0.0, 0.58, 1.0)
    assert eased(ease, 0.5) == pytest.approx(0.5, abs=1e-12)
    x, y = 27 / 64 * 0.42 + 9 / 64 * 0.58 + 1 / 64, 9 / 64 + 1 / 64
    assert eased(ease, x) == pytest.approx(y, abs=1e-12)
    curve = Curve(np.array([2.0, 4.0]), np.array([[0.0], [10.0]]), easing=ease)
    assert curve.values_at(2 + 2 * x)[0] == pytest.approx(10 * y, abs=1e-11)


def exact(angle, cosine=False):
    """Returns the float nearest to a sine or cosine, computed to 70 decimal digits without our range reduction."""
    with decimal.localcontext(prec=70 + int(abs(angle))):
        x = decimal.Decimal(angle)
        term, total, n = (decimal.Decimal(1), decimal.Decimal(0), 0) if cosine else (x, decimal.Decimal(0), 1)
        while abs(term) > decimal.Decimal(10) ** -60:
            total, term, n = total + term, -term * x * x / ((n + 1) * (n + 2)), n + 2
        return float(total)


def test_sines_are_correctly_rounded():
    rng = np.random.default_rng(5)
    angles = [0.0, 1e-9, -5e-9, 0.1, math.pi / 2, -math.pi, 3 * math.pi / 2, 710.0, *rng.uniform(-20, 20, 200)]
    for angle in map(float, angles):
        assert sin_cos(angle) == (exact(angle), exact(angle, cosine=True)), angle
    assert sin_cos(1e-300) == (1e-300, 1.0)
    assert sin_cos(1e6)[0] == pytest.approx(math.sin(1e6), abs=1.2e-16)
    with pytest.raises(ValueError, match="too many turns"):
        sin_cos(2e6)


def test_angles_match_the_c_library():
    rng = np.random.default_rng(5)
    for angle in [0.0, 1e-200, math.pi / 4, math.pi / 2, *rng.uniform(0, math.pi / 2, 500)]:
        assert angle_between(math.sin(angle), math.cos(angle)) == pytest.approx(angle, abs=5e-16)
