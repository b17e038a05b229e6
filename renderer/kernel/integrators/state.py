"""What a path is while it is followed: what it carries from vertex to vertex, and the vertex that it stands at."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.arrays.rows import MEDIUM
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.integrators.depths import bounced
from renderer.kernel.integrators.roulette import worth_after
from renderer.kernel.integrators.transport import one_color
from renderer.kernel.material.material import Material, fetch_material, transmits
from renderer.kernel.material.normal_map import shading_frame
from renderer.kernel.medium.nesting import crossed
from renderer.kernel.surface.departure import departure, leaves
from renderer.kernel.surface.surface import Surface
from renderer.wide.values import not_, where

__all__ = [
    "MAX_AGAIN",
    "Path",
    "Vertex",
    "beyond",
    "camera_path",
    "is_counted",
    "scattered",
    "vertex_at",
    "with_nest",
    "with_origin",
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
    """A path on its way to the next thing that its ray o + t d meets. Vectors are tuples of float32 in world space."""

    o: tuple[float, float, float]  # off the last vertex's surface, or off one that was passed
    d: tuple[float, float, float]  # unit
    vertex: tuple[float, float, float]  # the last one; the camera's point to begin with
    normal: tuple[float, float, float]  # that the vertex is lit from the side of; zero: from both
    pdf: float  # with which its BSDF gave d; 0: of a delta distribution, or the camera's; below 0: light is not counted where met
    throughput: tuple[float, float, float]
    radiance: tuple[float, float, float]  # found so far
    worth: float  # what a unit of its throughput is worth to the pixel: of roulette.py
    depth: int  # segments behind it that count
    counts: float  # its bounces by kind (depths.py)
    nest: Any  # the media that it is in (kernel/medium/nesting.py); None where there are none


class Vertex(NamedTuple):
    """Where a path scatters."""

    surface: Surface
    frame: tuple[Any, Any, Any]  # (s, t, n), orthonormal, to shade in
    material: Material
    wo: tuple[float, float, float]  # unit, towards the viewer, in the frame
    normal: tuple[float, float, float]  # as in Path: of the side that lights count on


@device
def camera_path(o, d, nest):
    """A path that leaves the camera's point o in the unit direction d."""
    return Path(o, d, o, _EVERY_SIDE, _ZERO, _WHITE, _BLACK, _ONE, _NONE, _ZERO, nest)


@device
def with_origin(path, o):
    """The path, its ray starting at o."""
    return Path(
        o,
        path.d,
        path.vertex,
        path.normal,
        path.pdf,
        path.throughput,
        path.radiance,
        path.worth,
        path.depth,
        path.counts,
        path.nest,
    )


@device
def with_throughput(path, throughput):
    """The path with another throughput."""
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
    """The path with another radiance."""
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
def with_nest(path, nest):
    """The path in other media."""
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
        path.counts,
        nest,
    )


@device
def beyond(scene, vertex, nest):
    """The nest of what goes through the vertex's surface; None where there are no media."""
    if scene.has.media is not None and vertex.material.kind != MEDIUM:
        nest = crossed(scene, nest, vertex.surface.material, vertex.surface.front)
    return nest


@device
def vertex_at(scene, surface, path, stream, number, layers, time):
    """The path's vertex on a surface, and the path, which sees one colour from here on where the material spreads them.

    number: how many vertices it had before; layers: (LAYER_SLOTS,) float32, in which the rarer materials' textures are looked up;
    time: of the shutter, 0 ... 1; None where nothing moves.
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
def is_counted(surface, reflected, d, pdf, options):
    """Whether a segment of direction d counts as depth, its vertex having scattered it with that pdf. Of one path, or of eight.

    Smooth transmission, the only one whose pdf is 0, counts only where `transmission_depth` is 0. A ray that meets its own facet
    again, as bent normals make some do, has not left the vertex, and is not counted. Else what is white would darken towards its
    rims, the more so the fewer bounces there may be.
    """
    has_left = leaves(surface, reflected, d)
    is_clear = (pdf == _ZERO) & not_(reflected)
    return where(options.transmission_depth > 0, has_left & not_(is_clear), has_left)


@device
def scattered(scene, vertex, path, number, wi, weight, pdf, eta2, branches, options):
    """The path after its vertex has scattered it into wi, of its frame.

    weight, pdf, eta2: as `sample_material` gives them, of one of so many branches. number: how many vertices it had before.
    """
    s, t, n = vertex.frame
    d = vec.to_world(s, t, n, wi)
    reflected = wi[2] > _ZERO
    counted = is_counted(vertex.surface, reflected, d, pdf, options)
    counts = path.counts
    if counted and vertex.material.kind != MEDIUM:
        counts = bounced(counts, reflected, pdf / branches)
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
