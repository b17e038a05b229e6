"""Tests of ray derivatives through interfaces, against finite differences; and of Newton's steps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from renderer.jit import device, entry
from renderer.kernel import vec
from renderer.kernel.manifold.caster import CasterPoint
from renderer.kernel.manifold.differentials import (
    arrive,
    half_vector_step,
    leave_point,
    perpendicular_area,
    redirect,
    solid_angle_area,
)

ETA = 1.5
BENDS = np.array([[0.2, -0.1, 0.0], [0.05, 0.3, 0.0]])  # change of the normal by x and by y, on a facet
_ZERO, _ONE = np.float32(0), np.float32(1)
_NONE = (_ZERO, _ZERO, _ZERO)


@device
def _on_facet(o, d, bends, up):
    """Returns (distance, CasterPoint) of a ray on the plane z = 0, whose normal is (0, 0, up) + x bends[0] + y bends[1]."""
    t = -o[2] / d[2]
    p = vec.add(o, vec.scale(d, t))
    a, b = (bends[0, 0], bends[0, 1], bends[0, 2]), (bends[1, 0], bends[1, 1], bends[1, 2])
    raw = vec.add((_ZERO, _ZERO, _ONE), vec.add(vec.scale(a, p[0]), vec.scale(b, p[1])))
    scale = up / vec.length(raw)
    x, y = (_ONE, _ZERO, _ZERO), (_ZERO, _ONE, _ZERO)
    g = _ZERO, _ZERO, up
    curvature, yes = _ZERO, np.bool_(True)
    return t, CasterPoint(p, _ZERO, g, vec.scale(raw, scale), yes, yes, curvature, x, vec.scale(a, scale), y, vec.scale(b, scale))


@device
def _on_sphere(o, d, eta):
    """Returns (distance, CasterPoint) where a ray from inside leaves the unit sphere around (0, 0, -0.5)."""
    center = _ZERO, _ZERO, np.float32(-0.5)
    off = vec.sub(o, center)
    along = vec.dot(off, d)
    t = -along + math.sqrt(along * along - vec.dot(off, off) + _ONE)
    p = vec.add(o, vec.scale(d, t))
    n = vec.sub(center, p)
    yes = np.bool_(True)
    return t, CasterPoint(p, _ZERO, n, n, yes, yes, -_ONE, _NONE, _NONE, _NONE, _NONE)


@entry
def _trace(directions, bends, eta, through, distance, ends, areas):
    """Traces rays from (0.1, 0.2, 1) down through the facet, and if `through` out of the sphere; or reflects them if eta is 0."""
    o = np.float32(0.1), np.float32(0.2), _ONE
    for i in range(len(directions)):
        d = vec.normalize((directions[i, 0], directions[i, 1], directions[i, 2]))
        t, at = _on_facet(o, d, bends, _ONE)
        ray = leave_point(d)
        u, v = arrive(ray, t, at.geometric)
        reflects = eta == _ZERO
        _, out = redirect(ray, u, v, at, max(eta, np.float32(0.1)), reflects)
        if through:
            t, leaving = _on_sphere(at.point, out.d, eta)
            u, v = arrive(out, t, leaving.geometric)
            _, out = redirect(out, u, v, leaving, _ONE / eta, False)
            at = leaving
        end = vec.add(at.point, vec.scale(out.d, distance))
        for c in range(3):
            ends[i, c], ends[i, 3 + c] = end[c], out.d[c]
        areas[i, 0], areas[i, 1] = perpendicular_area(out, distance), solid_angle_area(out)


def traced(d: np.ndarray, eta: float, through: bool) -> tuple[np.ndarray, np.ndarray]:
    ends, areas = np.zeros((len(d), 6), np.float32), np.zeros((len(d), 2), np.float32)
    _trace(d.astype(np.float32), BENDS.astype(np.float32), np.float32(eta), through, np.float32(2.0), ends, areas)
    return ends.astype(float), areas.astype(float)


@pytest.mark.parametrize(("eta", "through"), [(0.0, False), (ETA, False), (1 / 1.33, False), (ETA, True)])
def test_areas_match_finite_differences(eta: float, through: bool) -> None:
    step = 2e-3
    for d in ((0.1, -0.2, -1.0), (0.35, 0.1, -1.0), (-0.3, -0.3, -1.0)):
        w = np.array(d) / np.linalg.norm(d)
        s = np.cross(w, (0.0, 1.0, 0.0))
        s /= np.linalg.norm(s)
        t = np.cross(w, s)
        ends, areas = traced(np.array([w, w + step * s, w - step * s, w + step * t, w - step * t]), eta, through)
        by_s, by_t = (ends[1] - ends[2]) / (2 * step), (ends[3] - ends[4]) / (2 * step)
        out = ends[0, 3:]
        assert areas[0, 0] == pytest.approx(abs(np.cross(by_s[:3], by_t[:3]) @ out), rel=5e-3)
        assert areas[0, 1] == pytest.approx(abs(np.cross(by_s[3:], by_t[3:]) @ out), rel=5e-3)


@entry
def _newton(bends, target, eta, errors):
    """Solves for the ray from (0.1, 0.2, 1) that is refracted (eta > 0) or reflected at the facet towards the target."""
    o = np.float32(0.1), np.float32(0.2), _ONE
    goal = target[0], target[1], target[2]
    d = vec.normalize((np.float32(0.3), np.float32(-0.4), -_ONE))
    for i in range(len(errors)):
        t, at = _on_facet(o, d, bends, _ONE)
        ray = leave_point(d)
        u, v = arrive(ray, t, at.geometric)
        reflects = eta == _ZERO
        _, error2, by_u, by_v = half_vector_step(ray, u, v, at, eta, reflects, goal, False)
        errors[i, 0] = math.sqrt(error2)
        _, out = redirect(ray, u, v, at, max(eta, np.float32(0.1)), reflects)
        errors[i, 1] = vec.length(vec.cross(vec.sub(goal, at.point), out.d))
        move = vec.add(vec.scale(u, by_u), vec.scale(v, by_v))
        d = vec.normalize(vec.sub(vec.add(at.point, move), o))


@pytest.mark.parametrize(("eta", "target"), [(ETA, (0.3, -0.2, -1.2)), (1 / 1.33, (-0.2, 0.1, -0.8)), (0.0, (0.4, 0.5, 1.5))])
def test_newton_steps_converge_quadratically(eta: float, target: tuple[float, ...]) -> None:
    errors = np.zeros((8, 2), np.float32)
    _newton(BENDS.astype(np.float32), np.array(target, np.float32), np.float32(eta), errors)
    error = errors[:, 0].astype(float)
    assert error[-1] < 1e-6 and errors[-1, 1] < 1e-5
    first = np.flatnonzero(error < 0.05)[0]
    assert error[first + 1] < max(20 * error[first] ** 2, 2e-6)
