"""Traces the paths' rays and the vertices' shadow rays."""

from __future__ import annotations

import numpy as np

from renderer.bvh.simd import load_int, store_int
from renderer.bvh.traverse import NO_PRIMITIVE, camera_root, closest_hit, shadow_root
from renderer.jit import device, never_inline, subroutine, template
from renderer.kernel import vec
from renderer.kernel.backends.cpu.lists import (
    ACTIVE,
    DONE,
    ENDED,
    MEDIUM_VERTICES,
    MISSED,
    NODES,
    PASSED,
    SCATTERING,
    SPHERES,
    TRIANGLES,
    WAITING,
    append,
    clear,
    eight_rows,
    length,
    pad,
    put,
    row,
    truncate,
)
from renderer.kernel.backends.cpu.rows import (
    DirectLight,
    Outcome,
    RowHit,
    Traversal,
    at,
    column,
    gather,
    group_row,
    path_wavelengths,
    scatter,
    streams_of,
    time_of,
)
from renderer.kernel.backends.cpu.traversal_state import BEST, TOP, start_traversal
from renderer.kernel.backends.cpu.walk import CLOSEST, traverse_rays
from renderer.kernel.backends.scalar.visibility import media_transmittance, transmittance_rgb
from renderer.kernel.light_groups import ChosenGroup, add_group_light, gather_group
from renderer.kernel.light_paths import add_sampled_path_light
from renderer.kernel.medium.volume import shadow_block
from renderer.kernel.steps.depths import layers_left
from renderer.kernel.steps.sample_direct_light import add_direct_light, direct_light
from renderer.kernel.steps.state import Crossings, PathState, Ray, with_radiance
from renderer.wide.values import as_wide, lookup, not_, to_int, u32, where, where3, zero_like

