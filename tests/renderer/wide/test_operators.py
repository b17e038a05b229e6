"""Tests of operators and selections on eight lanes and on single numbers, against NumPy."""

import math

import numpy as np
import pytest

from renderer.jit import device, entry
from renderer.wide.values import (
    any_of,
    as_floats,
    as_ints,
    as_wide,
    as_wide3,
    double,
    lookup,
    not_,
    rint,
    single,
    to_float,
    to_int,
    u32,
    where,
    where3,
    zero_like,
)
from tests.renderer.wide.both import both, in_both

pytestmark = pytest.mark.long  # pictures cover this in tests/renderer/kernel/backends/test_features.py

N = 8 * 256
P, Q = np.float32(0.75), np.float32(-3.0)
K, L = np.uint32(0x9E3779B9), np.uint32(5)
FLOATS = np.random.default_rng(0).random(64, np.float32)
INTS = np.random.default_rng(1).integers(-(2**20), 2**20, 64, np.int32)


def floats():
    """Returns (N, 3) floats of all magnitudes, including equal ones, infinities and NaN."""
    rng = np.random.default_rng(2)
    a, b, c = rng.standard_normal((3, N)) * 10.0 ** rng.integers(-3, 4, (3, N))
    special = np.array([0, -0.0, 1, -1, P, np.inf, -np.inf, np.nan])
    a[:64], b[:64] = special.repeat(8), np.tile(special, 8)
    b[64:128] = a[64:128]
    a[128:192] = P
    return np.stack([a, b, c], 1).astype(np.float32)


def assert_both(kernel, given, expected):
    """Asserts that eight lanes and single lanes return the expected rows; the sign of zeros is ignored."""
    with np.errstate(all="ignore"):
        rows = [np.broadcast_to(np.asarray(row, np.float32), len(given)) for row in expected(*np.asarray(given).T)]
    for found in both(kernel, given, len(rows)):
        for number, (row, wanted) in enumerate(zip(found, rows, strict=True)):
            np.testing.assert_array_equal(row, wanted, str(number))


@device
def _arithmetic_formula(v):
    a, b, _ = v
    sums = a + b, a + P, P + a, a - b, a - P, P - a
    products = a * b, a * P, P * a, a / b, a / P, P / a
    ends = min(a, b), min(a, P), min(P, a), max(a, b), max(a, P), max(P, a)
    signs = math.copysign(a, b), math.copysign(a, Q), math.copysign(Q, a), -a, abs(a)
    return *sums, *products, *ends, *signs, math.sqrt(a), rint(a), single(math.sqrt(double(a)))


@entry
def _arithmetic(given, order, eight, one):
    in_both(_arithmetic_formula, 3, given, order, eight, one)


def test_arithmetic():
    def least(a, b):
        return np.where(b < a, b, a)

    def most(a, b):
        return np.where(b > a, b, a)

    def expected(a, b, _):
        yield from (a + b, a + P, P + a, a - b, a - P, P - a)
        yield from (a * b, a * P, P * a, a / b, a / P, P / a)
        yield from (least(a, b), least(a, P), least(P, a), most(a, b), most(a, P), most(P, a))
        yield from (np.copysign(a, b), np.copysign(a, Q), np.copysign(Q, a), -a, abs(a))
        yield from (np.sqrt(a), np.rint(a), np.sqrt(a.astype(np.float64)))

    assert_both(_arithmetic, floats(), expected)


@device
def _comparisons_formula(v):
    a, b, _ = v
    p = P
    less = a < b, a < p, p < a, a <= b, a <= p, p <= a
    more = a > b, a > p, p > a, a >= b, a >= p, p >= a
    same = a == b, a == p, p == a, a != b, a != p, p != a
    x, y, z = a < b, b < p, a == b
    return *less, *more, *same, x & y, x | y, x & True, False | y, not_(z), not_(x & not_(y))


@entry
def _comparisons(given, order, eight, one):
    in_both(_comparisons_formula, 3, given, order, eight, one)


def test_comparisons_and_choices():
    """Comparisons and selections equal NumPy's; with NaN every comparison except != is False."""

    p = P

    def expected(a, b, _):
        yield from (a < b, a < p, p < a, a <= b, a <= p, p <= a)
        yield from (a > b, a > p, p > a, a >= b, a >= p, p >= a)
        yield from (a == b, a == p, p == a, a != b, a != p, p != a)
        x, y, z = a < b, b < p, a == b
        yield from (x & y, x | y, x, y, ~z, ~(x & ~y))

    assert_both(_comparisons, floats(), expected)


@device
def _choices_formula(v):
    a, b, c = v
    m = a < b
    numbers = where(m, a, b), where(m, a, P), where(m, P, a), where(m, P, Q), where(m, b == c, a < c)
    whole = where(m, as_ints(a), as_ints(b)), where(m, as_ints(a), K), where(m, K, L)
    spreads = *as_wide3((P, Q, P), a), as_wide(L, a), zero_like(a), as_wide(True, a)
    return *numbers, *where3(m, (a, b, c), (b, P, a)), as_floats(whole[0]), as_floats(whole[1]), to_float(whole[2]), *spreads


@entry
def _choices(given, order, eight, one):
    in_both(_choices_formula, 3, given, order, eight, one)


