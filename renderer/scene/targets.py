"""Finds the bodies at which paths aim (renderer/kernel/steps/aim.py): lights enclosed in smooth glass, and marked bodies.

Light sampling cannot find a light behind smooth glass, which refracts: only paths that happen to cross the glass meet it. An
enclosed light gives up to two targets: a sphere about the light as it appears through the glass, and a sphere about all of the
glass, for light that the glass deflects. Vertices within the glass see the light directly and do not aim at it.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays.light_rows import (
    TARGET_CENTER,
    TARGET_COLUMNS,
    TARGET_GUARD,
    TARGET_GUARD2,
    TARGET_RADIUS,
    TARGET_STRENGTH,
)
from renderer.arrays.rows import CLEAR, IOR
from renderer.scene.description import F32, Mesh, SceneDescription, Sphere
from renderer.scene.material_packing import Packed

__all__ = ["MAX_TARGETS", "list_targets"]

MAX_TARGETS = 16  # at each vertex the pdf of every target is evaluated
_MOST_BODIES = 4096  # emitting or clear bodies that are tested; scenes of more have no enclosed lights
_MOST_LAMPS = 64  # the strongest emitting bodies, which are tested
_MOST_TRIANGLES = 50_000  # of a body, whose solid angles are summed
_LEAST_SHARE = 0.01  # of all light, for a light to be worth half of all directions
_ENCLOSED = 3 * math.pi  # solid angle, steradians, that glass covers as seen from an enclosed light: a bulb's foot may be open
_SHELL = 6 * math.pi  # solid angle from which on the glass is hollow: its inside and its outside are both counted
_MARGIN = 1.05
_MIN_GUARD_DISTANCE = 1.001  # points nearer than this, in radii of the guard sphere, do not aim: they may lie on the body
_MAX_APPARENT_SIZE = 0.7  # a light that appears larger than this, in radii of the glass, gives one target

F64 = npt.NDArray[np.float64]


class _Ball(NamedTuple):
    """A sphere that contains a body at all times while the shutter is open."""

    center: F64
    radius: float


class _Body(NamedTuple):
    """A sphere or an instance of the description, by its index, and a bounding sphere, which need not be tight."""

    number: int
    is_sphere: bool
    material: int
    ball: _Ball


def list_targets(description: SceneDescription, packed: Packed, all_power: float) -> F32:
    """Returns the targets, (a, TARGET_COLUMNS) f32, the strongest first; at most MAX_TARGETS.

    all_power: the power of all lights, the environment included: pi times area times luminance.
    """
    found = [(1.0, ball, ball) for ball in _marked_targets(description)] + _enclosed_lights(description, packed, all_power)
    found = sorted(found, key=lambda each: -each[0])[:MAX_TARGETS]
    table = np.zeros((len(found), TARGET_COLUMNS), np.float32)
    for row, (strength, aim, guard) in zip(table, found, strict=True):
        reach = max(guard.radius, aim.radius + float(np.linalg.norm(aim.center - guard.center)))
        row[TARGET_CENTER : TARGET_CENTER + 3] = aim.center
        row[TARGET_RADIUS] = aim.radius
        row[TARGET_GUARD : TARGET_GUARD + 3] = guard.center
        row[TARGET_GUARD2] = (_MIN_GUARD_DISTANCE * reach) ** 2
        row[TARGET_STRENGTH] = strength
    return table


def _marked_targets(description: SceneDescription) -> list[_Ball]:
    """Returns a bounding sphere of each body that the scene file marks with `guide`."""
    spheres = [_ball_of_sphere(description.spheres[n]) for n in range(len(description.spheres)) if description.spheres[n].guide]
    marked = [n for n, each in enumerate(description.instances) if each.guide and len(description.meshes[each.mesh].triangles)]
    return spheres + [_ball_of_points(_points(description, n)) for n in marked[:MAX_TARGETS]]


def _enclosed_lights(description: SceneDescription, packed: Packed, all_power: float) -> list[tuple[float, _Ball, _Ball]]:
    """Returns (strength, sphere to aim at, guard sphere) for the lights that are enclosed in smooth glass."""
    is_clear = packed.material_flags & CLEAR != 0
    emits = (packed.emitted > 0) & ~is_clear
    glass = _bodies_of(description, is_clear)
    if not glass:
        return []
    lamps, of_glass = _bodies_of(description, emits), _Glass(description, glass)
    power = np.array([math.pi * packed.emitted[lamp.material] * _area(description, lamp) for lamp in lamps])
    inside: dict[int, list[tuple[int, float]]] = {}
    for n in np.argsort(-power, kind="stable")[:_MOST_LAMPS]:
        covers = of_glass.around(lamps[n])
        if covers:
            outermost = max(covers, key=lambda k: glass[k].ball.radius)
            inside.setdefault(outermost, []).append((int(n), covers[outermost]))
    found: list[tuple[float, _Ball, _Ball]] = []
    for k, enclosed in inside.items():
        within = [n for n, _ in enclosed]
        strength = float(power[within].sum()) / max(all_power, 1e-300)
        if strength < _LEAST_SHARE:
            continue
        guard, lamp = of_glass.ball(k), _enclosing_sphere([_tight_sphere(description, lamps[n]) for n in within])
        is_solid = max(covered for _, covered in enclosed) < _SHELL
        larger = max(float(packed.material[glass[k].material, IOR]), 1.0) if is_solid else 1.0
        seen = _Ball(lamp.center, _MARGIN * larger * lamp.radius)
        if seen.radius + float(np.linalg.norm(seen.center - guard.center)) < _MAX_APPARENT_SIZE * guard.radius:
            found += [(0.5 * strength, seen, guard), (0.5 * strength, guard, guard)]
        else:
            found.append((strength, guard, guard))
    most = max((strength for strength, _, _ in found), default=1.0)
    return [(strength / most, aim, guard) for strength, aim, guard in found]


def _bodies_of(description: SceneDescription, is_wanted: npt.NDArray[np.bool_]) -> list[_Body]:
    """Returns the bodies of the wanted materials; none if there are more than _MOST_BODIES."""
    if not is_wanted.any():
        return []
    spheres = [n for n, sphere in enumerate(description.spheres) if is_wanted[sphere.material]]
    materials = [
        description.meshes[each.mesh].material if each.material is None else each.material for each in description.instances
    ]
    instances = [n for n, material in enumerate(materials) if is_wanted[material]]
    if len(spheres) + len(instances) > _MOST_BODIES:
        return []
    found = [_Body(n, True, description.spheres[n].material, _ball_of_sphere(description.spheres[n])) for n in spheres]
    of_mesh: dict[int, _Ball] = {}
    for n in instances:
        instance = description.instances[n]
        mesh = description.meshes[instance.mesh]
        if len(mesh.triangles):
            own = of_mesh.setdefault(instance.mesh, _ball_of_points(_mesh_points(mesh)))
            places = [instance.transform, *instance.keys]
            balls = [_Ball(m[:3, :3] @ own.center + m[:3, 3], own.radius * float(np.linalg.norm(m[:3, :3], 2))) for m in places]
            found.append(_Body(n, False, materials[n], _enclosing_sphere(balls)))
    return found


class _Glass:
    """The clear bodies of a scene; keeps what has been computed of each."""

    def __init__(self, description: SceneDescription, bodies: list[_Body]) -> None:
        self._description, self._bodies = description, bodies
        self._centers, self._radii = np.array([b.ball.center for b in bodies]), np.array([b.ball.radius for b in bodies])
        self.ball = cache(lambda k: _tight_sphere(description, bodies[k]))
        self._corners = cache(lambda k: _corners(description, bodies[k].number))

    def around(self, lamp: _Body) -> dict[int, float]:
        """Returns the bodies that enclose the lamp: index -> solid angle, steradians, that the body covers from within."""
        light, found = _tight_sphere(self._description, lamp), {}
        for k in np.flatnonzero(np.linalg.norm(self._centers - light.center, axis=1) < self._radii).tolist():
            ball: _Ball = self.ball(k)
            if float(np.linalg.norm(ball.center - light.center)) + light.radius <= _MIN_GUARD_DISTANCE * ball.radius:
                covered = 4 * math.pi if self._bodies[k].is_sphere else _solid_angle(self._corners(k), light.center)
                if covered >= _ENCLOSED:
                    found[k] = covered
        return found


def _solid_angle(corners: F64, point: F64) -> float:
    """Returns the sum of the solid angles that triangles cover, seen from a point; layers count repeatedly.

    corners: (T, 3, 3). Estimated from every n-th triangle if there are more than _MOST_TRIANGLES. Source: Van Oosterom &
    Strackee, "The Solid Angle of a Plane Triangle", 1983.
    """
    step = -(-len(corners) // _MOST_TRIANGLES)
    a, b, c = np.moveaxis(corners[::step] - point, 1, 0)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    volume = np.abs(np.einsum("ij,ij->i", a, np.cross(b, c)))
    below = la * lb * lc + np.einsum("ij,ij->i", a, b) * lc + np.einsum("ij,ij->i", b, c) * la + np.einsum("ij,ij->i", c, a) * lb
    return float(2 * step * np.arctan2(volume, below).sum())


def _mesh_points(mesh: Mesh) -> F64:
    return np.concatenate([mesh.positions, *(positions for positions, _ in mesh.keys)]).astype(np.float64)


def _points(description: SceneDescription, number: int) -> F64:
    """Returns the vertices (N, 3) of an instance in world space, at all its keys."""
    instance = description.instances[number]
    points = _mesh_points(description.meshes[instance.mesh])
    return np.concatenate([points @ m[:3, :3].T + m[:3, 3] for m in (instance.transform, *instance.keys)])


def _corners(description: SceneDescription, number: int) -> F64:
    """Returns the corners (T, 3, 3) of an instance's triangles in world space."""
    instance = description.instances[number]
    mesh, m = description.meshes[instance.mesh], instance.transform
    corners: F64 = (mesh.positions.astype(np.float64) @ m[:3, :3].T + m[:3, 3])[mesh.triangles]
    return corners


