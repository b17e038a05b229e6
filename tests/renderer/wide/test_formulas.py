"""Tests that formulas return the same results for eight lanes as for each lane alone."""

from functools import partial
from typing import NamedTuple

import numpy as np
import pytest

from renderer.bvh.simd import LANES
from renderer.jit import device, entry
from renderer.kernel import polynomial, vec
from renderer.kernel.fetch import row
from renderer.kernel.sampling import warp
from renderer.kernel.steps.mis import power_heuristic
from renderer.kernel.surface.consistent_normals import consistent_normal
from renderer.kernel.surface.edge_margins import edge_margins
from renderer.kernel.surface.terminator import lifted
from renderer.wide.rows import load_ints
from renderer.wide.values import to_int
from tests.renderer.builders import icosphere
from tests.renderer.wide.both import assert_same_bits, both, in_both, keep
from tests.renderer.wide.given import N, directions, square

pytestmark = pytest.mark.long  # pictures cover this in tests/renderer/kernel/backends/test_features.py


@device
def _numbers_formula(v):
    x, y = v
    sine, cosine = polynomial.sincos_turns(x)
    arcs = sine, cosine, polynomial.atan2(y, x), polynomial.acos(x), polynomial.floor(x)
    powers = polynomial.exp2(x), polynomial.exp(x), polynomial.log2(x), polynomial.log(x), polynomial.power(x, y)
    return *arcs, *powers, power_heuristic(abs(x), abs(y))


@entry
def _numbers(given, order, eight, one):
    in_both(_numbers_formula, 2, given, order, eight, one)


def test_polynomials_and_mis_heuristics():
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.uniform(-2, 2, N), rng.uniform(-130, 130, N), np.exp2(rng.uniform(-126, 30, N))])
    y = rng.uniform(-4, 4, len(x))
    edges = [0, -0.0, 0.5, -0.5, 1, -1, 1.5, -1.5, -3, 128, -127, -1e-30, 1e-40, -(2.0**31), 2.0**30, 2**23 - 0.5]
    x[: len(edges)] = edges
    y[0], y[1], y[2:4] = 0, -0.0, 0
    x[16:19] = np.inf, -np.inf, np.nan
    eight, one = both(_numbers, np.stack([x, y], 1), 11)
    np.testing.assert_array_equal(eight[4, :16], np.floor(x[:16].astype(np.float32)))
    far = ~(abs(x) < 2.0**31) & (x != -(2.0**31))
    eight[4, far] = one[4, far] = 0  # `floor` is undefined for these inputs
    assert_same_bits(eight, one)


@device
def _squares_formula(v):
    u, w = (v[0], v[1]), (v[2], v[3], v[4])
    bent = warp.square_to_cosine_hemisphere(u)
    pdfs = (
        warp.square_to_disk_pdf(warp.square_to_disk(u)),
        warp.square_to_disk_pdf((w[0], w[1] + w[2])),
        warp.square_to_cosine_hemisphere_pdf(w),
        warp.square_to_hemisphere_pdf(w),
        warp.square_to_sphere_pdf(w),
        warp.square_to_cone_pdf(v[0] + v[1]),
        warp.square_to_triangle_pdf(v[0]),
    )
    flat = *warp.square_to_disk(u), *warp.square_to_triangle(u)
    return *bent, *flat, *warp.square_to_hemisphere(u), *warp.square_to_sphere(u), *warp.square_to_cone(u, v[1]), *pdfs


@entry
def _squares(given, order, eight, one):
    in_both(_squares_formula, 5, given, order, eight, one)


def test_warps():
    rng = np.random.default_rng(1)
    eight, one = both(_squares, np.concatenate([square(rng), directions(rng)], 1), 23)
    assert np.isfinite(eight[:16]).all()
    assert_same_bits(eight, one)
    assert set(eight[17]) == {np.float32(0), np.float32(1 / np.pi)}
    assert set(eight[19]) == {np.float32(0), np.float32(0.5 / np.pi)}


@device
def _vectors_formula(v):
    a, b, s = (v[0], v[1], v[2]), (v[3], v[4], v[5]), v[6]
    n = vec.normalize(a)
    x, y = vec.basis(n)
    sums = *vec.add(a, b), *vec.sub(a, b), *vec.mul(a, b), *vec.scale(a, s), *vec.neg(a), *vec.cross(a, b)
    numbers = vec.dot(a, b), vec.length(a), vec.magnitude(a), vec.maximum(a), vec.luminance(a), vec.is_finite(b)
    return *sums, *numbers, *n, *x, *y, *vec.to_world(x, y, n, b), *vec.to_local(x, y, n, b)


@entry
def _vectors(given, order, eight, one):
    in_both(_vectors_formula, 7, given, order, eight, one)


def test_vectors():
    rng = np.random.default_rng(2)
    given = np.concatenate([directions(rng), rng.standard_normal((N, 4)).astype(np.float32)], 1)
    given[0, :3], given[1, :3], given[2, :3] = (0, 0, -1), (0, 0, 1), (0, 0, 0)
    given[3, 3], given[4, 4], given[5, 5] = np.nan, np.inf, -np.inf
    eight, one = both(_vectors, given, 39)
    assert_same_bits(eight, one)
    np.testing.assert_array_equal(eight[23], np.isfinite(given[:, 3:6]).all(1))


