"""Surface interaction at a hit: position, normals, texture coordinates, and a bound of the rounding error."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from renderer.arrays.rows import DIFFUSE, HAIR, HUANG, PART_COLUMNS, PART_MATERIAL, PART_OBJECT, TEXTURED
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.fetch import row
from renderer.kernel.polynomial import acos, atan2
from renderer.kernel.surface.consistent_normals import consistent_normal
from renderer.kernel.surface.edge_margins import edge_margins
from renderer.kernel.surface.shapes import ball_at, corner_normals_at, corners_at
from renderer.kernel.surface.terminator import lifted
from renderer.kernel.surface.to_world import normal_of_hit, point_of_hit, tangent_to_world
from renderer.wide.values import any_of, double, lookup, not_, single, u32, where, where3, zero_like

__all__ = [
    "LEAST_COSINE",
    "NO_LIGHT",
    "NO_OBJECT",
    "POINT_ERROR",
    "Surface",
    "is_emissive",
    "moving_triangle_point",
    "owner_at",
    "sphere_at",
    "sphere_uv",
    "surface_at",
    "triangle_at",
    "triangle_point",
]

_ZERO = np.float32(0.0)
_THIRD = np.float32(1.0 / 3.0)
_QUARTER = np.float32(0.25)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_INV_PI = np.float32(1.0 / math.pi)
_INV_2PI = np.float32(0.5 / math.pi)
NO_LIGHT = NO_OBJECT = np.uint32(0xFFFFFFFF)
_NOTHING = np.uint32(0)
_DIFFUSE, _HAIR, _HUANG = np.uint32(DIFFUSE), np.uint32(HAIR), np.uint32(HUANG)
_TEXTURED = np.uint32(TEXTURED)
_UNIT = np.float32(1e-6)
LEAST_COSINE = np.float32(0.01)  # between shading normal and viewer: normals that face away further are bent
# Bounds the error of a point (three roundings a coordinate, pbrt 4ed, 6.8.4) and of the next ray's distance to its plane.
POINT_ERROR = np.float32(20 * 2.0**-24)
_INWARD = np.float32(1.5)  # multiple of `error` by which points move away from edges: enough for walls at an angle of 35 degrees
_FURTHEST = np.float32(12.0)
_TINY = np.float32(1e-30)
_SPHERE_ERROR = np.float32(1e-14)
_OFF_CURVE = np.float32(2.0**-9)  # of a curve's diameter: its surface is not quite round where the radius changes along it


class Surface(NamedTuple):
    """A point where a ray hits a surface, with all that scattering needs. Vectors are tuples of float32 in world space."""

    point: tuple[float, float, float]
    error: float  # bound of the point's distance from the surface
    geometric: tuple[float, float, float]  # unit normal of the true surface, on the viewer's side
    shading: tuple[float, float, float]  # unit normal to shade with, less than 90 degrees from the viewer, consistent
    uv: tuple[float, float]
    front: bool  # whether the viewer is on the triangle's counter-clockwise side, or outside the sphere
    material: int
    light: int  # its number among the lights, or NO_LIGHT
    object: int  # its number in the object id AOV
    uv1: tuple[float, float]  # the second set; the first where there is none
    color: tuple[float, float, float, float]  # vertex colour RGBA, white if there is none
    tangent: tuple[float, float, float, float]  # unit, and the bitangent's sign; zeros if the material needs none
    smooth: bool  # whether reflected rays start above the triangle's facet,
    lift: tuple[
        float, float, float
    ]  # offset of their origin from `point`; of curves, which are not smooth, the axis times the radius


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
    """Returns (point, error bound, cross product of the edges) of a triangle at barycentric (u, v)."""
    i, j, k, _ = row(triangle, number, 4)
    return _between(row(position, i, 3), row(position, j, 3), row(position, k, 3), u, v)


@device
def _between(a, b, c, u, v):
    """Returns (point, error bound, cross product of the edges) at barycentric (u, v) of a triangle given by its three corners."""
    error = POINT_ERROR * ((_ONE - u - v) * vec.magnitude(a) + u * vec.magnitude(b) + v * vec.magnitude(c))
    return _mix3(a, b, c, u, v), error, vec.cross(vec.sub(b, a), vec.sub(c, a))


@subroutine
def moving_triangle_point(scene, number, u, v, time):
    """Returns (point, error bound, cross product of the edges) of a moving triangle at a shutter time."""
    i, j, k, _ = row(scene.triangle, number, 4)
    a, b, c = corners_at(scene, i, j, k, time)
    return _between(a, b, c, u, v)


@subroutine
def _inward(scene, hit, error, curvature):
    """Returns the offset, in world space, that moves a point near an edge towards its triangle's centroid.

    A point near an edge may be rounded to the far side of an adjoining wall, so that rays from it leave the room; so may an
    origin offset by `error` where walls form an acute angle. Moving it by a multiple of `error` divided by the inscribed circle's
    radius prevents that. In slivers the move is limited, so that it remains invisible.
    """
    never_inline()
    i, j, k, _ = row(scene.triangle, hit.primitive, 4)
    a, b, c = corners_at(scene, i, j, k, hit.time)
    u, v = hit.u - _THIRD, hit.v - _THIRD
    inward = vec.add(vec.scale(vec.sub(a, b), u), vec.scale(vec.sub(a, c), v))
    if hit.instance is not None and hit.instance >= 0:
        inward = point_of_hit(scene, hit, inward, _ZERO)
    fraction = min(_INWARD * error * curvature, _QUARTER)
    far = vec.magnitude(inward)
    fraction = where(fraction * far > _FURTHEST * error, _FURTHEST * error / far, fraction)
    return vec.scale(inward, fraction)


@device
def triangle_uv(uv, triangle, number, u, v):
    """Returns the texture coordinates of triangle number `number` at barycentric (u, v). uv, triangle: tables of the scene."""
    i, j, k, _ = row(triangle, number, 4)
    a, b, c = row(uv, i, 2), row(uv, j, 2), row(uv, k, 2)
    w = _ONE - u - v
    return w * a[0] + u * b[0] + v * c[0], w * a[1] + u * b[1] + v * c[1]


@subroutine
def sphere_uv(n):
    """Returns a sphere's texture coordinates from its outward normal, laid out as for environments: +y up, -z in the middle."""
    return _HALF + atan2(n[0], -n[2]) * _INV_2PI, acos(n[1]) * _INV_PI