def test_selections():
    def expected(a, b, c):
        m = a < b
        yield from (np.where(m, a, b), np.where(m, a, P), np.where(m, P, a), np.where(m, P, Q), np.where(m, b == c, a < c))
        yield from (np.where(m, a, b), np.where(m, b, P), np.where(m, c, a))
        yield from (np.where(m, a, b), np.where(m, a, K.view(np.float32)), np.where(m, K.view(np.int32), 5))
        yield from (P, Q, P, 5, 0, True)

    given = np.nan_to_num(floats(), posinf=7, neginf=-7)
    rows = both(_choices, given, 17)
    rows[1][10] = np.where(
        rows[1][10] == np.float32(K), np.float32(K.view(np.int32)), rows[1][10]
    )  # single integers are unsigned
    wanted = [np.broadcast_to(np.asarray(row, np.float32), N) for row in expected(*given.T)]
    for found in rows:
        np.testing.assert_array_equal(found, wanted)


@device
def _branches_formula(v):
    a, b, c = v
    m = a > b
    result = zero_like(a)
    if any_of(m):
        result = where(m, a, b) + c
    return any_of(m), any_of(not_(m)), result, where(any_of(m), a, b)


@entry
def _branches(given, order, eight, one):
    in_both(_branches_formula, 3, given, order, eight, one)


def test_branches():
    """A branch is executed for eight lanes if its condition holds in any of them."""
    a, b, c = np.random.default_rng(3).standard_normal((3, N)).astype(np.float32)
    b += np.repeat(np.random.default_rng(4).choice([-5, 0, 2, 5], N // 8), 8).astype(np.float32)
    eight, one = both(_branches, np.stack([a, b, c], 1), 4)
    for found, lanes in ((eight, 8), (one, 1)):
        some = (a > b).reshape(-1, lanes).any(1).repeat(lanes)
        every = (a > b).reshape(-1, lanes).all(1).repeat(lanes)
        assert 0.1 < some.mean() < 0.9
        wanted = some, ~every, np.where(some, np.where(a > b, a, b) + c, 0), np.where(some, a, b)
        np.testing.assert_array_equal(found, np.array(wanted, np.float32))


@device
def _whole_numbers_formula(v):
    i, j, s = as_ints(v[0]), as_ints(v[1]), as_ints(v[2])
    k = u32(zero_like(i) | K)
    sums = i + j, i + K, K + i, i - j, i - K, K - i, i * j, i * K, K * i
    bits = i ^ j, i ^ K, i & j, i & K, i | j, i | K, i >> s, i >> L, i << s, i << L, K >> s, k
    same = i == j, i == K, i != j, i != K, i < j, i < K, i >= j, i >= K
    floats = (
        as_floats(u32(sums[0])), as_floats(u32(sums[1])), as_floats(u32(sums[2])), as_floats(u32(sums[3])),
        as_floats(u32(sums[4])), as_floats(u32(sums[5])), as_floats(u32(sums[6])), as_floats(u32(sums[7])),
        as_floats(u32(sums[8])), as_floats(u32(bits[0])), as_floats(u32(bits[1])), as_floats(u32(bits[2])),
        as_floats(u32(bits[3])), as_floats(u32(bits[4])), as_floats(u32(bits[5])), as_floats(u32(bits[6])),
        as_floats(u32(bits[7])), as_floats(u32(bits[8])), as_floats(u32(bits[9])), as_floats(u32(bits[10])),
        as_floats(u32(bits[11])),
    )  # fmt: skip
    return *floats, *same


@entry
def _whole_numbers(given, order, eight, one):
    in_both(_whole_numbers_formula, 3, given, order, eight, one)


def test_whole_numbers():
    """Integers behave as in NumPy: uint32 arithmetic wraps, and right shifts do not extend the sign."""
    rng = np.random.default_rng(5)
    i, j = rng.integers(0, 2**32, (2, N), np.uint32)
    s = rng.integers(0, 32, N, np.uint32)
    j[:100], i[100:200] = i[:100], K
    eight, one = both(_whole_numbers, np.stack([i, j, s], 1).view(np.float32), 29)
    with np.errstate(over="ignore"):
        words = (
            *(i + j, i + K, K + i, i - j, i - K, K - i, i * j, i * K, K * i),
            *(i ^ j, i ^ K, i & j, i & K, i | j, i | K, i >> s, i >> L, i << s, i << L, K >> s, np.full(N, K)),
        )
    truths = np.array([i == j, i == K, i != j, i != K, i < j, i < K, i >= j, i >= K])
    for found in (eight, one):
        np.testing.assert_array_equal(found[:21].view(np.uint32), np.array(words))
        np.testing.assert_array_equal(found[21:], truths)


@device
def _conversions_formula(v):
    near, place, far = to_int(v[0]), u32(to_int(v[1])), as_ints(v[2])
    return near, to_float(near), lookup(FLOATS, place), lookup(INTS, place), as_floats(far)


@entry
def _conversions(given, order, eight, one):
    in_both(_conversions_formula, 3, given, order, eight, one)


def test_conversions_and_tables():
    rng = np.random.default_rng(6)
    near = rng.uniform(-(2.0**20), 2.0**20, N)
    near[:4] = 0.9, -0.9, 2.0**30, -(2.0**31)
    given = np.stack([near, rng.uniform(0, 64, N), rng.standard_normal(N)], 1).astype(np.float32)

    def expected(near, place, far):
        whole = np.trunc(near)
        yield from (whole, whole, FLOATS[place.astype(int)], INTS[place.astype(int)], far)

    assert_both(_conversions, given, expected)
