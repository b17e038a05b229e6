"""The state of a path that is being followed, and its vertices."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.arrays.rows import MEDIUM
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.integrators.depths import NO_COUNTS, bounced, with_layer
from renderer.kernel.integrators.roulette import worth_after
from renderer.kernel.integrators.transport import one_color
from renderer.kernel.material.material import Material, fetch_material, transmits
from renderer.kernel.material.normal_map import shading_frame
from renderer.kernel.medium.medium_stack import crossed
from renderer.kernel.surface.ray_origins import departure, leaves
from renderer.kernel.surface.surface import Surface
from renderer.wide.values import not_, where

__all__ = [
    "MAX_AGAIN",
    "Path",
    "Vertex",
    "beyond",
    "camera_path",
    "is_counted",
    "passed_through",
    "scattered",
    "vertex_at",
    "with_radiance",
    "with_throughput",
]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_NONE = np.int64(0)
_BLACK = (_ZERO, _ZERO, _ZERO)
_WHITE = (_ONE, _ONE, _ONE)
_EVERY_SIDE = _BLACK
MAX_AGAIN = 64  # segments that do not count, of one path: each has about an even chance to be the last of its vertex


class Path(NamedTuple):
    """A path with its next ray o + t d. Vectors are tuples of float32 in world space."""

    o: tuple[float, float, float]  # off the last vertex's surface
    d: tuple[float, float, float]  # unit
    vertex: tuple[float, float, float]  # the last one; the camera's point to begin with
    normal: tuple[float, float, float]  # lights on its side count; zero: on both sides
    pdf: float  # pdf of d by the BSDF; 0: discrete, or from the camera; below 0: emission that is hit does not count
    throughput: tuple[float, float, float]
    radiance: tuple[float, float, float]  # found so far
    worth: float  # factor from its throughput to its importance for the pixel (roulette.py)
    depth: int  # counted segments so far
    counts: tuple[float, float, float, float]  # of what it did at surfaces, by kind (depths.py)
    nest: Any  # media that contain it (kernel/medium/medium_stack.py); None for a scene without media


class Vertex(NamedTuple):
    """A vertex where a path scatters."""

    surface: Surface
    frame: tuple[Any, Any, Any]  # shading frame (s, t, n), orthonormal
    material: Material
    wo: tuple[float, float, float]  # unit, towards the viewer, in the frame
    normal: tuple[float, float, float]  # as in Path


@device
def camera_path(o, d, nest):
    """Returns a path that starts at the camera's point o in the unit direction d."""
    return Path(o, d, o, _EVERY_SIDE, _ZERO, _WHITE, _BLACK, _ONE, _NONE, NO_COUNTS, nest)


@device
def with_throughput(path, throughput):
    """Returns the path with another throughput."""
    return Path(
        path.o,
        path.d,
        path.vertex,
        path.normal,
        path.pdf,
        throughput,
        path.radiance,
        path.worth,
        path.depth,
        path.counts,
        path.nest,
    )


@device
def with_radiance(path, radiance):
    """Returns the path with another radiance."""
    return Path(
        path.o,
        path.d,
        path.vertex,
        path.normal,
        path.pdf,
        path.throughput,
        radiance,
        path.worth,
        path.depth,
        path.counts,
        path.nest,
    )


@device
def passed_through(scene, surface, path):
    """Returns the path beyond a surface that it passes through unchanged."""
    nest = path.nest
    if scene.has.media is not None:
        nest = crossed(scene, nest, surface.material, surface.front)
    return Path(
        path.o,
        path.d,
        path.vertex,
        path.normal,
        path.pdf,
        path.throughput,
        path.radiance,
        path.worth,
        path.depth,
        with_layer(scene, surface.material, path.counts),
        nest,
    )


@device
def beyond(scene, vertex, nest):
    """Returns the nest of media beyond the vertex's surface; None for a scene without media."""
    if scene.has.media is not None and vertex.material.kind != MEDIUM:
        nest = crossed(scene, nest, vertex.surface.material, vertex.surface.front)
    return nest


@device
def vertex_at(scene, surface, path, stream, number, layers, time):
    """Returns (the path's vertex on a surface, the path, reduced to one colour channel if the material is dispersive).

    number: count of earlier vertices; layers: (LAYER_SLOTS,) float32, filled with the rarer materials' parameters; time: shutter
    time, 0 ... 1; None for a scene without motion.
    """
    towards_viewer = vec.neg(path.d)
    frame = shading_frame(scene, surface, towards_viewer, time)
    material = fetch_material(scene, surface, frame, layers, time)
    material, throughput = one_color(scene, surface, material, path.throughput, stream, np.uint32(number))
    s, t, n = frame
    wo = vec.to_local(s, t, n, towards_viewer)
    normal = _EVERY_SIDE if transmits(material) else n
    return Vertex(surface, frame, material, wo, normal), with_throughput(path, throughput)


@device
def is_counted(has_left, reflected, pdf, options):
    """Whether a segment, sampled with that pdf, counts towards the depth. For one path or for eight lanes.

    Smooth transmission, the only one with pdf 0 that is not reflected, counts only if `transmission_depth` is 0. has_left: as
    `leaves` returns (surface/ray_origins.py). A ray that hits its own facet again, which bent normals can cause, has not left the
    vertex and is not counted; otherwise white objects would darken towards their silhouettes at low depths.
    """
    is_clear = (pdf == _ZERO) & not_(reflected)
    return where(options.transmission_depth > 0, has_left & not_(is_clear), has_left)


@device
def scattered(scene, vertex, path, number, wi, weight, pdf, eta2, branches, options):
    """Returns the path after its vertex has scattered it into the local direction wi.

    weight, pdf, eta2: as from `sample_material`; number: count of earlier vertices.
    """
    s, t, n = vertex.frame
    d = vec.to_world(s, t, n, wi)
    reflected = wi[2] > _ZERO
    has_left = leaves(vertex.surface, reflected, d)
    counted = is_counted(has_left, reflected, pdf, options)
    counts = path.counts
    if vertex.material.kind != MEDIUM:
        counts = bounced(counts, has_left, reflected, pdf / branches)
    return Path(
        departure(vertex.surface, reflected, d),
        d,
        vertex.surface.point,
        vertex.normal,
        pdf,
        vec.mul(path.throughput, weight),
        path.radiance,
        worth_after(path.worth, np.float32(number), weight, eta2),
        path.depth + 1 if counted else path.depth,
        counts,
        path.nest if reflected else beyond(scene, vertex, path.nest),
    )