def _area(description: SceneDescription, body: _Body) -> float:
    if body.is_sphere:
        return 4 * math.pi * description.spheres[body.number].radius ** 2
    a, b, c = np.moveaxis(_corners(description, body.number), 1, 0)
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _tight_sphere(description: SceneDescription, body: _Body) -> _Ball:
    return body.ball if body.is_sphere else _ball_of_points(_points(description, body.number))


def _ball_of_sphere(sphere: Sphere) -> _Ball:
    places = [(sphere.center, sphere.radius), *sphere.keys]
    return _enclosing_sphere([_Ball(np.array(center, np.float64), radius) for center, radius in places])


def _ball_of_points(points: F64) -> _Ball:
    """Returns a sphere that contains the points (N, 3); its centre is that of their bounding box."""
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return _Ball(center, float(np.linalg.norm(points - center, axis=1).max()))


def _enclosing_sphere(balls: list[_Ball]) -> _Ball:
    """Returns a sphere that contains the given spheres; its centre is that of their bounding box."""
    low = np.min([ball.center - ball.radius for ball in balls], axis=0)
    high = np.max([ball.center + ball.radius for ball in balls], axis=0)
    center = 0.5 * (low + high)
    return _Ball(center, max(float(np.linalg.norm(ball.center - center)) + ball.radius for ball in balls))
