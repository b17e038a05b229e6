"""Paths in participating media, one at a time: free flights, medium vertices, subsurface walks.

Compiled only for scenes with media.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.arrays.rows import DIFFUSE, MEDIUM, SCATTERS_WITHIN, SUBSURFACE_ANISOTROPY
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.integrators.state import Vertex, with_throughput
from renderer.kernel.material.material import Material
from renderer.kernel.medium.flight import FLIGHT_BLOCK, free_flight
from renderer.kernel.medium.medium_stack import coefficients
from renderer.kernel.medium.subsurface import go_within
from renderer.kernel.sampling.sampler import draw4
from renderer.kernel.surface.surface import NO_LIGHT, NO_OBJECT, Surface

__all__ = ["Drift", "fly", "may_go_within", "scattered_within", "vertex_in_medium"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_LEAST = np.float32(1e-30)
_BLACK = (_ZERO, _ZERO, _ZERO)
_WHITE = (_ONE, _ONE, _ONE)
_UP = (_ZERO, _ZERO, _ONE)
_EVERY_SIDE = _BLACK
_YES, _NO = np.bool_(True), np.bool_(False)
_NO_UV = (_ZERO, _ZERO)
_NO_COLOR = (_ONE, _ONE, _ONE, _ONE)
_NO_TANGENT = (_ZERO, _ZERO, _ZERO, _ZERO)
_MEDIUM, _DIFFUSE = np.int32(MEDIUM), np.int32(DIFFUSE)


class Drift(NamedTuple):
    """The end of a path segment in its medium."""

    scatters: bool  # in the medium; else the path reaches the surface
    distance: float
    albedo: Any  # single scattering albedo, rgb
    g: float


@device
def fly(scene, path, begin, reach, stream, row):
    """Samples the free flight to the next surface, at distance `reach`: (path with its new throughput, Drift).

    begin: distance of the surface that the ray passed through last, or 0; reach: infinite for a miss. row: number of
    vertices and passed surfaces before it, which selects the flight's random numbers.
    """
    sigma_t, sigma_s, g = coefficients(scene, path.nest)
    u = draw4(stream, np.uint32(FLIGHT_BLOCK + row))
    flight = free_flight(sigma_t, sigma_s, path.throughput, reach - begin, (u[0], u[1]))
    albedo = (
        sigma_s[0] / max(sigma_t[0], _LEAST),
        sigma_s[1] / max(sigma_t[1], _LEAST),
        sigma_s[2] / max(sigma_t[2], _LEAST),
    )
    return with_throughput(path, flight.throughput), Drift(flight.scatters, begin + flight.distance, albedo, g)


@device
def vertex_in_medium(scene, path, drift, layers):
    """Returns the path's vertex at the end of its Drift. layers: as for `vertex_at` in state.py.

    It is represented by a surface at the point that faces the viewer, without object and material, lit from all sides.
    """
    wo = vec.neg(path.d)
    s, t = vec.basis(wo)
    point = vec.add(path.o, vec.scale(path.d, drift.distance))
    told = _NO_UV, _YES, NO_OBJECT, NO_LIGHT, NO_OBJECT, _NO_UV, _NO_COLOR, _NO_TANGENT, _NO, _BLACK
    surface = Surface(point, _ZERO, wo, wo, *told)
    layers[SUBSURFACE_ANISOTROPY] = drift.g
    material = Material(_MEDIUM, drift.albedo, _ZERO, _ONE, _BLACK, _ZERO, _ONE, _YES, layers, scene.has)
    return Vertex(surface, (s, t, wo), material, _UP, _EVERY_SIDE)


@device
def may_go_within(scene, vertex):
    """Whether the vertex's surface has subsurface scattering."""
    if vertex.material.kind == MEDIUM:
        return False
    return scene.material_flags[vertex.surface.material] & SCATTERS_WITHIN != 0


@device
def scattered_within(scene, stack, vertex, path, stream, number, time):
    """Returns (the vertex at which the path scatters, the path): unchanged, or the exit of a subsurface walk.

    The throughput is 0 where the walk was absorbed. number: count of earlier vertices; time: shutter time.
    """
    material, n = vertex.material, vertex.frame[2]
    known = material.kind, material.base, material.layers, vertex.wo
    within = go_within(scene, stack, vertex.surface, n, *known, path.throughput, stream, number, time)
    path = with_throughput(path, within.throughput)
    if within.enters:
        n = within.surface.shading
        s, t = vec.basis(n)
        white = Material(_DIFFUSE, _WHITE, _ZERO, _ONE, _BLACK, _ZERO, _ONE, _NO, material.layers, scene.has)
        vertex = Vertex(within.surface, (s, t, n), white, _UP, n)
    return vertex, path
