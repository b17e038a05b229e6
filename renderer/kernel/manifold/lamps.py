"""Sampling of small lamps: chooses a lamp by power and a point on it by area, independently of the shaded vertex."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.fetch import row
from renderer.kernel.light.environment import sample_cdf
from renderer.kernel.light.punctual import DIRECTIONAL, POINT, SUN, spot_falloff
from renderer.kernel.manifold.caster import material_number
from renderer.kernel.material.material import emission
from renderer.kernel.sampling.warp import square_to_cone, square_to_cone_pdf, square_to_sphere, square_to_triangle

__all__ = ["AREA", "DISTANT", "PLACE", "LampPoint", "lamp_light", "sample_lamp"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_4PI = np.float32(4 * math.pi)
_BLACK = (_ZERO, _ZERO, _ZERO)
_MARGIN = np.float32(32 * 2.0**-24)
PLACE, AREA, DISTANT = range(3)  # kinds of lamp points: of a lamp without extent, on a surface, a direction


class LampPoint(NamedTuple):
    """A point on a lamp, or the direction to it."""

    kind: Any  # PLACE, AREA or DISTANT
    target: Any  # the point; the unit direction to it if the lamp is distant
    normal: Any  # of its surface, unit; of lamps without a surface, zero
    pdf: (
        Any  # of the point by area, or of the direction by solid angle, with the probability of the lamp; without extent: of that
    )
    primitive: Any  # the lamp's number, as in `light_primitive`
    error: Any  # bound of the point's distance from the surface


@device
def sample_lamp(scene, choice, u):
    """Chooses a small lamp and a point on it; returns its LampPoint. choice, u: three random numbers in [0, 1)."""
    number, _, chance = sample_cdf(scene.caustics.lamp_cdf, choice)
    primitive = np.int64(scene.caustics.lamp[number])
    triangles, spheres = len(scene.triangle), len(scene.sphere)
    if primitive < triangles:
        i, j, k, _ = row(scene.triangle, primitive, 4)
        a, b, c = row(scene.position, i, 3), row(scene.position, j, 3), row(scene.position, k, 3)
        v, w = square_to_triangle(u)
        first, second = vec.sub(b, a), vec.sub(c, a)
        cross = vec.cross(first, second)
        twice = vec.length(cross)
        point = vec.add(a, vec.add(vec.scale(first, v), vec.scale(second, w)))
        error = _MARGIN * vec.magnitude(point)
        return LampPoint(AREA, point, vec.scale(cross, _ONE / twice), chance / (_HALF * twice), primitive, error)
    if primitive < triangles + spheres:
        x, y, z, radius = row(scene.sphere, primitive - triangles, 4)
        normal = square_to_sphere(u)
        point = vec.add((x, y, z), vec.scale(normal, radius))
        error = _MARGIN * (vec.magnitude((x, y, z)) + radius)
        return LampPoint(AREA, point, normal, chance / (_4PI * radius * radius), primitive, error)
    alone = primitive - triangles - spheres
    kind = scene.punctual_kind[alone]
    told = row(scene.punctual, alone, 12)
    place, extent = told[0:3], told[9]
    if kind == DIRECTIONAL or kind >= SUN:
        if extent > _ZERO:
            s, t = vec.basis(place)
            w = vec.to_world(s, t, place, square_to_cone(u, extent))
            return LampPoint(DISTANT, w, _BLACK, chance * square_to_cone_pdf(extent), primitive, _ZERO)
        return LampPoint(DISTANT, place, _BLACK, chance, primitive, _ZERO)
    if extent > _ZERO:
        normal = square_to_sphere(u)
        point = vec.add(place, vec.scale(normal, extent))
        return LampPoint(AREA, point, normal, chance / (_4PI * extent * extent), primitive, _ZERO)
    return LampPoint(PLACE, place, _BLACK, chance, primitive, _ZERO)


@device
def lamp_light(scene, lamp, start, direction):
    """Returns what a lamp sends to the point `start`: its radiance, intensity or irradiance, rgb, by the kind of the LampPoint.

    direction: from `start` to the lamp, unit.
    """
    triangles, spheres = len(scene.triangle), len(scene.sphere)
    if lamp.primitive < triangles + spheres:
        front = vec.dot(lamp.normal, direction) < _ZERO
        uv = _ZERO, _ZERO
        return emission(scene, material_number(scene, lamp.primitive), uv, uv, front, None)
    alone = lamp.primitive - triangles - spheres
    kind = scene.punctual_kind[alone]
    told = row(scene.punctual, alone, 12)
    place, shines, value = told[0:3], told[3:6], told[6:9]
    if lamp.kind == DISTANT:
        return value
    strength = _ONE
    if kind != POINT:
        strength = spot_falloff(kind, vec.dot(vec.normalize(vec.sub(start, place)), shines), told[10], told[11])
    if lamp.kind == AREA and not vec.dot(lamp.normal, direction) < _ZERO:
        strength = _ZERO
    return vec.scale(value, strength)