@subroutine
def sphere_point(sphere, number, o, d, t):
    """Returns the point o + t d projected onto sphere `number`: (point, error bound, outward unit normal).

    Computed in float64: for a radius of 1e5, float32 cannot represent the point's distance from the surface.
    """
    return _project_onto_sphere(row(sphere, number, 4), o, d, t)


@subroutine
def _moving_sphere_point(ball, o, d, t):
    """Returns the point o + t d projected onto a sphere given by its centre and radius; see `sphere_point`."""
    return _project_onto_sphere(ball, o, d, t)


@device
def _project_onto_sphere(ball, o, d, t):
    center_x, center_y, center_z, radius = ball
    cx, cy, cz = double(center_x), double(center_y), double(center_z)
    far = double(t)
    x = double(o[0]) + far * double(d[0])
    y = double(o[1]) + far * double(d[1])
    z = double(o[2]) + far * double(d[2])
    nx, ny, nz = x - cx, y - cy, z - cz
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    inward = double(radius) / length
    point = (single(cx + nx * inward), single(cy + ny * inward), single(cz + nz * inward))
    normal = (single(nx / length), single(ny / length), single(nz / length))
    # The height above a sphere is rounded in float64 by some 1e-16 of the radius, by more if the sphere is far from the origin.
    return point, POINT_ERROR * vec.magnitude(point) + _SPHERE_ERROR * abs(radius), normal


@device
def _sphere_point_at(scene, number, o, d, hit):
    if hit.time is not None and len(scene.key_sphere) > 0:
        return _moving_sphere_point(ball_at(scene, number, hit.time), o, d, hit.t)
    return sphere_point(scene.sphere, number, o, d, hit.t)


