"""The local geometry of a caster (an object with smooth interfaces, renderer/scene/caustics.py) where a ray hits it.

The shading normal is a function of the position on a facet: interpolated between vertices, or a sphere's.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from renderer.arrays import rows
from renderer.arrays.rows import COLUMNS
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.fetch import columns, row
from renderer.kernel.surface.consistent_normals import is_consistent
from renderer.kernel.surface.surface import LEAST_COSINE, POINT_ERROR

__all__ = ["CasterPoint", "caster_of", "caster_point", "index_of", "material_number", "normal_change"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_BLACK = (_ZERO, _ZERO, _ZERO)
_UNIT = np.float32(1e-6)
_NONE = np.int32(-1)


class CasterPoint(NamedTuple):
    """A point on a caster. Both normals are unit and on the viewer's side."""

    point: Any
    error: Any  # bound of the point's distance from the surface
    geometric: Any
    normal: Any  # for shading
    front: Any  # whether the viewer is on the front
    regular: Any  # whether paths use the shading normal as it is, not bent towards the viewer
    # The derivative of the shading normal before normalisation: curvature * dp + along_u * (u . dp) + along_v * (v . dp).
    curvature: Any
    u: Any
    along_u: Any
    v: Any
    along_v: Any


@device
def caster_of(scene, hit):
    """Returns the index of the caster to which a Hit belongs, or -1."""
    if hit.primitive < 0 or hit.instance >= 0:
        return _NONE
    number = np.int64(hit.primitive)
    triangles = len(scene.triangle)
    if number < triangles:
        return scene.caustics.part_caster[scene.triangle[number, 3]]
    return scene.caustics.sphere_caster[number - triangles]


@device
def material_number(scene, primitive):
    """Returns the number of a primitive's material. primitive: of a caster."""
    number = np.int64(primitive)
    triangles = len(scene.triangle)
    if number < triangles:
        return scene.part[scene.triangle[number, 3], rows.PART_MATERIAL]
    return scene.sphere_material[number - triangles]


@device
def index_of(scene, material, front):
    """Returns a glass material's index of refraction beyond the surface over that on the viewer's side."""
    ior = columns(scene.material, material, COLUMNS, rows.IOR, 1)[0]
    return ior if front else _ONE / ior


@device
def caster_point(scene, o, d, hit):
    """Returns the CasterPoint at a Hit by the ray o + t d (d unit). The hit must be on a caster."""
    wo = vec.neg(d)
    number = np.int64(hit.primitive)
    triangles = len(scene.triangle)
    if number < triangles:
        i, j, k, _ = row(scene.triangle, hit.primitive, 4)
        a, b, c = row(scene.position, i, 3), row(scene.position, j, 3), row(scene.position, k, 3)
        na, nb, nc = row(scene.normal, i, 3), row(scene.normal, j, 3), row(scene.normal, k, 3)
        w = _ONE - hit.u - hit.v
        point = vec.add(vec.add(vec.scale(a, w), vec.scale(b, hit.u)), vec.scale(c, hit.v))
        error = POINT_ERROR * (w * vec.magnitude(a) + hit.u * vec.magnitude(b) + hit.v * vec.magnitude(c))
        first, second = vec.sub(b, a), vec.sub(c, a)
        cross = vec.cross(first, second)
        square = vec.dot(cross, cross)
        inverse = _ONE / square
        front = vec.dot(cross, wo) > _ZERO
        geometric = vec.scale(cross, math.sqrt(inverse) if front else -math.sqrt(inverse))
        raw = vec.add(vec.add(vec.scale(na, w), vec.scale(nb, hit.u)), vec.scale(nc, hit.v))
        length2 = vec.dot(raw, raw)
        smooth = not abs(length2 - _ONE) <= _UNIT
        sign = _ONE if vec.dot(raw, geometric) >= _ZERO else -_ONE
        scale = sign / math.sqrt(length2)
        normal, along_u, along_v = geometric, _BLACK, _BLACK
        if length2 > _ZERO:
            normal = vec.scale(raw, scale)
            along_u, along_v = vec.scale(vec.sub(nb, na), scale), vec.scale(vec.sub(nc, na), scale)
        u, v = vec.scale(vec.cross(second, cross), inverse), vec.scale(vec.cross(cross, first), inverse)
        curvature = _ZERO
        consistent = is_consistent(normal, geometric, wo)
        regular = square > _ZERO and vec.dot(normal, wo) >= LEAST_COSINE and (consistent or not smooth)
        return CasterPoint(point, error, geometric, normal, front, regular, curvature, u, along_u, v, along_v)
    x, y, z, radius = row(scene.sphere, number - triangles, 4)
    center = x, y, z
    outward = vec.normalize(vec.sub(vec.add(o, vec.scale(d, hit.t)), center))
    point = vec.add(center, vec.scale(outward, radius))
    front = vec.dot(outward, wo) > _ZERO
    normal = outward if front else vec.neg(outward)
    curvature = _ONE / radius if front else -_ONE / radius
    regular = vec.dot(normal, wo) >= LEAST_COSINE
    error = POINT_ERROR * (vec.magnitude(center) + radius)
    return CasterPoint(point, error, normal, normal, front, regular, curvature, _BLACK, _BLACK, _BLACK, _BLACK)


@device
def normal_change(at, dp):
    """Returns the change of the unit shading normal at a CasterPoint for a small displacement dp within the surface."""
    change = vec.add(vec.scale(at.along_u, vec.dot(at.u, dp)), vec.scale(at.along_v, vec.dot(at.v, dp)))
    change = vec.add(change, vec.scale(dp, at.curvature))
    return vec.sub(change, vec.scale(at.normal, vec.dot(at.normal, change)))
