"""Processing of a single path's hit: a surface that the ray passes through, or a vertex where the path scatters."""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import DIFFUSE, LAYER_SLOTS, MEDIUM, SCATTERS_WITHIN, SUBSURFACE_ANISOTROPY, TRANSMITS
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.material.material import Material, factors_at, has_flag, material_of, parameters_at
from renderer.kernel.material.normal_map import shading_frame
from renderer.kernel.medium.subsurface import enter_subsurface
from renderer.kernel.spectrum.upsampling import reflectance_at
from renderer.kernel.steps.disperse import disperse
from renderer.kernel.steps.medium_event import medium_surface
from renderer.kernel.steps.pass_through import absorb, is_passed
from renderer.kernel.steps.state import Vertex, with_throughput

__all__ = ["LAYER_SLOTS", "medium_vertex", "reach_surface", "subsurface_vertex", "surface_vertex"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_BLACK = (_ZERO, _ZERO, _ZERO)
_WHITE = (_ONE, _ONE, _ONE)
_UP = (_ZERO, _ZERO, _ONE)
_EVERY_SIDE = _BLACK
_YES, _NO = np.bool_(True), np.bool_(False)
_MEDIUM, _DIFFUSE = np.int32(MEDIUM), np.int32(DIFFUSE)
_TRANSMITS, _SCATTERS_WITHIN = np.uint32(TRANSMITS), np.uint32(SCATTERS_WITHIN)


@device
def reach_surface(scene, surface, path, last, row, stream, options, time, wavelengths=None):
    """Returns (whether the path passes through the surface that it hit, the path with its throughput at that surface).

    row: number of surfaces hit before, a float. wavelengths, in this module: of the path (kernel/spectrum); None in RGB.
    """
    through = is_passed(scene, surface, stream, row, options, time)
    return through, with_throughput(path, absorb(scene, surface, through, path.throughput, last.point, wavelengths))


@device
def surface_vertex(scene, surface, ray, path, stream, layers, time, wavelengths=None):
    """Returns (the Vertex at the surface that a path hit, the path).

    If the material is dispersive, the returned path has a single colour channel. layers: (LAYER_SLOTS,) float32, receives the
    parameters of rarer materials.
    """
    towards_viewer = vec.neg(ray.d)
    frame = shading_frame(scene, surface, towards_viewer, time)
    base, metallic, roughness, ior = parameters_at(scene, surface, factors_at(scene, surface, time))
    ior, throughput = disperse(scene, surface, ior, path.throughput, _YES, stream, path.number, wavelengths)
    base = reflectance_at(scene, base, wavelengths)
    material = material_of(scene, surface, (base, metallic, roughness, ior), frame, layers, time, wavelengths)
    s, t, n = frame
    normal = _EVERY_SIDE if has_flag(scene, surface.material, _TRANSMITS) else n
    return Vertex(surface, frame, material, vec.to_local(s, t, n, towards_viewer), normal), with_throughput(path, throughput)


@device
def medium_vertex(scene, ray, event, layers):
    """Returns the Vertex at a MediumEvent, which receives light from all directions. layers: as for `surface_vertex`."""
    surface = medium_surface(ray, event.distance)
    n = surface.shading
    s, t = vec.basis(n)
    layers[SUBSURFACE_ANISOTROPY] = event.g
    material = Material(_MEDIUM, event.albedo, _ZERO, _ONE, _BLACK, _ZERO, _ONE, _YES, layers, scene.has)
    return Vertex(surface, (s, t, n), material, _UP, _EVERY_SIDE)


@device
def subsurface_vertex(scene, stack, vertex, path, stream, time, wavelengths):
    """Returns (the Vertex at which the path scatters, the path), after a subsurface walk if the path enters the body.

    Both are unchanged if it does not enter. The throughput is 0 if the walk was absorbed.
    """
    material, n = vertex.material, vertex.frame[2]
    if material.kind == MEDIUM or not has_flag(scene, vertex.surface.material, _SCATTERS_WITHIN):
        return vertex, path
    known = material.kind, material.base, material.layers, vertex.wo
    number = np.uint32(path.number)
    within = enter_subsurface(scene, stack, vertex.surface, n, *known, path.throughput, stream, number, time, wavelengths)
    if within.enters:
        n = within.surface.shading
        s, t = vec.basis(n)
        white = Material(_DIFFUSE, _WHITE, _ZERO, _ONE, _BLACK, _ZERO, _ONE, _NO, material.layers, scene.has)
        vertex = Vertex(within.surface, (s, t, n), white, _UP, n)
    return vertex, with_throughput(path, within.throughput)
