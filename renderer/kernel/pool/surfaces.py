"""Stage 2: where the rays end: in the environment, or on surfaces, which may shine and are made ready to scatter."""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import BASE, COLUMNS, CONDUCTOR, GLASS, MIRROR, ROUGHNESS, UNLIT
from renderer.bvh.traverse import Hit
from renderer.jit import device, out_of_line, subroutine, template
from renderer.kernel import vec
from renderer.kernel.bsdf.rough_glass import SMOOTH_GLASS
from renderer.kernel.fetch import columns
from renderer.kernel.integrators.strategy import power_heuristic
from renderer.kernel.integrators.transport import limited
from renderer.kernel.light.lights import environment_seen, primitive_light_pdf
from renderer.kernel.material.material import emission
from renderer.kernel.pool.lists import (
    DONE,
    LIT,
    MISSED,
    SMOOTH_CONDUCTOR,
    SPHERES,
    TRIANGLES,
    append,
    clear,
    eight,
    length,
    pad,
    row,
)
from renderer.kernel.pool.rows import CARRIED, FACTS, FIRST, FRAME, LAST, PLACE, RAY, at, read, write
from renderer.kernel.surface.surface import shines, sphere_at, triangle_at
from renderer.wide.values import any_of, as_floats, as_ints, lookup, nil, to_float, u32, where, where3