@device
def _triangles_formula(v):
    a, b, c = (v[0], v[1], v[2]), (v[3], v[4], v[5]), (v[6], v[7], v[8])
    return edge_margins(a, b, c, vec.cross(vec.sub(b, a), vec.sub(c, a)))


@entry
def _triangles(given, order, eight, one):
    in_both(_triangles_formula, 9, given, order, eight, one)


def test_margins():
    rng = np.random.default_rng(7)
    given = rng.standard_normal((N, 9))
    given[::3, 6:] = given[::3, :3] + 1e-4 * given[::3, 6:]  # slivers
    given[:2] = 1, 1, 1, 1, 1, 1, 1, 1, 1  # points
    given[2:4] = 0, 0, 0, 1, 0, 0, 2, 0, 0  # lines
    eight, one = both(_triangles, given, 2)
    assert np.isfinite(eight).all()
    assert_same_bits(eight, one)


@device
def _normals_formula(v):
    n, geometric, wo = (v[0], v[1], v[2]), (v[3], v[4], v[5]), (v[6], v[7], v[8])
    return consistent_normal(n, geometric, wo)


@entry
def _normals(given, order, eight, one):
    in_both(_normals_formula, 9, given, order, eight, one)


def test_consistent_normals():
    rng = np.random.default_rng(8)
    geometric, wo = directions(rng), directions(rng)
    wo *= np.sign((geometric * wo).sum(1))[:, None]
    n = geometric + rng.choice([0, 0.1, 1, 5], (N, 1)) * directions(rng)
    n /= np.linalg.norm(n, axis=1)[:, None]
    n[0] = geometric[0]
    n[1] = -geometric[1]
    wo[2:4] = n[2:4] = geometric[2:4]
    eight, one = both(_normals, np.concatenate([n, geometric, wo], 1), 3)
    turned = (abs(one.T - n) > 1e-6).any(1)
    assert 0.1 < turned.mean() < 0.9
    height = 2 * (eight.T * wo).sum(1) * (eight.T * geometric).sum(1) - (geometric * wo).sum(1)
    assert height.min() > -1e-6
    np.testing.assert_array_equal(eight.T[~turned], n[~turned].astype(np.float32))
    assert_same_bits(eight, one)


class Tables(NamedTuple):
    """The arrays of a scene that `lifted` reads."""

    triangle: np.ndarray
    position: np.ndarray
    normal: np.ndarray


@device
def _lifts_formula(tables, v):
    number, u, w = to_int(v[0]), v[1], v[2]
    i, j, k, _ = row(tables.triangle, number, 4)
    a, b, c = row(tables.position, i, 3), row(tables.position, j, 3), row(tables.position, k, 3)
    sides = vec.sub(b, a), vec.sub(c, a)
    point = vec.add(a, vec.add(vec.scale(sides[0], u), vec.scale(sides[1], w)))
    shading = v[3], v[4], v[5]
    normals = row(tables.normal, i, 3), row(tables.normal, j, 3), row(tables.normal, k, 3)
    return lifted((a, b, c), normals, point, u, w, shading, vec.scale(vec.cross(sides[0], sides[1]), v[6]))


@entry
def _lifts(tables, given, order, eight, one):
    for i in range(0, len(given), LANES):
        number = load_ints(order, np.uintp(i))
        keep(eight, i, number, _lifts_formula(tables, row(given, number, 7)))
        for j in range(i, i + LANES):
            keep(one, j, j, _lifts_formula(tables, row(given, j, 7)))


def test_lifts():
    """Offsets of ray origins have the same bits for eight lanes as for each lane alone.

    They are tested on a smooth ball, on bent normals and on a triangle without area.
    """
    rng = np.random.default_rng(9)
    ball = icosphere(2)
    normal = ball.positions + rng.choice([0, 1.5], (len(ball.positions), 1)) * directions(rng, len(ball.positions))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    corners = np.concatenate([ball.triangles, np.zeros((len(ball.triangles), 1), np.int32)], 1)
    corners[0, :3] = 0
    tables = Tables(corners.astype(np.int32), ball.positions.astype(np.float32), normal.astype(np.float32))
    number = rng.integers(0, len(corners), N)
    number[:3] = 0
    u = square(rng)
    u[:, 1] *= 1 - u[:, 0]
    shading = ball.positions[corners[number, 0]] * rng.choice([-1, 1], (N, 1))
    given = np.concatenate([number[:, None], u, shading, rng.choice([-3, 1], (N, 1))], 1)
    eight, one = both(partial(_lifts, tables), given, 3)
    some = (one != 0).any(0)
    assert 0.2 < some.mean() < 0.95
    np.testing.assert_array_equal((eight != 0).any(0), some)
    assert_same_bits(eight, one)
    np.testing.assert_array_equal(eight[:, :3], 0)
