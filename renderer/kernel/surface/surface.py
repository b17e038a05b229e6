"""From a hit to a point to shade: position, normals, texture coordinates, and how far rounding may have moved it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from renderer.arrays.rows import DIFFUSE, PART_COLUMNS, TEXTURED
from renderer.jit import device, out_of_line, subroutine
from renderer.kernel import vec
from renderer.kernel.fetch import row
from renderer.kernel.polynomial import acos, atan2
from renderer.kernel.surface.carry import normal_to_world, point_to_world, tangent_to_world
from renderer.kernel.surface.consistent import consistent_normal
from renderer.kernel.surface.margins import edge_margins
from renderer.kernel.surface.terminator import lifted

__all__ = ["Surface", "departure", "leave", "leaves", "sphere_uv", "surface_at", "triangle_point"]

_ZERO = np.float32(0.0)
_THIRD = np.float32(1.0 / 3.0)
_QUARTER = np.float32(0.25)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_INV_PI = np.float32(1.0 / math.pi)
_INV_2PI = np.float32(0.5 / math.pi)
_NO_UV = (_ZERO, _ZERO)
_WHITE = (_ONE, _ONE, _ONE, _ONE)
_NO_TANGENT = (_ZERO, _ZERO, _ZERO, _ZERO)
_NOWHERE = (_ZERO, _ZERO, _ZERO)
_NO_LIGHT = np.int32(-1)
_UNIT = np.float32(1e-6)
_LEAST_BEND2 = np.float32(1e-12)
_LEAST_COSINE = np.float32(0.01)
# Bounds the error of a point (three roundings a coordinate, pbrt 4ed, 6.8.4) and of the next ray's distance to its plane.
_ERROR = np.float32(20 * 2.0**-24)
_INWARD = np.float32(1.5)  # of that, away from the triangle's edges: enough for walls that meet under 35 degrees
_FURTHEST = np.float32(12.0)
_TINY = np.float32(1e-30)
_SPHERE_ERROR = np.float32(1e-14)


class Surface(NamedTuple):
    """A point hit. Vectors are tuples of float32 in world space."""

    point: tuple[float, float, float]
    error: float  # how far the point may be off the surface
    geometric: tuple[float, float, float]  # unit normal of the true surface, on the viewer's side
    shading: tuple[float, float, float]  # unit normal to shade with, less than 90 degrees from the viewer, consistent
    uv: tuple[float, float]
    front: bool  # whether the viewer is on the triangle's counter-clockwise side, or outside the sphere
    material: int
    light: int  # its number among the lights, or -1
    object: int  # its number in the object id AOV
    uv1: tuple[float, float]  # the second set; the first where there is none
    color: tuple[float, float, float, float]  # the vertices' RGBA, white where they have none
    tangent: tuple[float, float, float, float]  # unit, and the bitangent's sign; zeros where the material needs none
    smooth: bool  # whether rays that scatter back start off the triangle's facet,
    lift: tuple[float, float, float]  # and how far from `point`


@device
def _mix3(a, b, c, u, v):
    w = _ONE - u - v
    return w * a[0] + u * b[0] + v * c[0], w * a[1] + u * b[1] + v * c[1], w * a[2] + u * b[2] + v * c[2]


@device
def _mix4(a, b, c, u, v):
    first = _mix3((a[0], a[1], a[2]), (b[0], b[1], b[2]), (c[0], c[1], c[2]), u, v)
    return first[0], first[1], first[2], (_ONE - u - v) * a[3] + u * b[3] + v * c[3]


@device
def triangle_point(position, triangle, number, u, v):
    """The point of a triangle at barycentric (u, v): (point, error, cross product of its edges)."""
    i, j, k, _ = row(triangle, number, 4)
    a, b, c = row(position, i, 3), row(position, j, 3), row(position, k, 3)
    error = _ERROR * ((_ONE - u - v) * vec.magnitude(a) + u * vec.magnitude(b) + v * vec.magnitude(c))
    return _mix3(a, b, c, u, v), error, vec.cross(vec.sub(b, a), vec.sub(c, a))


@subroutine
def _inward(scene, hit, error, curvature):
    """The way by which a point beside an edge is moved towards its triangle's centroid, in the world.

    Rounded, a point beside an edge may lie on the other side of the wall that the triangle meets there, and what starts there
    leaves the room; so may what starts off it by `error`, where the walls meet under an acute angle. Moved towards the centroid
    by a multiple of `error` over the inscribed circle's radius, it does not. In slivers the move is limited, so that it cannot
    be seen.
    """
    out_of_line()
    i, j, k, _ = row(scene.triangle, hit.primitive, 4)
    a, b, c = row(scene.position, i, 3), row(scene.position, j, 3), row(scene.position, k, 3)
    u, v = hit.u - _THIRD, hit.v - _THIRD
    inward = vec.add(vec.scale(vec.sub(a, b), u), vec.scale(vec.sub(a, c), v))
    if scene.has.instances is not None and hit.instance >= 0:
        inward = point_to_world(scene.to_world, hit.instance, inward, _ZERO)
    fraction = min(_INWARD * error * curvature, _QUARTER)
    far = vec.magnitude(inward)
    if fraction * far > _FURTHEST * error:
        fraction = _FURTHEST * error / far
    return vec.scale(inward, fraction)


@device
def triangle_uv(uv, triangle, number, u, v):
    """The texture coordinates of a triangle at barycentric (u, v)."""
    i, j, k, _ = row(triangle, number, 4)
    a, b, c = row(uv, i, 2), row(uv, j, 2), row(uv, k, 2)
    w = _ONE - u - v
    return w * a[0] + u * b[0] + v * c[0], w * a[1] + u * b[1] + v * c[1]


@subroutine
def sphere_uv(n):
    """A sphere's texture coordinates by its outward normal, laid out as an environment's: north is +y, the middle is -z."""
    return _HALF + atan2(n[0], -n[2]) * _INV_2PI, acos(n[1]) * _INV_PI


@subroutine
def sphere_point(sphere, number, o, d, t):
    """The point o + t d put back on the sphere: (point, error, outward unit normal).

    In double precision: the centre of a sphere of radius 1e5 is too far away for float32 to tell the point's height.
    """
    center_x, center_y, center_z, radius = row(sphere, number, 4)
    cx, cy, cz = np.float64(center_x), np.float64(center_y), np.float64(center_z)
    x = np.float64(o[0]) + np.float64(t) * np.float64(d[0])
    y = np.float64(o[1]) + np.float64(t) * np.float64(d[1])
    z = np.float64(o[2]) + np.float64(t) * np.float64(d[2])
    nx, ny, nz = x - cx, y - cy, z - cz
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    inward = np.float64(radius) / length
    point = (np.float32(cx + nx * inward), np.float32(cy + ny * inward), np.float32(cz + nz * inward))
    normal = (np.float32(nx / length), np.float32(ny / length), np.float32(nz / length))
    # Seen from there, float64 rounds the height above a sphere to some 1e-16 of its radius: more, beside the origin.
    return point, _ERROR * vec.magnitude(point) + _SPHERE_ERROR * abs(radius), normal


@device
def _tangent(array, i, j, k, u, v):
    """The tangent between three vertices; their signs agree (renderer/scene/tangents.py)."""
    x, y, z, sign = _mix4(row(array, i, 4), row(array, j, 4), row(array, k, 4), u, v)
    square = x * x + y * y + z * z
    if not square > _ZERO:
        return _NO_TANGENT
    scale = _ONE / math.sqrt(square)
    return x * scale, y * scale, z * scale, _ONE if sign > _ZERO else -_ONE


@device
def _facing(shading, geometric, wo):
    """The shading normal on the geometric one's side, and bent towards the viewer where it would look away."""
    if vec.dot(shading, geometric) < _ZERO:
        shading = vec.neg(shading)
    cosine = vec.dot(shading, wo)
    if cosine < _LEAST_COSINE:
        shading = vec.normalize(vec.add(shading, vec.scale(wo, _LEAST_COSINE - cosine)))
        if not vec.dot(shading, wo) > _ZERO:
            return geometric
    return shading


