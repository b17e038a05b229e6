"""Stage 1b, for scenes with media: free flights of the active paths, and their vertices in media.

Later stages see such a vertex as a surface at the point that faces the viewer and is lit from all sides, so light sampling,
scattering and splitting work as for other vertices.
"""

from __future__ import annotations

import numpy as np

from renderer.jit import device, out_of_line, subroutine
from renderer.kernel import vec
from renderer.kernel.integrators.depths import spent
from renderer.kernel.medium.flight import FLIGHT_BLOCK, free_flight
from renderer.kernel.medium.medium_stack import coefficients
from renderer.kernel.pool.lists import (
    ACTIVE,
    DONE,
    DRIFTING,
    LIT,
    MISSED,
    SPHERES,
    TRIANGLES,
    append,
    cut,
    eight,
    length,
    pad,
    put,
    row,
)
from renderer.kernel.pool.rows import (
    AXES,
    BEHIND,
    CARRIED,
    COUNTS,
    FIRST,
    FRAME,
    HIT,
    MAPPED,
    MATTER,
    NEST,
    PLACE,
    RAY,
    SPARE,
    START,
    WAY,
    at,
    few,
    read,
    write,
)
from renderer.kernel.pool.scatter import stream_of
from renderer.kernel.sampling.sampler import draw4
from renderer.kernel.surface.surface import NO_OBJECT
from renderer.wide.values import any_of, as_floats, as_ints, as_wide, nil, to_int, where

__all__ = ["fly", "list_drifting"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_FIRST = np.uint32(0)
_LEAST = np.float32(1e-30)
_FLIGHTS = np.uint32(FLIGHT_BLOCK)
_IN_MEDIUM, _OVER = np.float32(DRIFTING), np.float32(DONE)
_WHICH = FRAME + np.uintp(7)
_DRIFTS = WAY  # whether the ray ends in its medium; shares columns with the traversal


@device
def _keep_first(pool, rows, first, point, albedo, distance):
    """Records the first hit of paths whose first vertex is in a medium: without normal, object and material."""
    none = nil(distance)
    distance = distance + few(pool, rows, START, 1)[0]
    rows = where(first, rows, SPARE)
    write(pool, rows, FIRST, (*albedo, distance, none, none, none, none))
    write(pool, rows, FIRST + np.uintp(8), (*point, none, none, none, none, none))


@device
def _keep_vertices(pool, rows, point, wo, g, which):
    none = nil(which)
    one = none + _ONE
    s, t = vec.basis(wo)
    write(pool, rows, PLACE, (*point, none, *wo, one))
    write(pool, rows, FRAME, (*wo, none, none, none, none, which))
    write(pool, rows, MATTER, (one, one, one, none, g, one, none, none))
    write(pool, rows, AXES, (*s, *t, none, none))
    write(pool, rows, MAPPED, (*wo, none, none, none, none, none))


@subroutine
def fly(scene, pool, lists, options):
    """Samples free flights of the active paths and updates their throughput.

    Paths that scatter in a medium are removed from the lists of hits; they are done, or listed on DRIFTING.
    """
    out_of_line()
    count = pad(lists, ACTIVE)
    for k in range(0, count, 8):
        rows = eight(lists, ACTIVE, k)
        met = read(pool, rows, HIT)
        rx, ry, rz, depth, tx, ty, tz, number = read(pool, rows, CARRIED)
        sigma_t, sigma_s, g = coefficients(scene, as_ints(few(pool, rows, NEST, 1)[0]))
        u = draw4(stream_of(pool, rows, options), to_int(number + met[5]) + _FLIGHTS)
        begin = few(pool, rows, BEHIND, 1)[0]
        flight = free_flight(sigma_t, sigma_s, (tx, ty, tz), met[0] - begin, (u[0], u[1]))
        end = begin + flight.distance
        none = nil(number)
        if any_of(flight.scatters):
            ray = read(pool, rows, RAY)
            wo = -ray[3], -ray[4], -ray[5]
            point = ray[0] - wo[0] * end, ray[1] - wo[1] * end, ray[2] - wo[2] * end
            first = flight.scatters & (number == _ZERO)
            if any_of(first):
                r, g_, b = sigma_t
                albedo = sigma_s[0] / max(r, _LEAST), sigma_s[1] / max(g_, _LEAST), sigma_s[2] / max(b, _LEAST)
                _keep_first(pool, rows, first, point, albedo, end)
            over = depth + _ONE >= np.float32(options.max_depth)
            if options.has_depths:
                over = over | spent(few(pool, rows, COUNTS, 4), options)
            which = where(over, _OVER, none + _IN_MEDIUM)
            _keep_vertices(pool, where(flight.scatters, rows, SPARE), point, wo, g, which)
        distance = where(flight.scatters, end, met[0])
        number_of_object = as_floats(where(flight.scatters, as_wide(NO_OBJECT, none), _FIRST))
        write(pool, rows, HIT, (distance, met[1], met[2], met[3], met[4], met[5], number_of_object, none))
        write(pool, rows, CARRIED, (rx, ry, rz, depth, *flight.throughput, number))
        write(pool, rows, WAY, (where(flight.scatters, _ONE, none), none, none, none, none, none, none, none))
    _take_off(pool, lists, MISSED)
    _take_off(pool, lists, TRIANGLES)
    _take_off(pool, lists, SPHERES)
    drifting = np.uintp(0)
    for k in range(count):
        path = row(lists, ACTIVE, k)
        drifts = pool[at(path, _DRIFTS)] != _ZERO
        over = drifts & (pool[at(path, _WHICH)] == _OVER)
        put(lists, DRIFTING, drifting, path)
        drifting += np.uintp(drifts & (not over))
        if over:
            append(lists, DONE, path)
    cut(lists, DRIFTING, drifting)


@device
def _take_off(pool, lists, which):
    """Removes paths that scatter in a medium from a list."""
    stays = np.uintp(0)
    for k in range(length(lists, which)):
        path = row(lists, which, k)
        put(lists, which, stays, path)
        stays += np.uintp(pool[at(path, _DRIFTS)] == _ZERO)
    cut(lists, which, stays)


@subroutine
def list_drifting(lists):
    """Adds the vertices in media to the list for light sampling, after surfaces were processed."""
    out_of_line()
    for k in range(length(lists, DRIFTING)):
        append(lists, LIT, row(lists, DRIFTING, k))
