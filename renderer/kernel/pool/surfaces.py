"""Stage 2: processes the ends of rays: adds environment light and emission, and prepares surfaces for scattering."""

from __future__ import annotations

import numpy as np

from renderer.arrays import rows as kinds
from renderer.bvh.traverse import Hit
from renderer.jit import device, out_of_line, subroutine
from renderer.kernel import vec
from renderer.kernel.bsdf.rough_glass import SMOOTH_GLASS
from renderer.kernel.integrators.depths import is_blocked, spent, with_layer
from renderer.kernel.integrators.strategy import power_heuristic
from renderer.kernel.integrators.transport import limited
from renderer.kernel.light.lights import environment_seen, primitive_light_pdf, sun_seen
from renderer.kernel.light.sphere_light import met_from_front
from renderer.kernel.material.material import emission
from renderer.kernel.medium.medium_stack import crossed
from renderer.kernel.pool.lists import (
    CONDUCTOR,
    DIFFUSE,
    DONE,
    LIT,
    METALLIC_ROUGHNESS,
    MISSED,
    PASSED,
    RARE,
    RARE_SPECULAR,
    SCATTERING,
    SPECULAR,
    SPHERES,
    TRIANGLES,
    WITHIN,
    append,
    clear,
    eight,
    length,
    pad,
    row,
)
from renderer.kernel.pool.matter import attenuated, keep_matter, lamps, passes, surfaces_at
from renderer.kernel.pool.rows import (
    CARRIED,
    COUNTS,
    FIRST,
    FRAME,
    HIT,
    LAMP,
    MAPPED,
    NEST,
    PLACE,
    RAY,
    SPARE,
    START,
    at,
    few,
    read,
    times_of,
    write,
)
from renderer.kernel.pool.scatter import stream_of
from renderer.kernel.surface.surface import shines, sphere_at
from renderer.wide.values import any_of, as_floats, as_ints, lookup, nil, not_, u32, where, where3