@device
def _is_textured(scene, material):
    return scene.material_flags[material] & TEXTURED != 0


@device
def surface_at(scene, o, d, hit):
    """The surface that the ray o + t d (d unit) meets at a Hit of `closest_hit`."""
    t, primitive, u, v = hit.t, np.uint32(hit.primitive), hit.u, hit.v
    wo = vec.neg(d)
    triangles = len(scene.triangle)
    color, tangent = _WHITE, _NO_TANGENT
    smooth, lift = False, _NOWHERE
    if primitive < triangles:
        i, j, k, part = row(scene.triangle, primitive, 4)
        part_material, number, shines = row(scene.part, part, PART_COLUMNS)
        material = np.uint32(part_material)
        # All up to the corners' normals is in the instance's space, if the triangle is in one.
        point, error, normal = triangle_point(scene.position, scene.triangle, primitive, u, v)
        curvature, miss = edge_margins(row(scene.position, i, 3), row(scene.position, j, 3), row(scene.position, k, 3), normal)
        error = max(error, miss)
        upright = normal
        if scene.has.instances is not None and hit.instance >= 0:
            normal = normal_to_world(scene.bvh.to_local, hit.instance, normal)
        square = vec.dot(normal, normal)
        if square == _ZERO:  # so small that its area is 0 in float32
            normal = wo
            square = _ONE
        front = vec.dot(normal, wo) > _ZERO
        away = _ONE / math.sqrt(square)
        geometric = vec.scale(normal, away if front else -away)
        shading = _mix3(row(scene.normal, i, 3), row(scene.normal, j, 3), row(scene.normal, k, 3), u, v)
        if scene.has.textures is not None and len(scene.tangent) > 0:
            tangent = _tangent(scene.tangent, i, j, k, u, v)
        length2 = vec.dot(shading, shading)
        smooth = not abs(length2 - _ONE) <= _UNIT  # or no normal at all; flat meshes are spared the root
        if smooth:
            lift = lifted(scene, point, primitive, u, v, shading, upright if front else vec.neg(upright))
            if hit.instance < 0:
                shading = vec.scale(shading, _ONE / math.sqrt(length2)) if length2 > _ZERO else geometric
        if scene.has.instances is not None and hit.instance >= 0:
            point = point_to_world(scene.to_world, hit.instance, point, _ONE)
            lift = point_to_world(scene.to_world, hit.instance, lift, _ZERO)
            error = scene.instance_stretch[hit.instance, 0] * error + _ERROR * vec.magnitude(point)
            curvature /= max(scene.instance_stretch[hit.instance, 1], _TINY)
            shading = normal_to_world(scene.bvh.to_local, hit.instance, shading)
            length2 = vec.dot(shading, shading)
            shading = vec.scale(shading, _ONE / math.sqrt(length2)) if length2 > _ZERO else geometric
            if scene.has.textures is not None and len(scene.tangent) > 0:
                tangent = tangent_to_world(scene, hit.instance, tangent)
            number = scene.instance_object[hit.instance]
            if scene.instance_material[hit.instance] >= 0:
                material = np.uint32(scene.instance_material[hit.instance])
        if min(_ONE - u - v, min(u, v)) < _INWARD * error * curvature:  # else it is as far from the edges as it would be moved
            point = vec.add(point, _inward(scene, hit, error, curvature))
        uv = uv1 = _NO_UV
        if scene.has.textures is not None:
            uv = triangle_uv(scene.uv, scene.triangle, primitive, u, v) if _is_textured(scene, material) else _NO_UV
            uv1 = triangle_uv(scene.uv1, scene.triangle, primitive, u, v) if len(scene.uv1) > 0 else uv
        if scene.has.textures is not None and len(scene.color) > 0:
            color = _mix4(row(scene.color, i, 4), row(scene.color, j, 4), row(scene.color, k, 4), u, v)
        light = scene.triangle_light[primitive] if shines != 0 else _NO_LIGHT
    else:
        ball = primitive - triangles
        material = np.uint32(scene.sphere_material[ball])
        point, error, normal = sphere_point(scene.sphere, ball, o, d, t)
        front = vec.dot(normal, wo) > _ZERO
        geometric = normal if front else vec.neg(normal)
        shading = normal
        uv = sphere_uv(normal) if scene.has.textures is not None and _is_textured(scene, material) else _NO_UV
        uv1 = uv
        light = scene.sphere_light[ball]
        number = scene.sphere_object[ball]
    shading = _facing(shading, geometric, wo)
    if smooth and scene.material_kind[material] != DIFFUSE:  # what reflects nothing keeps its normal, whoever looks at it
        shading = consistent_normal(shading, geometric, wo)
    return Surface(point, error, geometric, shading, uv, front, material, light, number, uv1, color, tangent, smooth, lift)