@device
def _tangent(array, i, j, k, u, v):
    """Returns the tangent interpolated between three vertices i, j, k. They have the same sign (renderer/scene/tangents.py)."""
    x, y, z, sign = _mix4(row(array, i, 4), row(array, j, 4), row(array, k, 4), u, v)
    square = x * x + y * y + z * z
    there = square > _ZERO
    scale = where(there, _ONE / math.sqrt(square), _ZERO)
    return x * scale, y * scale, z * scale, where(there, where(sign > _ZERO, _ONE, -_ONE), _ZERO)


@device
def is_hair(scene, material):
    """Returns True if a material is hair: its surfaces are shaded as round fibres."""
    kind = u32(lookup(scene.material_kind, material))
    if scene.has.huang is not None:
        return (kind == _HAIR) | (kind == _HUANG)
    return kind == _HAIR


@device
def _diameter(scene, hit, i, j, k, u, v):
    """Returns the diameter in world space of the fibre around which a triangle i, j, k of hair lies."""
    a, b, c = row(scene.tangent, i, 4)[3], row(scene.tangent, j, 4)[3], row(scene.tangent, k, 4)[3]
    diameter = abs((_ONE - u - v) * a + u * b + v * c)
    if hit.instance is not None and hit.instance >= 0:
        diameter *= scene.instance_stretch[hit.instance, 0]
    return diameter


@device
def _facing(shading, geometric, wo):
    """Returns the shading normal in world space, on the geometric normal's side, rotated towards the viewer if it faces away."""
    shading = where3(vec.dot(shading, geometric) < _ZERO, vec.neg(shading), shading)
    cosine = vec.dot(shading, wo)
    low = cosine < LEAST_COSINE
    if any_of(low):
        bent = vec.normalize(vec.add(shading, vec.scale(wo, LEAST_COSINE - cosine)))
        bent = where3(vec.dot(bent, wo) > _ZERO, bent, geometric)
        shading = where3(low, bent, shading)
    return shading


@device
def _is_textured(scene, material):
    return u32(u32(lookup(scene.material_flags, material)) & _TEXTURED) != _NOTHING


@device
def _across_curve(tangent, wo):
    """Returns unit vectors (across a curve; up, towards wo) perpendicular to its axis. tangent: unit, along the axis."""
    axis = tangent[0], tangent[1], tangent[2]
    across = vec.cross(axis, wo)
    square = vec.dot(across, across)
    seen = square > _TINY  # or along the axis
    across = where3(seen, vec.scale(across, _ONE / math.sqrt(max(square, _TINY))), across)
    return across, where3(seen, vec.cross(across, axis), wo)


