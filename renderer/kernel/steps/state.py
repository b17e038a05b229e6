"""The state of a path, as named tuples of plain values: of one path, of eight lanes, or of a thread.

Vectors are in world space. Directions are unit.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.bvh.layout import RAY_KINDS
from renderer.jit import device
from renderer.kernel.sampling.sampler import Stream
from renderer.kernel.surface.surface import NO_LIGHT, Surface
from renderer.wide.fields import Float, Four, Int, Vector
from renderer.wide.values import as_wide, zero_like

__all__ = [
    "BsdfSample",
    "Crossings",
    "LastVertex",
    "PathState",
    "Ray",
    "ShadowRay",
    "Vertex",
    "camera_path",
    "no_crossings",
    "scattering_surface",
    "stream_of",
    "with_radiance",
    "with_ray_kind",
    "with_throughput",
]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_CAMERA = np.uint32(RAY_KINDS.index("camera"))


class Ray(NamedTuple):
    """The next ray of a path, o + t d."""

    o: Vector  # origin, offset from the last vertex's surface
    d: Vector
    pdf: Float  # of d by the BSDF; 0: discrete direction, or camera ray; negative: emission that is hit does not count
    roulette_weight: Float  # factor from the path's throughput to its importance for the pixel (continue_or_end.py)


class PathState(NamedTuple):
    """The state of a path between vertices: the radiance gathered so far, the throughput, and counts."""

    radiance: Vector  # gathered so far
    depth: Float  # counted segments
    throughput: Vector
    number: Float  # count of vertices so far


class Crossings(NamedTuple):
    """The media that contain a path, and its depth counts by kind of bounce.

    Used only in scenes with media or visibility by kind of ray, or if bounces are limited by kind.
    """

    medium_stack: Int  # the media that contain it (kernel/medium/medium_stack.py)
    counts: Four  # bounces and passed surfaces by kind (depths.py)
    behind: Float  # distance along the ray of the surface that it passed through last; 0: none
    ray_kind: Int  # of the ray, an index into RAY_KINDS; only in scenes with visibility by kind of ray (ray_kind.py)


class LastVertex(NamedTuple):
    """The vertex that a ray has left, needed for the light sampling pdf of emission that the ray hits."""

    point: Vector
    normal: Vector  # lights on this side are sampled; zero: lights on both sides
    object: Int  # number of its object; NO_OBJECT for the camera and for points in media


class ShadowRay(NamedTuple):
    """A shadow ray, and the direct light that is added if it is not occluded."""

    start: Vector
    end: Vector
    is_cast: Any  # whether the shadow ray must be traced
    brought: Vector  # radiance added if it is not occluded
    segments: Float  # number of the path's segments with this one
    medium_stack: Any  # the media that contain its start


class BsdfSample(NamedTuple):
    """A direction sampled by a BSDF, in the shading frame, with its weight and pdf."""

    wi: Vector
    weight: Vector  # f |cos| / pdf
    pdf: Float  # 0: a discrete direction
    eta2: Float  # radiance scale of a refraction, which must not affect survival; else 1
    unguided: Float  # factor from this weight to that of the same direction sampled by the BSDF alone; 1 if it was


class Vertex(NamedTuple):
    """A point where a path scatters: the surface, the shading frame and the material there."""

    surface: Surface
    frame: Any  # shading frame (s, t, n), orthonormal
    material: Any  # as the backend stores it
    wo: Vector  # towards the viewer, in the frame
    normal: Vector  # as in LastVertex


@device
def stream_of(options, pixel, sample):
    """Returns the random number stream of a sample. pixel: the pixel's key, from `pixel_key` in sampling/sampler.py."""
    return Stream(options.sampler, options.seed, pixel, sample)


@device
def camera_path(o, d):
    """Returns (Ray, PathState) of a path that begins with the camera ray o + t d."""
    none = zero_like(d[0])
    one = none + _ONE
    return Ray(o, d, none, one), PathState((none, none, none), none, (one, one, one), none)


@device
def no_crossings(medium_stack, like):
    """Returns the Crossings of a camera path that has crossed no surface yet.

    like: a float or lanes, which determine the type.
    """
    none = zero_like(like)
    return Crossings(as_wide(medium_stack, like), (none, none, none, none), none, as_wide(_CAMERA, like))


@device
def with_ray_kind(crossings, kind):
    """Returns a copy of the Crossings for a ray of another kind, an index into RAY_KINDS."""
    return Crossings(crossings.medium_stack, crossings.counts, crossings.behind, kind)


@device
def with_radiance(path, radiance):
    """Returns a copy of the PathState with another radiance."""
    return PathState(radiance, path.depth, path.throughput, path.number)


@device
def with_throughput(path, throughput):
    """Returns a copy of the PathState with another throughput."""
    return PathState(path.radiance, path.depth, throughput, path.number)


@device
def scattering_surface(point, error, geometric, shading, front, material, smooth, lift, uv, uv1, number):
    """Returns a Surface of which only the fields that scattering needs are set. number: the object number."""
    none = zero_like(error)
    one = none + _ONE
    light = as_wide(NO_LIGHT, error)
    color, tangent = (one, one, one, one), (none, none, none, none)
    return Surface(point, error, geometric, shading, uv, front, material, light, number, uv1, color, tangent, smooth, lift)