__all__ = ["arrive", "miss"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_WORLD = np.int32(-1)
_FIRST_LIGHT = np.uint32(0)
_NEXT = np.uint32(1)
_OVER = np.float32(DONE)
_CONDUCTOR, _UNLIT = np.uint32(CONDUCTOR), np.uint32(UNLIT)
_SMOOTH = np.float32(SMOOTH_CONDUCTOR)
_WHICH = FRAME + np.uintp(6)


@device
def _added(radiance, throughput, light, segments, mask, limit):
    """The radiance with the light that comes to the path over so many segments, where the mask is set."""
    brought = limited(vec.mul(throughput, light), segments, limit)
    return where3(mask, vec.add(radiance, brought), radiance)


@device
def _weight(pdf, light_pdf):
    """Of light that a path met: all counts where light sampling could not have found it."""
    return where(pdf > _ZERO, power_heuristic(pdf, light_pdf), _ONE)


@subroutine
def miss(scene, pool, lists, options):
    """Adds the environment's light to the paths that met nothing. They are done."""
    out_of_line()
    count = pad(lists, MISSED)
    for k in range(0, count, 8):
        rows = eight(lists, MISSED, k)
        ray = read(pool, rows, RAY)
        rx, ry, rz, depth, tx, ty, tz, number = read(pool, rows, CARRIED)
        d, pdf = (ray[3], ray[4], ray[5]), ray[6]
        emitted, light_pdf = environment_seen(scene, d, pdf > _ZERO)
        emitted = vec.scale(emitted, _weight(pdf, light_pdf))
        r = _added((rx, ry, rz), (tx, ty, tz), emitted, depth + _ONE, pdf >= _ZERO, options.clamp)
        write(pool, rows, CARRIED, (*r, depth, tx, ty, tz, number))
    for k in range(count):
        append(lists, DONE, row(lists, MISSED, k))


@device
def _keep_first(pool, rows, number, surface, albedo, t):
    """Writes down what the film wants of a path's first hit."""
    first = number == _ZERO
    if any_of(first):
        a, b = read(pool, rows, FIRST), read(pool, rows, FIRST + np.uintp(8))
        n, p = surface.shading, surface.point
        object_number, material = as_floats(surface.object + _NEXT), as_floats(surface.material + _NEXT)
        a = (
            where(first, albedo[0], a[0]),
            where(first, albedo[1], a[1]),
            where(first, albedo[2], a[2]),
            where(first, t, a[3]),
            where(first, n[0], a[4]),
            where(first, n[1], a[5]),
            where(first, n[2], a[6]),
            where(first, object_number, a[7]),
        )
        b = (
            where(first, p[0], b[0]),
            where(first, p[1], b[1]),
            where(first, p[2], b[2]),
            where(first, material, b[3]),
            b[4],
            b[5],
            b[6],
            b[7],
        )
        write(pool, rows, FIRST, a)
        write(pool, rows, FIRST + np.uintp(8), b)


@device
def _shine(scene, surface, d, pdf, last, throughput, radiance, depth, options):
    """The radiance with the light that the surfaces themselves send to their paths."""
    lit = shines(surface) & (pdf >= _ZERO)
    if any_of(lit):
        light = where(lit, surface.light, _FIRST_LIGHT)
        emitted = emission(scene, surface.material, surface.uv, surface.uv1, surface.front)
        cosine = vec.dot(surface.geometric, vec.neg(d))
        light_pdf = primitive_light_pdf(scene, light, last[0], last[1], surface.point, cosine)
        emitted = vec.scale(emitted, _weight(pdf, light_pdf))
        radiance = _added(radiance, throughput, emitted, depth + _ONE, lit, options.clamp)
    return radiance


@device
def _class(scene, material, kind):
    """Which list's stage scatters the vertex."""
    roughness = columns(scene.material, material, COLUMNS, ROUGHNESS, 1)[0]
    return where((kind == _CONDUCTOR) & (roughness <= SMOOTH_GLASS), _SMOOTH, to_float(kind))


@template
def _arrive(scene, pool, lists, which, on_sphere, options):
    count = pad(lists, which)
    for k in range(0, count, 8):
        rows = eight(lists, which, k)
        ray = read(pool, rows, RAY)
        rx, ry, rz, depth, tx, ty, tz, number = read(pool, rows, CARRIED)
        last = read(pool, rows, LAST)
        facts = read(pool, rows, FACTS)
        o, d, pdf = (ray[0], ray[1], ray[2]), (ray[3], ray[4], ray[5]), ray[6]
        radiance, throughput = (rx, ry, rz), (tx, ty, tz)
        hit = Hit(facts[0], as_ints(facts[1]), last[6], last[7], _WORLD)
        if on_sphere is None:
            surface = triangle_at(scene, d, hit)
        else:
            surface = sphere_at(scene, o, d, hit)
        vertex, normal = (last[0], last[1], last[2]), (last[3], last[4], last[5])
        radiance = _shine(scene, surface, d, pdf, (vertex, normal), throughput, radiance, depth, options)
        kind = u32(lookup(scene.material_kind, surface.material))
        base = columns(scene.material, surface.material, COLUMNS, BASE, 3)
        unlit = kind == _UNLIT
        if any_of(unlit):
            radiance = _added(radiance, throughput, base, depth + _ONE, unlit, options.clamp)
        _keep_first(pool, rows, number, surface, base, facts[0])

        over = unlit | (depth + _ONE >= np.float32(options.max_depth))
        which_next = where(over, _OVER, _class(scene, surface.material, kind))
        flags = where(surface.front, _ONE, _ZERO) + where(surface.smooth, _TWO, _ZERO)
        write(pool, rows, CARRIED, (*radiance, depth, *throughput, number))
        write(pool, rows, FACTS, (*facts[:5], as_floats(surface.material), as_floats(surface.light), as_floats(surface.object)))
        write(pool, rows, PLACE, (*surface.point, surface.error, *surface.geometric, flags))
        write(pool, rows, FRAME, (*surface.shading, *surface.lift, which_next, nil(depth)))


@subroutine
def _arrive_on_triangles(scene, pool, lists, options):
    out_of_line()
    _arrive(scene, pool, lists, TRIANGLES, None, options)


@subroutine
def _arrive_on_spheres(scene, pool, lists, options):
    out_of_line()
    _arrive(scene, pool, lists, SPHERES, True, options)


@subroutine
def arrive(scene, pool, lists, options):
    """Looks at the surfaces that were met: adds their own light, and lists the paths by how they are scattered there."""
    out_of_line()
    for which in range(SMOOTH_CONDUCTOR + 1):
        clear(lists, which)
    clear(lists, LIT)
    if length(lists, TRIANGLES) > 0:
        _arrive_on_triangles(scene, pool, lists, options)
    if length(lists, SPHERES) > 0:
        _arrive_on_spheres(scene, pool, lists, options)
    for which in (TRIANGLES, SPHERES):
        for k in range(length(lists, which)):
            path = row(lists, which, k)
            into = np.int64(pool[at(path, _WHICH)])
            append(lists, into, path)
            if into != DONE and into != MIRROR and into != GLASS and into != SMOOTH_CONDUCTOR:
                append(lists, LIT, path)