@device
def _triangle_surface(scene, wo, hit):
    """Returns the Surface at the hit of a triangle or a curve, before its shading normal is turned to the viewer."""
    primitive, u, v = u32(hit.primitive), hit.u, hit.v
    i, j, k, part = row(scene.triangle, primitive, 4)
    part_material, number, shines = row(scene.part, part, PART_COLUMNS)
    material = u32(part_material)
    none = zero_like(u)
    one = none + _ONE
    color, tangent = (one, one, one, one), (none, none, none, none)
    # Up to the corners' normals everything is in instance space, if the triangle is in an instance.
    corners = corners_at(scene, i, j, k, hit.time)
    point, error, normal = _between(*corners, u, v)
    curvature, miss = edge_margins(*corners, normal)
    error = max(error, miss)
    upright = normal
    if hit.instance is not None and hit.instance >= 0:
        normal = normal_of_hit(scene, hit, normal)
    square = vec.dot(normal, normal)
    flat = square == _ZERO  # area is 0 in float32
    normal = where3(flat, wo, normal)
    square = where(flat, _ONE, square)
    front = vec.dot(normal, wo) > _ZERO
    away = _ONE / math.sqrt(square)
    geometric = vec.scale(normal, where(front, away, -away))
    normals = corner_normals_at(scene, i, j, k, hit.time)
    shading = _mix3(*normals, u, v)
    if scene.has.textures is not None and len(scene.tangent) > 0:
        tangent = _tangent(scene.tangent, i, j, k, u, v)
    length2 = vec.dot(shading, shading)
    smooth = not_(abs(length2 - _ONE) <= _UNIT)  # or without a normal; avoids the root for flat meshes
    if scene.has.hair is not None:
        curved = u32(j) == u32(k)
        smooth = smooth & not_(curved)
        front = front | curved  # the normal of their triangle (a, b, b) is a rounding error
    lift = none, none, none
    if any_of(smooth):
        raised = lifted(corners, normals, point, u, v, shading, where3(front, upright, vec.neg(upright)))
        lift = where3(smooth, raised, lift)
        if hit.instance is not None and hit.instance >= 0:
            pass  # normalised in world space
        else:
            unit = where3(length2 > _ZERO, vec.scale(shading, _ONE / math.sqrt(length2)), geometric)
            shading = where3(smooth, unit, shading)
    if hit.instance is not None and hit.instance >= 0:
        point = point_of_hit(scene, hit, point, _ONE)
        lift = point_of_hit(scene, hit, lift, _ZERO)
        error = scene.instance_stretch[hit.instance, 0] * error + POINT_ERROR * vec.magnitude(point)
        curvature /= max(scene.instance_stretch[hit.instance, 1], _TINY)
        shading = normal_of_hit(scene, hit, shading)
        length2 = vec.dot(shading, shading)
        shading = vec.scale(shading, _ONE / math.sqrt(length2)) if length2 > _ZERO else geometric
        if scene.has.textures is not None and len(scene.tangent) > 0:
            tangent = tangent_to_world(scene, hit, tangent)
        number = scene.instance_object[hit.instance]
        if scene.instance_material[hit.instance] >= 0:
            material = np.uint32(scene.instance_material[hit.instance])
    beside = min(_ONE - u - v, min(u, v)) < _INWARD * error * curvature  # otherwise the point is far enough from the edges
    if scene.has.hair is not None:
        beside = beside & not_(curved)
    if any_of(beside):
        moved = vec.add(point, _inward(scene, hit, error, curvature))
        point = where3(beside, moved, point)
    if scene.has.hair is not None and len(scene.tangent) > 0:
        # Rays that a tube of triangles transmits start on its far side, which they would hit again otherwise. Those of round
        # curves start where they leave the curve (ray_origins.py).
        hair = is_hair(scene, material)
        if any_of(hair | curved):
            diameter = _diameter(scene, hit, i, j, k, u, v)
            error = where(hair | curved, max(error, diameter), error)
            lift = where3(hair, (none, none, none), lift)
        if any_of(curved):
            h, radius = (u - v) * tangent[3], _HALF * diameter
            across, up = _across_curve(tangent, wo)
            # Hair is round. Other curves are flat, face the ray, and contain the axis: all rays from them start beyond the curve.
            above = where(hair, math.sqrt(max(_ONE - h * h, _ZERO)), one)
            aside = vec.scale(across, h)
            normal = vec.add(where3(hair, aside, (none, none, none)), vec.scale(up, above))
            place = where3(hair, normal, aside)
            point = where3(curved, vec.add(point, vec.scale(place, radius)), point)
            error = where(curved & hair, diameter * _OFF_CURVE + POINT_ERROR * vec.magnitude(point), error)
            lift = where3(curved & hair, vec.scale((tangent[0], tangent[1], tangent[2]), radius), lift)
            geometric = where3(curved, normal, geometric)
            shading = where3(curved, normal, shading)
    uv = uv1 = none, none
    if scene.has.textures is not None:
        if any_of(_is_textured(scene, material)):
            uv = triangle_uv(scene.uv, scene.triangle, primitive, u, v)
        uv1 = triangle_uv(scene.uv1, scene.triangle, primitive, u, v) if len(scene.uv1) > 0 else uv
    if scene.has.textures is not None and len(scene.color) > 0:
        color = _mix4(row(scene.color, i, 4), row(scene.color, j, 4), row(scene.color, k, 4), u, v)
    shining = shines != _NOTHING
    light = u32(zero_like(material) | NO_LIGHT)
    if any_of(shining):
        light = where(shining, u32(lookup(scene.triangle_light, primitive)), NO_LIGHT)
    return Surface(point, error, geometric, shading, uv, front, material, light, u32(number), uv1, color, tangent, smooth, lift)


