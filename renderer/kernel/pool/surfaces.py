"""Stage 2: where the rays end: in the environment, or on surfaces, which may shine and are made ready to scatter."""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import BLINN_PHONG, CONDUCTOR, GLASS, LAYERED, MIRROR, NEEDS_TANGENT, UNLIT
from renderer.bvh.traverse import Hit
from renderer.jit import device, out_of_line, subroutine, template
from renderer.kernel import vec
from renderer.kernel.bsdf.rough_glass import SMOOTH_GLASS
from renderer.kernel.integrators.strategy import power_heuristic
from renderer.kernel.integrators.transport import limited
from renderer.kernel.integrators.visibility import MAX_PASSED
from renderer.kernel.light.lights import environment_seen, primitive_light_pdf
from renderer.kernel.material.material import emission
from renderer.kernel.pool.lists import (
    DONE,
    LIT,
    MISSED,
    PASSED,
    RARE,
    RARE_SPECULAR,
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
from renderer.kernel.pool.matter import attenuated, keep_matter, passes, surfaces_at
from renderer.kernel.pool.rows import CARRIED, FACTS, FIRST, FRAME, LAST, PLACE, RAY, at, read, write
from renderer.kernel.pool.scatter import stream_of
from renderer.kernel.surface.surface import departure, shines, sphere_at
from renderer.wide.values import any_of, as_floats, as_ints, lookup, not_, to_float, u32, where, where3

__all__ = ["arrive", "miss"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FIRST_LIGHT, _NONE, _NEXT = np.uint32(0), np.uint32(0), np.uint32(1)
_CONDUCTOR, _UNLIT = np.uint32(CONDUCTOR), np.uint32(UNLIT)
_LAYERED, _BLINN_PHONG, _NEEDS_TANGENT = np.uint32(LAYERED), np.uint32(BLINN_PHONG), np.uint32(NEEDS_TANGENT)
_OVER, _THROUGH, _SMOOTH = np.float32(DONE), np.float32(PASSED), np.float32(SMOOTH_CONDUCTOR)
_RARE, _RARE_SPECULAR = np.float32(RARE), np.float32(RARE_SPECULAR)
_MOST_PASSED = np.float32(MAX_PASSED)
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
def _keep_first(pool, rows, first, surface, albedo, n, distance):
    """Writes down what the film wants of a path's first hit."""
    if any_of(first):
        a, b = read(pool, rows, FIRST), read(pool, rows, FIRST + np.uintp(8))
        object_number, material = as_floats(surface.object + _NEXT), as_floats(surface.material + _NEXT)
        albedo, n = where3(first, albedo, (a[0], a[1], a[2])), where3(first, n, (a[4], a[5], a[6]))
        p = where3(first, surface.point, (b[0], b[1], b[2]))
        write(pool, rows, FIRST, (*albedo, where(first, distance, a[3]), *n, where(first, object_number, a[7])))
        write(pool, rows, FIRST + np.uintp(8), (*p, where(first, material, b[3]), b[4], b[5], b[6], b[7]))


@device
def _shine(scene, surface, through, d, pdf, vertex, normal, throughput, radiance, depth, options):
    """The radiance with the light that the surfaces themselves send to their paths."""
    lit = shines(surface) & (pdf >= _ZERO) & not_(through)
    if any_of(lit):
        light = where(lit, surface.light, _FIRST_LIGHT)
        emitted = emission(scene, surface.material, surface.uv, surface.uv1, surface.front)
        cosine = vec.dot(surface.geometric, vec.neg(d))
        light_pdf = primitive_light_pdf(scene, light, vertex, normal, surface.point, cosine, lit & (pdf > _ZERO))
        emitted = vec.scale(emitted, _weight(pdf, light_pdf))
        radiance = _added(radiance, throughput, emitted, depth + _ONE, lit, options.clamp)
    return radiance


@device
def _list_of(scene, material, kind, roughness):
    """Which list's stage scatters the vertex."""
    even = (kind == _CONDUCTOR) & (roughness <= SMOOTH_GLASS)
    which = where(even, _SMOOTH, to_float(kind))
    if scene.has.layers is not None:
        brushed = (kind == _CONDUCTOR) & ((u32(lookup(scene.material_flags, material)) & _NEEDS_TANGENT) != _NONE)
        which = where(brushed, where(even, _RARE_SPECULAR, _RARE), which)
        which = where((kind == _LAYERED) | (kind == _BLINN_PHONG), _RARE, which)
    return which


@template
def _arrive(scene, pool, lists, which, on_sphere, options):
    for k in range(0, pad(lists, which), 8):
        rows = eight(lists, which, k)
        ray, last, facts, frame = read(pool, rows, RAY), read(pool, rows, LAST), read(pool, rows, FACTS), read(pool, rows, FRAME)
        rx, ry, rz, depth, tx, ty, tz, number = read(pool, rows, CARRIED)
        o, d, pdf, passed = (ray[0], ray[1], ray[2]), (ray[3], ray[4], ray[5]), ray[6], frame[7]
        vertex, normal = (last[0], last[1], last[2]), (last[3], last[4], last[5])
        radiance, throughput = (rx, ry, rz), (tx, ty, tz)
        hit = Hit(facts[0], as_ints(facts[1]), last[6], last[7], as_ints(facts[5]))
        if on_sphere is None:
            surface = surfaces_at(scene, d, hit)
        else:
            surface = sphere_at(scene, o, d, hit)
        stream = stream_of(facts, options)
        through = passes(scene, surface, stream, number + passed, options)
        throughput = attenuated(scene, surface, through, throughput, vertex)
        radiance = _shine(scene, surface, through, d, pdf, vertex, normal, throughput, radiance, depth, options)
        base, roughness, n, throughput = keep_matter(scene, pool, rows, surface, through, vec.neg(d), stream, number, throughput)
        kind = u32(lookup(scene.material_kind, surface.material))
        unlit = (kind == _UNLIT) & not_(through)
        if any_of(unlit):
            radiance = _added(radiance, throughput, base, depth + _ONE, unlit, options.clamp)
        distance = hit.t
        if scene.has.textures is not None:
            distance = where(passed == _ZERO, distance, vec.length(vec.sub(surface.point, vertex)))
        _keep_first(pool, rows, (number == _ZERO) & not_(through), surface, base, n, distance)

        over = unlit | (depth + _ONE >= np.float32(options.max_depth))
        which_next = where(over, _OVER, _list_of(scene, surface.material, kind, roughness))
        if scene.has.textures is not None and any_of(through):
            passed = where(through, passed + _ONE, passed)
            which_next = where(through, where(passed >= _MOST_PASSED, _OVER, _THROUGH), which_next)
            beyond = departure(surface, pdf != pdf, d)
            write(pool, rows, RAY, (*where3(through, beyond, o), *d, pdf, ray[7]))
        flags = where(surface.front, _ONE, _ZERO) + where(surface.smooth, _TWO, _ZERO)
        known = as_floats(surface.material), as_floats(surface.light), as_floats(surface.object)
        write(pool, rows, CARRIED, (*radiance, depth, *throughput, number))
        write(pool, rows, FACTS, (facts[0], facts[1], facts[2], facts[3], facts[4], *known))
        write(pool, rows, PLACE, (*surface.point, surface.error, *surface.geometric, flags))
        write(pool, rows, FRAME, (*surface.shading, *surface.lift, which_next, passed))


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
    clear(lists, PASSED)
    if length(lists, TRIANGLES) > 0:
        _arrive_on_triangles(scene, pool, lists, options)
    if length(lists, SPHERES) > 0:
        _arrive_on_spheres(scene, pool, lists, options)
    for which in (TRIANGLES, SPHERES):
        for k in range(length(lists, which)):
            path = row(lists, which, k)
            into = np.int64(pool[at(path, _WHICH)])
            append(lists, into, path)
            if into <= RARE and into != MIRROR and into != GLASS and into != RARE_SPECULAR:
                append(lists, LIT, path)
