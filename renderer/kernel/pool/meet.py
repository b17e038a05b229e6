"""Stage 1: intersection of each path's ray; and the last stage but one: shadow rays."""

from __future__ import annotations

import numpy as np

from renderer.bvh.simd import load_int, store_int
from renderer.bvh.traverse import NO_PRIMITIVE, camera_root, closest_hit, shadow_root
from renderer.jit import device, out_of_line, subroutine
from renderer.kernel import vec
from renderer.kernel.integrators.transport import limited
from renderer.kernel.integrators.visibility import light_left, transmittance
from renderer.kernel.medium.flight import left_after
from renderer.kernel.medium.medium_stack import coefficients
from renderer.kernel.pool.lists import (
    ACTIVE,
    DONE,
    DRIFTING,
    ENDED,
    MISSED,
    NODES,
    PASSED,
    SCATTERING,
    SPHERES,
    TRIANGLES,
    WAITING,
    append,
    clear,
    cut,
    eight,
    length,
    pad,
    put,
    row,
)
from renderer.kernel.pool.rows import BEHIND, CARRIED, HIT, LAMP, LAYERS, RAY, SHADOW, at, few, read, time_of, write
from renderer.kernel.pool.shade import walk_in_shade
from renderer.kernel.pool.walk import walk
from renderer.kernel.pool.ways import BEST, BLOCKED, TOP, set_out, three, whole
from renderer.wide.values import as_ints, nil, u32, where, where3

__all__ = ["bring_light", "meet", "see_lights"]

_ZERO = np.float32(0.0)
_INF = np.float32(np.inf)
_ROOT = np.int32(0)
_GOES_ALONE = np.int32(-1)  # in column TOP: the ray was traced by `_go_past`
_U, _V, _PRIMITIVE, _INSTANCE = (HIT + np.uintp(k) for k in (1, 2, 3, 4))
_NUMBER = CARRIED + np.uintp(7)
_SEGMENTS, _BEGINS_IN = LAMP + np.uintp(3), LAMP + np.uintp(6)
_END, _WAITS, _GOES_ON = SHADOW + np.uintp(3), SHADOW + np.uintp(6), SHADOW + np.uintp(7)


@subroutine
def _go_past(scene, alone, pool, lists):
    """Traces the rays on the list PASSED on, each alone, beyond the surfaces that they have passed through."""
    out_of_line()
    for k in range(length(lists, PASSED)):
        number = row(lists, PASSED, k)
        path = at(number, np.uintp(0))
        o, d = three(pool, path + RAY), three(pool, path + RAY + np.uintp(3))
        after = pool[path + HIT], load_int(pool, path + _INSTANCE), load_int(pool, path + _PRIMITIVE)
        root = _ROOT
        if scene.bvh.begin is not None and pool[path + _NUMBER] == _ZERO:
            root = camera_root(scene.bvh)
        hit = closest_hit(scene.bvh, alone, o, d, _INF, time_of(scene.has.motion, pool, number), root, after)
        pool[path + BEST] = hit.t
        pool[path + _U] = hit.u
        pool[path + _V] = hit.v
        store_int(pool, path + _PRIMITIVE, hit.primitive)
        store_int(pool, path + _INSTANCE, hit.instance)
        store_int(pool, path + TOP, _GOES_ALONE)
        if scene.has.media is not None:
            pool[path + BEHIND] = after[0]


@device
def _wait_for_nodes(scene, pool, lists, count):
    """Puts the first `count` active rays that `_go_past` has not traced on the list NODES, without a hit."""
    waiting = np.uintp(0)
    for k in range(count):
        path = row(lists, ACTIVE, k)
        put(lists, NODES, waiting, path)
        if scene.has.textures is not None and load_int(pool, at(path, TOP)) == _GOES_ALONE:
            continue
        waiting += np.uintp(1)
        store_int(pool, at(path, _PRIMITIVE), NO_PRIMITIVE)
        store_int(pool, at(path, _INSTANCE), NO_PRIMITIVE)
        if scene.has.media is not None:
            pool[at(path, BEHIND)] = _ZERO
    cut(lists, NODES, waiting)


@subroutine
def meet(scene, alone, stack, pool, lists):
    """Traces the active paths' rays, and lists the paths by what they hit: nothing, a triangle or a sphere."""
    out_of_line()
    count = pad(lists, ACTIVE)
    for k in range(0, count, 8):
        rows = eight(lists, ACTIVE, k)
        ray = read(pool, rows, RAY)
        zero = nil(ray[0])
        root = zero
        if scene.bvh.begin is not None:
            number = few(pool, rows, _NUMBER, 1)[0]
            root = where(number == _ZERO, whole(camera_root(scene.bvh), zero), zero)
        set_out(pool, rows, (ray[0], ray[1], ray[2]), (ray[3], ray[4], ray[5]), zero + _INF, root)
    if scene.has.textures is not None:
        _go_past(scene, alone, pool, lists)
    _wait_for_nodes(scene, pool, lists, count)
    clear(lists, ENDED)
    walk(scene.bvh, scene.has.motion, alone, pool, stack, lists)
    triangles = len(scene.triangle)
    missed, on_triangles, on_spheres = np.uintp(0), np.uintp(0), np.uintp(0)
    for k in range(count):
        path = row(lists, ACTIVE, k)
        pool[at(path, HIT)] = pool[at(path, BEST)]
        primitive = load_int(pool, at(path, _PRIMITIVE))
        put(lists, MISSED, missed, path)
        put(lists, TRIANGLES, on_triangles, path)
        put(lists, SPHERES, on_spheres, path)
        is_hit, is_triangle = primitive != NO_PRIMITIVE, primitive < triangles
        missed += np.uintp(not is_hit)
        on_triangles += np.uintp(is_hit & is_triangle)
        on_spheres += np.uintp(is_hit & (not is_triangle))
    cut(lists, MISSED, missed)
    cut(lists, TRIANGLES, on_triangles)
    cut(lists, SPHERES, on_spheres)


