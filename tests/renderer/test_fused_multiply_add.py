"""Tests that a product in a sum is fused (fma) exactly where the source says so.

One value and eight lanes have the same bits.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from renderer.bvh.simd import LANES, load, product, store
from renderer.jit import builder, device, entry

N = 4096


@device
def _sums(a, b, c):
    grown, less = c, c
    grown += a * b
    less -= a * b
    return a * b + c, c + a * b, a * b - c, c - a * b, grown, less, a * b + c * a, a * a - b * b


@device
def _rounded(a, b, c):
    named = a * b
    return named + c, c - named, product(a, b) + c, (a * b) * c + named


@entry
def _one(given, sums, rounded):
    for i in range(len(given)):
        found = _sums(given[i, 0], given[i, 1], given[i, 2])
        for k in range(8):
            sums[k, i] = found[k]
    for i in range(len(given)):
        named = given[i, 0] * given[i, 1]
        rounded[0, i] = named + given[i, 2]
        rounded[1, i] = given[i, 2] - named
        sums[8, i] = given[0, 0] * given[0, 1] + given[i, 2]  # product of numbers shared by all lanes


@entry
def _eight(columns, sums, rounded):
    for i in range(0, columns.shape[1], LANES):
        at, width = np.uintp(i), np.uintp(columns.shape[1])
        a, b, c = load(columns, at), load(columns, width + at), load(columns, width + width + at)
        found = _sums(a, b, c)
        for k in range(8):
            store(sums, np.uintp(k) * width + at, found[k])
        store(sums, np.uintp(8) * width + at, columns[0, 0] * columns[1, 0] + c)
        named = _rounded(a, b, c)
        for k in range(4):
            store(rounded, np.uintp(k) * width + at, named[k])


def _nearest(value: Fraction, dtype: Any) -> Any:
    """Returns the best of three neighbouring floats for a fraction, around its value rounded by way of float64."""
    middle = dtype(float(value))
    nearby = [middle, np.nextafter(middle, dtype(-np.inf)), np.nextafter(middle, dtype(np.inf))]
    return min(nearby, key=lambda each: abs(Fraction(float(each)) - value))


def _given(dtype: Any) -> np.ndarray:
    """Returns triples (a, b, c) where a b nearly cancels c, so that fused and unfused results differ greatly."""
    rng = np.random.default_rng(0)
    a, b = rng.uniform(0.5, 2.0, (2, N)).astype(dtype)
    c = (-(a * b) * rng.choice([-1.0, 1.0, 1.0 + 2.0**-20], N)).astype(dtype)
    return np.stack([a, b, c], 1)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_sum_with_a_product_is_rounded_once(dtype: Any) -> None:
    given = _given(dtype)
    sums, rounded = np.zeros((9, N), dtype), np.zeros((2, N), dtype)
    _one(given, sums, rounded)
    for i in range(0, N, 16):
        a, b, c = (Fraction(float(v)) for v in given[i])
        second, square = (Fraction(float(v)) for v in (given[i, 2] * given[i, 0], given[i, 1] * given[i, 1]))
        wanted = [a * b + c, c + a * b, a * b - c, c - a * b, c + a * b, c - a * b, a * b + second, a * a - square]
        assert sums[:8, i].tolist() == [float(_nearest(v, dtype)) for v in wanted]
    of_names = given[:, 0] * given[:, 1]
    np.testing.assert_array_equal(rounded[0], of_names + given[:, 2])
    np.testing.assert_array_equal(rounded[1], given[:, 2] - of_names)
    assert (sums[0] != rounded[0]).any()


def test_eight_lanes_have_the_bits_of_one() -> None:
    given = _given(np.float32)
    one, eight = np.zeros((2, 9, N), np.float32)
    rounded, named = np.zeros((4, N), np.float32), np.zeros((2, N), np.float32)
    _one(given, one, named)
    _eight(np.ascontiguousarray(given.T), eight, rounded)
    np.testing.assert_array_equal(eight, one)
    np.testing.assert_array_equal(rounded[:2], named)
    np.testing.assert_array_equal(rounded[2], named[0])
    a, b, c = given.T
    np.testing.assert_array_equal(rounded[3], (np.float64(a * b) * c + a * b).astype(np.float32))


@builder
def _others(numbers, array):
    before = array
    array += numbers[0] * array  # in place, so other references to the array see the change
    whole = numbers[0] * numbers[1] + 1
    mixed = numbers[0] * np.float32(0.5) - numbers[1]
    return whole, mixed, before[0] + array[0] * numbers[1]


def test_integer_sums_are_not_fused() -> None:
    array = np.array([1.0, 2.0])
    assert _others((3, 4), array) == (13, -2.5, 20.0)
    assert array.tolist() == [4.0, 8.0]


@entry
def _quotient(columns):
    one = load(columns, np.uintp(0))
    store(columns, np.uintp(0), one / load(columns, np.uintp(8)))
    columns[16] = columns[17] / np.sqrt(columns[18]) + columns[19]


def test_quotients_and_roots_are_exact() -> None:
    """Quotients and square roots are those of IEEE 754, not approximations, which differ between Intel and AMD."""
    columns = np.arange(1, 25, dtype=np.float32)
    wanted = columns[:8] / columns[8:16]
    _quotient(columns)
    np.testing.assert_array_equal(columns[:8], wanted)
    assert columns[16] == np.float32(18) / np.sqrt(np.float32(19)) + np.float32(20)
    assert _quotient.targetoptions["fastmath"] is False