__all__ = ["arrive", "miss"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FIRST_LIGHT, _NONE, _NEXT = np.uint32(0), np.uint32(0), np.uint32(1)
_DIFFUSE, _METALLIC_ROUGHNESS, _CONDUCTOR = (
    np.uint32(kind) for kind in (kinds.DIFFUSE, kinds.METALLIC_ROUGHNESS, kinds.CONDUCTOR)
)
_LAYERED, _BLINN_PHONG, _UNLIT, _PLASTIC = (
    np.uint32(kind) for kind in (kinds.LAYERED, kinds.BLINN_PHONG, kinds.UNLIT, kinds.PLASTIC)
)
_RARE_METAL, _SCATTERS_WITHIN = np.uint32(kinds.NEEDS_TANGENT | kinds.BECKMANN), np.uint32(kinds.SCATTERS_WITHIN)
_TO_WITHIN = np.float32(WITHIN)
_TO_DIFFUSE, _TO_SPECULAR, _TO_METALLIC_ROUGHNESS, _TO_CONDUCTOR, _TO_RARE, _TO_RARE_SPECULAR = (
    np.float32(which) for which in (DIFFUSE, SPECULAR, METALLIC_ROUGHNESS, CONDUCTOR, RARE, RARE_SPECULAR)
)
_OVER, _THROUGH = np.float32(DONE), np.float32(PASSED)
_WHICH, _LAMP_PDF = FRAME + np.uintp(7), LAMP + np.uintp(3)


@device
def _added(radiance, throughput, light, segments, mask, limit):
    """Returns the radiance with light added where the mask is set, clamped by the path's number of segments."""
    brought = limited(vec.mul(throughput, light), segments, limit)
    return where3(mask, vec.add(radiance, brought), radiance)


@device
def _weight(pdf, light_pdf):
    """Returns the MIS weight of light that a path hit; 1 where light sampling could not have found it."""
    return where(pdf > _ZERO, power_heuristic(pdf, light_pdf), _ONE)


@device
def _with_suns(scene, pool, rows, d, pdf, number, depth, throughput, radiance, limit):
    """Returns the radiance with the suns' light added for paths that hit nothing."""
    if scene.has.lights is not None:
        for k in range(len(scene.sun)):
            p, n = few(pool, rows, PLACE, 3), few(pool, rows, FRAME, 3)
            if scene.has.textures is not None:
                n = few(pool, rows, MAPPED + np.uintp(3), 3)
            time = times_of(scene.has.motion, pool, rows)
            emitted, light_pdf = sun_seen(scene, k, p, n, d, pdf > _ZERO, number == _ZERO, time)
            emitted = vec.scale(emitted, _weight(pdf, light_pdf))
            radiance = _added(radiance, throughput, emitted, depth + _ONE, pdf >= _ZERO, limit)
    return radiance


@subroutine
def miss(scene, pool, lists, options, is_recorded):
    """Adds environment and sun light to the paths that hit nothing, and ends them. is_recorded: as in `arrive`."""
    out_of_line()
    count = pad(lists, MISSED)
    for k in range(0, count, 8):
        rows = eight(lists, MISSED, k)
        ray = read(pool, rows, RAY)
        rx, ry, rz, depth, tx, ty, tz, number = read(pool, rows, CARRIED)
        d, pdf = (ray[3], ray[4], ray[5]), ray[6]
        emitted, light_pdf = environment_seen(scene, d, pdf > _ZERO)
        share = _weight(pdf, light_pdf)
        emitted = vec.scale(emitted, share)
        if is_recorded:
            met = read(pool, rows, HIT)
            write(pool, rows, HIT, (met[0], met[1], met[2], met[3], met[4], met[5], met[6], share))
        r = _added((rx, ry, rz), (tx, ty, tz), emitted, depth + _ONE, pdf >= _ZERO, options.clamp)
        r = _with_suns(scene, pool, rows, d, pdf, number, depth, (tx, ty, tz), r, options.clamp)
        write(pool, rows, CARRIED, (*r, depth, tx, ty, tz, number))
    for k in range(count):
        append(lists, DONE, row(lists, MISSED, k))


@device
def _keep_first(pool, rows, first, surface, albedo, n, distance):
    """Records the first hits of the paths for the film."""
    distance = distance + few(pool, rows, START, 1)[0]
    rows, none = where(first, rows, SPARE), nil(distance)
    write(pool, rows, FIRST, (*albedo, distance, *n, as_floats(surface.object + _NEXT)))
    write(pool, rows, FIRST + np.uintp(8), (*surface.point, as_floats(surface.material + _NEXT), none, none, none, none))


@device
def _emitted(scene, pool, rows, surface, lit, d, pdf, time):
    """Returns (the surfaces' emission with its MIS weight, that weight)."""
    light = where(lit, surface.light, _FIRST_LIGHT)
    vertex, normal = few(pool, rows, PLACE, 3), few(pool, rows, FRAME, 3)
    if scene.has.textures is not None:
        normal = few(pool, rows, MAPPED + np.uintp(3), 3)
    front = met_from_front(scene, light, vertex, d, surface.front, time)
    emitted = emission(scene, surface.material, surface.uv, surface.uv1, front, time)
    cosine = vec.dot(surface.geometric, vec.neg(d))
    judged = lit & (pdf > _ZERO)
    light_pdf = primitive_light_pdf(scene, light, vertex, normal, surface.point, cosine, judged, time)
    share = _weight(pdf, light_pdf)
    return vec.scale(emitted, share), share


@device
def _list_of(scene, material, kind, roughness):
    """Returns the list whose stage scatters the vertex."""
    even = (kind == _CONDUCTOR) & (roughness <= SMOOTH_GLASS)
    which = where(kind == _DIFFUSE, _TO_DIFFUSE, where(kind == _METALLIC_ROUGHNESS, _TO_METALLIC_ROUGHNESS, _TO_SPECULAR))
    which = where((kind == _CONDUCTOR) & not_(even), _TO_CONDUCTOR, which)
    if scene.has.layers is not None:
        rare = (kind == _CONDUCTOR) & ((u32(lookup(scene.material_flags, material)) & _RARE_METAL) != _NONE)
        which = where(rare, where(even, _TO_RARE_SPECULAR, _TO_RARE), which)
        which = where((kind == _LAYERED) | (kind == _BLINN_PHONG) | (kind == _PLASTIC), _TO_RARE, which)
    return which


@device
def _beyond(scene, pool, rows, surface, through, options):
    """Writes the nest of media and the counts of paths beyond the surfaces that they pass through.

    Returns a mask of those that may pass no more layers.
    """
    nest, diffuse, glossy, transmitted, layers = few(pool, rows, NEST, 5)
    counts = diffuse, glossy, transmitted, layers
    layers = where(through, with_layer(scene, surface.material, counts)[3], layers)
    if scene.has.media is not None:
        within = as_ints(nest)
        nest = as_floats(where(through, crossed(scene, within, surface.material, surface.front), within))
    none = nil(nest)
    write(pool, rows, NEST, (nest, diffuse, glossy, transmitted, layers, none, none, none))
    return is_blocked(scene, surface.material, counts, options)


@subroutine
def _arrive(scene, pool, lists, which, options, is_recorded):
    """Processes the surfaces that the paths on one list have hit."""
    out_of_line()
    for k in range(0, pad(lists, which), 8):
        rows = eight(lists, which, k)
        ray, met = read(pool, rows, RAY), read(pool, rows, HIT)
        rx, ry, rz, depth, tx, ty, tz, number = read(pool, rows, CARRIED)
        o, d, pdf, passed = (ray[0], ray[1], ray[2]), (ray[3], ray[4], ray[5]), ray[6], met[5]
        radiance, throughput = (rx, ry, rz), (tx, ty, tz)
        time = times_of(scene.has.motion, pool, rows)
        hit = Hit(met[0], as_ints(met[3]), met[1], met[2], as_ints(met[4]), time)
        if which == TRIANGLES:
            surface = surfaces_at(scene, d, hit)
        else:
            surface = sphere_at(scene, o, d, hit)
        stream = stream_of(pool, rows, options)
        through = passes(scene, surface, stream, number + passed, options, time)
        throughput = attenuated(scene, surface, through, throughput, pool, rows)
        lit = shines(surface) & (pdf >= _ZERO)
        if scene.has.textures is not None:
            lit = lit & (lamps(scene, surface) | not_(through))
        share = nil(pdf)
        if any_of(lit):
            emitted, share = _emitted(scene, pool, rows, surface, lit, d, pdf, time)
            radiance = _added(radiance, throughput, emitted, depth + _ONE, lit, options.clamp)
        wo = vec.neg(d)
        base, roughness, n, throughput = keep_matter(scene, pool, rows, surface, through, wo, stream, number, throughput, time)
        kind = u32(lookup(scene.material_kind, surface.material))
        unlit = (kind == _UNLIT) & not_(through)
        if any_of(unlit):
            radiance = _added(radiance, throughput, base, depth + _ONE, unlit, options.clamp)
        first = (number == _ZERO) & not_(through)
        if any_of(first):
            _keep_first(pool, rows, first, surface, base, n, hit.t)

        over = unlit | (depth + _ONE >= np.float32(options.max_depth))
        if options.has_depths:
            over = over | spent(few(pool, rows, COUNTS, 4), options)
        which_next = _list_of(scene, surface.material, kind, roughness)
        if scene.has.media is not None:
            within = (u32(lookup(scene.material_flags, surface.material)) & _SCATTERS_WITHIN) != _NONE
            which_next = where(within, _TO_WITHIN, which_next)
        which_next = where(over, _OVER, which_next)
        point = surface.point
        if scene.has.textures is not None and any_of(through):
            passed = where(through, passed + _ONE, passed)
            ends = passed != passed
            if scene.has.media is not None or options.has_depths:
                ends = _beyond(scene, pool, rows, surface, through, options)
            which_next = where(through, where(ends, _OVER, _THROUGH), which_next)
            point = where3(through, few(pool, rows, PLACE, 3), point)  # keeps the last vertex
        if scene.has.textures is not None or is_recorded:  # and bodies that light goes through ask for their numbers
            write(
                pool,
                rows,
                HIT,
                (met[0], met[1], met[2], met[3], met[4], passed, as_floats(surface.object), where(lit, share, nil(pdf))),
            )
        if scene.has.textures is not None or any_of(lit | unlit):
            write(pool, rows, CARRIED, (*radiance, depth, *throughput, number))
        flags = where(surface.front, _ONE, _ZERO) + where(surface.smooth, _TWO, _ZERO)
        write(pool, rows, PLACE, (*point, surface.error, *surface.geometric, flags))
        write(pool, rows, FRAME, (*surface.shading, *surface.lift, as_floats(surface.material), which_next))


@subroutine
def arrive(scene, pool, lists, options, is_recorded):
    """Processes the surfaces that were hit: adds emission, and lists the paths by their scattering model.

    is_recorded: whether a path is being recorded.
    """
    out_of_line()
    for which in range(SCATTERING):
        clear(lists, which)
    clear(lists, LIT)
    clear(lists, PASSED)
    if scene.has.media is not None:
        clear(lists, WITHIN)
    for which in (TRIANGLES, SPHERES):
        if length(lists, which) > 0:
            _arrive(scene, pool, lists, which, options, is_recorded)
            for k in range(length(lists, which)):
                path = row(lists, which, k)
                into = np.int64(pool[at(path, _WHICH)])
                if into == RARE_SPECULAR:
                    pool[at(path, _LAMP_PDF)] = _ZERO  # no light
                    into = RARE
                elif into <= RARE and into != SPECULAR:
                    append(lists, LIT, path)
                append(lists, into, path)