__all__ = ["add_transmitted", "add_unoccluded", "intersect_closest", "resolve_shadow_rays", "trace_shadow_rays"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
_ROOT = np.int32(0)
_TOP_NODE = np.uint32(0)
_TRACED_ALONE = np.int32(-1)  # in column TOP: the ray was traced by `_trace_passed`
_YES = np.bool_(True)
_NO_COUNTS = (_ZERO, _ZERO, _ZERO, _ZERO)
_T, _U, _V, _PRIMITIVE, _INSTANCE = (column(RowHit, field) for field in ("t", "u", "v", "primitive", "instance"))
_BEHIND = column(Crossings, "behind")
_IS_CAST, _SURVIVAL = column(Outcome, "is_cast"), column(Outcome, "survival")


@subroutine
def _trace_passed(scene, alone, pool, lists):
    """Finds the next hits of the rays on the list PASSED, which have passed through a surface, beyond that surface.

    Traces one ray at a time.
    """
    never_inline()
    for k in range(length(lists, PASSED)):
        number = row(lists, PASSED, k)
        path = at(number, np.uintp(0))
        ray = gather(pool, number, Ray)
        after = pool[path + _T], load_int(pool, path + _INSTANCE), load_int(pool, path + _PRIMITIVE)
        root = _ROOT
        if scene.bvh.ray_roots is not None and gather(pool, number, PathState).number == _ZERO:
            root = camera_root(scene.bvh)
        if scene.has.visibility is not None:
            root = lookup(scene.bvh.ray_roots, gather(pool, number, Crossings).ray_kind)
        hit = closest_hit(scene.bvh, alone, ray.o, ray.d, _INF, time_of(scene.has.motion, pool, number), root, after)
        pool[path + BEST] = hit.t
        pool[path + _U] = hit.u
        pool[path + _V] = hit.v
        store_int(pool, path + _PRIMITIVE, hit.primitive)
        store_int(pool, path + _INSTANCE, hit.instance)
        store_int(pool, path + TOP, _TRACED_ALONE)
        if scene.has.media is not None:
            pool[path + _BEHIND] = after[0]


@device
def _wait_for_nodes(scene, pool, lists, count):
    """Fills the list NODES with the first `count` active rays, for traversal, and resets the hits of these rays to none.

    Leaves out the rays that `_trace_passed` has traced.
    """
    waiting = np.uintp(0)
    for k in range(count):
        path = row(lists, ACTIVE, k)
        put(lists, NODES, waiting, path)
        if scene.has.textures is not None and load_int(pool, at(path, TOP)) == _TRACED_ALONE:
            continue
        waiting += np.uintp(1)
        store_int(pool, at(path, _PRIMITIVE), NO_PRIMITIVE)
        store_int(pool, at(path, _INSTANCE), NO_PRIMITIVE)
        if scene.has.media is not None:
            pool[at(path, _BEHIND)] = _ZERO
    truncate(lists, NODES, waiting)


@subroutine
def intersect_closest(scene, alone, stack, pool, lists):
    """Traces the active paths' rays, and lists each path by what its ray hits: nothing, a triangle or a sphere."""
    never_inline()
    count = pad(lists, ACTIVE)
    for k in range(0, count, 8):
        rows = eight_rows(lists, ACTIVE, k)
        ray = gather(pool, rows, Ray)
        zero = zero_like(ray.pdf)
        root = as_wide(_TOP_NODE, zero)
        if scene.bvh.ray_roots is not None:
            number = gather(pool, rows, PathState).number
            root = where(number == _ZERO, as_wide(np.uint32(camera_root(scene.bvh)), zero), root)
        if scene.has.visibility is not None:
            root = u32(lookup(scene.bvh.ray_roots, gather(pool, rows, Crossings).ray_kind))
        start_traversal(pool, rows, ray.o, ray.d, zero + _INF, root)
    if scene.has.textures is not None:
        _trace_passed(scene, alone, pool, lists)
    _wait_for_nodes(scene, pool, lists, count)
    clear(lists, ENDED)
    traverse_rays(scene.bvh, scene.has.motion, alone, pool, stack, lists, CLOSEST)
    triangles = len(scene.triangle)
    missed, on_triangles, on_spheres = np.uintp(0), np.uintp(0), np.uintp(0)
    for k in range(count):
        path = row(lists, ACTIVE, k)
        pool[at(path, _T)] = pool[at(path, BEST)]
        primitive = load_int(pool, at(path, _PRIMITIVE))
        put(lists, MISSED, missed, path)
        put(lists, TRIANGLES, on_triangles, path)
        put(lists, SPHERES, on_spheres, path)
        is_hit, is_triangle = primitive != NO_PRIMITIVE, primitive < triangles
        missed += np.uintp(not is_hit)
        on_triangles += np.uintp(is_hit & is_triangle)
        on_spheres += np.uintp(is_hit & (not is_triangle))
    truncate(lists, MISSED, missed)
    truncate(lists, TRIANGLES, on_triangles)
    truncate(lists, SPHERES, on_spheres)


@device
def _chosen_row(pool, rows, options):
    """Returns the row of the light group that was sampled for the vertices of one path or of eight."""
    first = group_row(pool, rows, options)
    return first + gather_group(pool, first + options.groups, ChosenGroup).group


@template
def add_transmitted(scene, alone, pool, row, options):
    """Traces the shadow ray of the path in one row of the pool, and adds its direct light.

    The light is multiplied by the transmittance of transparent surfaces and media on the way.
    """
    ray, light, path = gather(pool, row, Outcome), gather(pool, row, DirectLight), gather(pool, row, PathState)
    time, counts = time_of(scene.has.motion, pool, row), _NO_COUNTS
    if options.has_depths:
        counts = gather(pool, row, Crossings).counts
    layers = layers_left(counts, options)
    stream, number = streams_of(pool, row, options), path.number - _ONE
    random = u32(stream.seed), u32(stream.pixel), u32(stream.sample), shadow_block(to_int(number))
    root = shadow_root(scene.bvh)
    if scene.has.visibility is not None:
        root = lookup(scene.bvh.ray_roots, light.root)
    wavelengths = path_wavelengths(scene, pool, row, options)
    left = transmittance_rgb(scene, alone, ray.start, ray.end, light.medium_stack, layers, time, random, root, wavelengths)
    if vec.maximum(left) > _ZERO:
        if scene.has.groups is not None:
            brought = direct_light(light.brought, left, light.segments, options)
            add_group_light(pool, _chosen_row(pool, np.uint32(row), options), brought, _YES)
        if scene.has.light_paths is not None:
            brought, first = direct_light(light.brought, left, light.segments, options), group_row(pool, np.uint32(row), options)
            add_sampled_path_light(pool, first, options, brought, number + _ONE, _YES)
        radiance = add_direct_light(path.radiance, light.brought, left, light.segments, options)
        scatter(pool, row, with_radiance(path, radiance))


@device
def _light_through(scene, alone, pool, lists, options):
    """Adds the direct light of the paths that wait for a shadow ray (list WAITING), one at a time, by `add_transmitted`."""
    for k in range(length(lists, WAITING)):
        add_transmitted(scene, alone, pool, row(lists, WAITING, k), options)


@template
def add_unoccluded(scene, pool, rows, occluded, options):
    """Adds direct light to the paths in one row of the pool or in eight, unless their shadow rays are occluded (a mask).

    Only for scenes without transparent surfaces. In a medium the light is multiplied by its transmittance.
    """
    path, light = gather(pool, rows, PathState), gather(pool, rows, DirectLight)
    none = zero_like(path.depth)
    one = none + _ONE
    left = one, one, one
    if scene.has.media is not None:
        ray = gather(pool, rows, Outcome)
        stream, wavelengths = streams_of(pool, rows, options), path_wavelengths(scene, pool, rows, options)
        left = media_transmittance(scene, light.medium_stack, ray.start, ray.end, stream, path.number - one, wavelengths)
    lit = add_direct_light(path.radiance, light.brought, left, light.segments, options)
    if scene.has.groups is not None:
        brought = direct_light(light.brought, left, light.segments, options)
        add_group_light(pool, _chosen_row(pool, rows, options), brought, not_(occluded))
    if scene.has.light_paths is not None:
        brought = direct_light(light.brought, left, light.segments, options)
        add_sampled_path_light(pool, group_row(pool, rows, options), options, brought, path.number, not_(occluded))
    scatter(pool, rows, with_radiance(path, where3(occluded, path.radiance, lit)))


@device
def _light(scene, alone, stack, pool, lists, options):
    """Adds direct light to the paths that wait for a shadow ray (list WAITING), as `add_unoccluded` does."""
    count = pad(lists, WAITING)
    for k in range(0, count, 8):
        rows = eight_rows(lists, WAITING, k)
        ray = gather(pool, rows, Outcome)
        none = zero_like(ray.survival)
        root = as_wide(_TOP_NODE, none)
        if scene.bvh.ray_roots is not None:
            root = as_wide(np.uint32(shadow_root(scene.bvh)), none)
        if scene.has.visibility is not None:
            root = u32(lookup(scene.bvh.ray_roots, gather(pool, rows, DirectLight).root))
        start_traversal(pool, rows, ray.start, vec.sub(ray.end, ray.start), none, root)
    for k in range(count):
        put(lists, NODES, np.uintp(k), row(lists, WAITING, k))
    truncate(lists, NODES, np.uintp(count))
    clear(lists, ENDED)
    traverse_rays(scene.bvh, scene.has.motion, alone, pool, stack, lists, None)
    for k in range(0, count, 8):
        rows = eight_rows(lists, WAITING, k)
        add_unoccluded(scene, pool, rows, gather(pool, rows, Traversal).best != _ZERO, options)


@subroutine
def resolve_shadow_rays(scene, alone, stack, pool, lists, options):
    """Traces the shadow rays of the paths on the list WAITING, and adds the direct light of those that are not occluded."""
    never_inline()
    if scene.has.textures is not None and options.transparent:
        _light_through(scene, alone, pool, lists, options)
    else:
        _light(scene, alone, stack, pool, lists, options)


@device
def _list_for_next_stage(pool, lists, which):
    """Lists the paths of the list `which` for the next stage: those that continue on ACTIVE, the others on DONE.

    Those with a shadow ray are also added to the list WAITING.
    """
    waiting, active, done = np.uintp(length(lists, WAITING)), np.uintp(length(lists, ACTIVE)), np.uintp(length(lists, DONE))
    for k in range(length(lists, which)):
        path = row(lists, which, k)
        put(lists, WAITING, waiting, path)
        put(lists, ACTIVE, active, path)
        put(lists, DONE, done, path)
        goes_on = not (pool[at(path, _SURVIVAL)] <= _ZERO)  # NaN propagates, so the film can count it
        waiting += np.uintp(pool[at(path, _IS_CAST)] != _ZERO)
        active += np.uintp(goes_on)
        done += np.uintp(not goes_on)
    truncate(lists, WAITING, waiting)
    truncate(lists, ACTIVE, active)
    truncate(lists, DONE, done)


@subroutine
def trace_shadow_rays(scene, alone, stack, pool, lists, options):
    """Traces the shadow rays of all vertices and adds their direct light; returns the number of shadow rays.

    Adds continuing paths to the list ACTIVE, terminated ones to DONE.
    """
    never_inline()
    truncate(lists, WAITING, np.uintp(0))
    for which in range(SCATTERING):
        _list_for_next_stage(pool, lists, np.uintp(which))
    if scene.has.media is not None:
        _list_for_next_stage(pool, lists, MEDIUM_VERTICES)
    waiting = np.uintp(length(lists, WAITING))
    for k in range(length(lists, PASSED)):
        append(lists, ACTIVE, row(lists, PASSED, k))
    resolve_shadow_rays(scene, alone, stack, pool, lists, options)
    return np.int64(waiting)
