"""Samples where a path scatters in its medium before it reaches a surface. Compiled only for scenes with media.

A vertex in a medium is represented by a surface at that point that faces the viewer, without object and material, and that
receives light from all sides. So light sampling, scattering and splitting work as for other vertices.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.medium.equiangular import choose_pivot, equiangular_share, equiangular_span
from renderer.kernel.medium.flight import FLIGHT_BLOCK, free_flight, free_flight_by_lamp
from renderer.kernel.medium.medium_stack import coefficients, innermost
from renderer.kernel.medium.volume import flight_block, fly_through_volume, volume_of
from renderer.kernel.sampling.sampler import draw4
from renderer.kernel.steps.state import scattering_surface
from renderer.kernel.surface.surface import NO_OBJECT
from renderer.wide.lanes import each_lane
from renderer.wide.values import any_of, as_wide, not_, to_int, u32, where, where3, zero_like

__all__ = ["MediumEvent", "medium_event", "medium_surface"]

_ZERO = np.float32(0.0)
_LEAST = np.float32(1e-30)
_FLIGHTS = np.uint32(FLIGHT_BLOCK)


class MediumEvent(NamedTuple):
    """The outcome of a path's free flight: whether it scatters before the next surface, where, and with which throughput."""

    scatters: Any  # in the medium; else the path reaches the surface
    distance: Any  # of the end from the ray's origin
    throughput: Any  # at the end
    albedo: Any  # single scattering albedo, rgb
    g: Any  # mean cosine of the scattering angle
    emitted: Any  # by a heterogeneous medium on the way, times the throughput; zeros in kernels without grids


@device
def medium_event(scene, ray, path, crossings, reach, stream, row, wavelengths):
    """Samples the free flight along the ray towards the next surface; returns a MediumEvent.

    reach: distance of the surface, infinite for a miss. row: number of earlier vertices and passed surfaces, a float, which
    selects the flight's random numbers. wavelengths: of the path (kernel/spectrum); None in RGB.
    """
    sigma_t, sigma_s, g = coefficients(scene, crossings.medium_stack, wavelengths)
    u = draw4(stream, u32(u32(to_int(row)) + _FLIGHTS))
    ahead = reach - crossings.behind
    if scene.has.pivots is not None and len(scene.pivot) > 0:
        center, radius = choose_pivot(scene.pivot, u[3])
        begin = vec.add(ray.o, vec.scale(ray.d, crossings.behind))
        span = equiangular_span(begin, ray.d, center, radius, ahead)
        share = where(vec.maximum(sigma_s) > _ZERO, equiangular_share(span, sigma_t), _ZERO)
        flight = free_flight_by_lamp(sigma_t, sigma_s, path.throughput, ahead, u, span, share)
    else:
        flight = free_flight(sigma_t, sigma_s, path.throughput, ahead, (u[0], u[1]))
    red, green, blue = sigma_t
    albedo = sigma_s[0] / max(red, _LEAST), sigma_s[1] / max(green, _LEAST), sigma_s[2] / max(blue, _LEAST)
    distance = where(flight.scatters, crossings.behind + flight.distance, reach)
    scatters, throughput, none = flight.scatters, flight.throughput, zero_like(red)
    emitted = none, none, none
    if scene.has.grids is not None:
        medium = innermost(crossings.medium_stack)
        is_grid = volume_of(scene, medium) > _ZERO
        if any_of(is_grid):
            known = medium, sigma_t, sigma_s, ray.o, ray.d, crossings.behind, reach, path.throughput
            random = stream.seed, stream.pixel, stream.sample, flight_block(to_int(row)), u[0], u[1]
            ends, end, carried, emitted = each_lane(fly_through_volume, is_grid, (scene, *known, *random, wavelengths))
            scatters, distance = where(is_grid, ends, scatters), where(is_grid, end, distance)
            throughput = where3(is_grid, carried, throughput)
    return MediumEvent(scatters, distance, throughput, albedo, g, emitted)


@device
def medium_surface(ray, distance):
    """Returns the surface that represents a vertex in a medium at that distance along the ray."""
    wo = vec.neg(ray.d)
    point = ray.o[0] - wo[0] * distance, ray.o[1] - wo[1] * distance, ray.o[2] - wo[2] * distance
    none, nothing = zero_like(distance), as_wide(NO_OBJECT, distance)
    no, flat = distance != distance, (none, none, none)
    return scattering_surface(point, none, wo, wo, not_(no), nothing, no, flat, (none, none), (none, none), nothing)