@device
def leaves(surface, reflected, d):
    """Whether a ray of direction d goes where it was scattered to: above the facet if it was `reflected`, else below it.

    About a bent normal light may be scattered above the shading horizon and below the facet's. It then meets the facet again.
    """
    return (vec.dot(surface.geometric, d) > _ZERO) == reflected


@device
def departure(surface, reflected, d):
    """Where the ray of unit direction d starts that leaves the surface, on the viewer's side where it is `reflected`.

    From a smooth triangle it starts above the facet, the more so the lower it goes: facing rays start where they should, so
    that what touches the surface still throws its shadow. A reflected ray that points below a flat facet meets the facet
    itself: a bent normal lets no light through.
    """
    error = surface.error if reflected else -surface.error
    start = vec.add(surface.point, vec.scale(surface.geometric, error))
    if surface.smooth and reflected:
        cosine = max(vec.dot(surface.geometric, d), _ZERO)
        bend2 = max(_TWO - _TWO * vec.dot(surface.shading, surface.geometric), _LEAST_BEND2)
        start = vec.add(start, vec.scale(surface.lift, max(_ONE - cosine * cosine / bend2, _ZERO)))
    return start


@device
def leave(point, error, normal, towards):
    """The point moved off its surface, to the side that `towards` is on: where a ray may start without meeting it again."""
    distance = error if vec.dot(normal, towards) > _ZERO else -error
    return vec.add(point, vec.scale(normal, distance))