@device
def _sphere_surface(scene, o, d, hit):
    """Returns the Surface at a sphere's hit by the ray o + t d, before its shading normal is turned to the viewer."""
    ball = u32(u32(hit.primitive) - u32(len(scene.triangle)))
    wo = vec.neg(d)
    material = u32(lookup(scene.sphere_material, ball))
    point, error, normal = _sphere_point_at(scene, ball, o, d, hit)
    front = vec.dot(normal, wo) > _ZERO
    geometric = where3(front, normal, vec.neg(normal))
    none = zero_like(hit.t)
    one = none + _ONE
    uv = none, none
    if scene.has.textures is not None and any_of(_is_textured(scene, material)):
        uv = sphere_uv(normal)
    light, number = u32(lookup(scene.sphere_light, ball)), u32(lookup(scene.sphere_object, ball))
    smooth = none != none
    lift = none, none, none
    return Surface(
        point,
        error,
        geometric,
        normal,
        uv,
        front,
        material,
        light,
        number,
        uv,
        (one, one, one, one),
        (none, none, none, none),
        smooth,
        lift,
    )


@device
def _with_normal_towards_viewer(scene, surface, wo):
    """Returns the Surface with its shading normal turned to the viewer, and made consistent with the facet if necessary."""
    shading = _facing(surface.shading, surface.geometric, wo)
    # Materials without reflection keep their normal for any view direction.
    bent = surface.smooth & (u32(lookup(scene.material_kind, surface.material)) != _DIFFUSE)
    geometric, smooth = surface.geometric, surface.smooth
    if scene.has.hair is not None:  # a fibre is round for the rays that leave it, too
        hair = is_hair(scene, surface.material)
        bent, smooth = bent & not_(hair), smooth & not_(hair)
        geometric = where3(hair, shading, geometric)
    if any_of(bent):
        shading = where3(bent, consistent_normal(shading, surface.geometric, wo), shading)
    return Surface(
        surface.point,
        surface.error,
        geometric,
        shading,
        surface.uv,
        surface.front,
        surface.material,
        surface.light,
        surface.object,
        surface.uv1,
        surface.color,
        surface.tangent,
        smooth,
        surface.lift,
    )


@device
def triangle_at(scene, d, hit):
    """Returns the Surface at a triangle's Hit by a ray of unit direction d; for one ray or for eight lanes."""
    wo = vec.neg(d)
    return _with_normal_towards_viewer(scene, _triangle_surface(scene, wo, hit), wo)


@device
def sphere_at(scene, o, d, hit):
    """Returns the Surface at a sphere's Hit by the ray o + t d (d unit); for one ray or for eight lanes."""
    return _with_normal_towards_viewer(scene, _sphere_surface(scene, o, d, hit), vec.neg(d))


@device
def surface_at(scene, o, d, hit):
    """Returns the Surface at a Hit from `closest_hit` by the ray o + t d (d unit)."""
    wo = vec.neg(d)
    if np.uint32(hit.primitive) < len(scene.triangle):
        surface = _triangle_surface(scene, wo, hit)
    else:
        surface = _sphere_surface(scene, o, d, hit)
    return _with_normal_towards_viewer(scene, surface, wo)


@subroutine
def owner_at(scene, hit):
    """Returns (object, material), as in the Surface at a Hit of one ray, without computing the rest of it."""
    never_inline()
    if np.uint32(hit.primitive) < len(scene.triangle):
        part = scene.triangle[hit.primitive, 3]
        number, material = np.uint32(scene.part[part, PART_OBJECT]), np.uint32(scene.part[part, PART_MATERIAL])
        if hit.instance >= 0:
            number = np.uint32(scene.instance_object[hit.instance])
            if scene.instance_material[hit.instance] >= 0:
                material = np.uint32(scene.instance_material[hit.instance])
    else:
        ball = np.int64(hit.primitive) - len(scene.triangle)
        number, material = np.uint32(scene.sphere_object[ball]), np.uint32(scene.sphere_material[ball])
    return number, material


@device
def is_emissive(surface):
    """Returns True if the surface belongs to a light."""
    return surface.light != NO_LIGHT