@device
def _light_through(scene, alone, pool, lists, options):
    """Adds the direct light of the rows on WAITING, with transmittance through transparent surfaces and media."""
    for k in range(length(lists, WAITING)):
        path = row(lists, WAITING, k)
        start, end, time = three(pool, at(path, SHADOW)), three(pool, at(path, _END)), time_of(scene.has.motion, pool, path)
        brought, layers = three(pool, at(path, LAMP)), options.transparency_depth
        if options.has_depths:
            layers -= pool[at(path, LAYERS)]
        if scene.has.media is not None:
            share = light_left(scene, alone, start, end, u32(load_int(pool, at(path, _BEGINS_IN))), layers, time)
            brought, share = vec.mul(brought, share), vec.maximum(share)
        else:
            share = transmittance(scene, alone, start, end, True, layers, time)
            brought = vec.scale(brought, share)
        if share > _ZERO:
            brought = limited(brought, pool[at(path, _SEGMENTS)], options.clamp)
            for c in range(3):
                pool[at(path, CARRIED + np.uintp(c))] += brought[c]


@device
def _left(scene, pool, rows):
    """Returns the transmittance of eight unoccluded shadow rays, which stay in the medium where they start."""
    way = read(pool, rows, SHADOW)
    sigma_t, _, _ = coefficients(scene, as_ints(few(pool, rows, _BEGINS_IN, 1)[0]))
    return left_after(sigma_t, vec.length(vec.sub((way[3], way[4], way[5]), (way[0], way[1], way[2]))))


@device
def _light(scene, alone, stack, pool, lists, options):
    """Adds the direct light of the rows on WAITING, in scenes where any surface occludes."""
    count = pad(lists, WAITING)
    for k in range(0, count, 8):
        rows = eight(lists, WAITING, k)
        way = read(pool, rows, SHADOW)
        start, end = (way[0], way[1], way[2]), (way[3], way[4], way[5])
        none = nil(way[0])
        root = none
        if scene.bvh.begin is not None:
            root = whole(shadow_root(scene.bvh), none)
        set_out(pool, rows, start, vec.sub(end, start), none, root)
    for k in range(count):
        put(lists, NODES, np.uintp(k), row(lists, WAITING, k))
    cut(lists, NODES, np.uintp(count))
    clear(lists, ENDED)
    walk_in_shade(scene.bvh, scene.has.motion, alone, pool, stack, lists)
    for k in range(0, count, 8):
        rows = eight(lists, WAITING, k)
        r, g, b, segments = few(pool, rows, LAMP, 4)
        carried, blocked = read(pool, rows, CARRIED), few(pool, rows, BLOCKED, 1)[0]
        none = nil(r)
        if scene.has.media is not None:
            r, g, b = vec.mul((r, g, b), _left(scene, pool, rows))
        brought = where3(blocked != _ZERO, (none, none, none), limited((r, g, b), segments, options.clamp))
        radiance = vec.add((carried[0], carried[1], carried[2]), brought)
        write(pool, rows, CARRIED, (*radiance, carried[3], carried[4], carried[5], carried[6], carried[7]))


@subroutine
def bring_light(scene, alone, stack, pool, lists, options):
    """Traces the shadow rays of the rows on WAITING, and adds their direct light."""
    out_of_line()
    if scene.has.textures is not None and options.transparent:
        _light_through(scene, alone, pool, lists, options)
    else:
        _light(scene, alone, stack, pool, lists, options)


@device
def _go_on(pool, lists, which):
    """Distributes the rows of a list to WAITING if they have a shadow ray, and to ACTIVE or DONE."""
    waiting, active, done = np.uintp(length(lists, WAITING)), np.uintp(length(lists, ACTIVE)), np.uintp(length(lists, DONE))
    for k in range(length(lists, which)):
        path = row(lists, which, k)
        put(lists, WAITING, waiting, path)
        put(lists, ACTIVE, active, path)
        put(lists, DONE, done, path)
        goes_on = not (pool[at(path, _GOES_ON)] <= _ZERO)  # NaN propagates, so the film can count it
        waiting += np.uintp(pool[at(path, _WAITS)] != _ZERO)
        active += np.uintp(goes_on)
        done += np.uintp(not goes_on)
    cut(lists, WAITING, waiting)
    cut(lists, ACTIVE, active)
    cut(lists, DONE, done)


@subroutine
def see_lights(scene, alone, stack, pool, lists, options):
    """Traces the vertices' shadow rays and adds their direct light; returns the number of shadow rays.

    Continuing paths are added to ACTIVE, terminated ones to DONE.
    """
    out_of_line()
    cut(lists, WAITING, np.uintp(0))
    for which in range(SCATTERING):
        _go_on(pool, lists, np.uintp(which))
    if scene.has.media is not None:
        _go_on(pool, lists, DRIFTING)
    waiting = np.uintp(length(lists, WAITING))
    for k in range(length(lists, PASSED)):
        append(lists, ACTIVE, row(lists, PASSED, k))
    bring_light(scene, alone, stack, pool, lists, options)
    return np.int64(waiting)
