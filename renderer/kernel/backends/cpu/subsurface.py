"""Subsurface walks of paths that hit an object with subsurface scattering, for scenes with media.

The walks are traced one path at a time. Each ends at a diffuse vertex, which the following stages process.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import DIFFUSE as _LAMBERT
from renderer.arrays.rows import LAYER_SLOTS
from renderer.jit import device, local_floats, never_inline, subroutine, template
from renderer.kernel import vec
from renderer.kernel.backends.cpu.lists import DIFFUSE, DONE, LIT, RARE, SUBSURFACE_VERTICES, append, length, row
from renderer.kernel.backends.cpu.rows import (
    Appearance,
    Axes,
    Facet,
    Mapped,
    Outcome,
    Shading,
    at,
    column,
    gather,
    path_wavelengths,
    scatter,
    streams_of,
    surface_of,
    time_of,
)
from renderer.kernel.material.material import look_up_layers
from renderer.kernel.medium.subsurface import enter_subsurface
from renderer.kernel.steps.state import PathState, Ray, with_throughput

__all__ = ["enter_body", "trace_subsurface"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_WHITE = (_ONE, _ONE, _ONE)
_DIFFUSE, _RARE, _DONE = np.uintp(DIFFUSE), np.uintp(RARE), np.uintp(DONE)
_SURVIVAL = column(Outcome, "survival")


@device
def _store_exit(pool, path, surface, which):
    """Writes the exit point of a subsurface walk to the path's row of the pool: a white diffuse vertex, seen along its normal."""
    n = surface.shading
    s, t = vec.basis(n)
    ray = gather(pool, path, Ray)
    scatter(pool, path, Ray(ray.o, vec.neg(n), ray.pdf, ray.roulette_weight))
    scatter(pool, path, Facet(surface.point, surface.error, surface.geometric, surface.front, surface.smooth))
    scatter(pool, path, Shading(n, surface.lift, surface.material, np.uint32(which)))
    scatter(pool, path, Appearance(_WHITE, _ZERO, _ONE, _ONE, surface.uv))
    scatter(pool, path, Axes(s, t, surface.uv1))
    scatter(pool, path, Mapped(n, n, surface.object))


@template
def enter_body(scene, alone, pool, number, layers, options):
    """Decides for the path in row `number` whether it enters the body that it has hit, and walks to its exit.

    Returns the list of the scattering model at the exit, or at its vertex if it does not enter; DONE if the walk was absorbed.
    layers: (LAYER_SLOTS,) float32, scratch memory.
    """
    facet, shading = gather(pool, number, Facet), gather(pool, number, Shading)
    surface, time = surface_of(pool, number, facet, shading), time_of(scene.has.motion, pool, number)
    axes, n, seen = gather(pool, number, Axes), gather(pool, number, Mapped).normal, gather(pool, number, Appearance)
    frame = axes.s, axes.t, n
    path, wavelengths = gather(pool, number, PathState), path_wavelengths(scene, pool, number, options)
    wo = vec.to_local(axes.s, axes.t, n, vec.neg(gather(pool, number, Ray).d))
    kind = scene.material_kind[surface.material]
    if kind != _LAMBERT:
        looked_up = seen.base, seen.metallic, seen.roughness, surface.shading, surface.uv, surface.uv1
        look_up_layers(scene, surface.material, *looked_up, frame, layers, time, wavelengths)
    stream = streams_of(pool, number, options)
    known = n, kind, seen.base, layers, wo, path.throughput, stream, np.uint32(path.number)
    within = enter_subsurface(scene, alone, surface, *known, time, wavelengths)
    scatter(pool, number, with_throughput(path, within.throughput))
    into = _DONE
    if not vec.maximum(within.throughput) <= _ZERO:
        into = _DIFFUSE if within.enters or kind == _LAMBERT else _RARE
        if within.enters:
            _store_exit(pool, number, within.surface, into)
        else:
            scatter(pool, number, Shading(shading.normal, shading.lift, shading.material, np.uint32(into)))
    return into


@subroutine
def trace_subsurface(scene, alone, pool, lists, options):
    """Decides for each path on SUBSURFACE_VERTICES whether it enters the body, and walks to its exit.

    Adds the path to the list of the scattering model at the exit (or at its vertex if it does not enter), and to the list for
    light sampling.
    """
    never_inline()
    layers = local_floats(LAYER_SLOTS)
    for k in range(length(lists, SUBSURFACE_VERTICES)):
        number = row(lists, SUBSURFACE_VERTICES, k)
        into = enter_body(scene, alone, pool, number, layers, options)
        append(lists, into, number)
        if into == _DONE:
            pool[at(number, _SURVIVAL)] = _ZERO  # absorbed
        else:
            append(lists, LIT, number)
