"""Per-ray constants for tests against boxes and triangles; for one ray or for eight lanes.

Hit distances on triangles are rounded, and biased by the side that the ray hits (`intersect_triangles` in
renderer/bvh/packet.py). Culling of boxes must allow for the rounding and the bias, or the nearest hit would depend on the order
in which boxes are visited. Therefore all distances of boxes are reduced by a factor, `_NEARER`, and by a multiple of
`_margin_of`; both reductions exceed the bias.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from renderer.bvh.simd import select
from renderer.jit import device

__all__ = ["MORE", "RayConstants", "entry_limit", "ray_constants"]

_NEARER = np.float32(1 - 2.0**-18)  # factor of the reciprocal direction, for boxes
MORE = np.float32(1 + 2.0**-20)  # factor of a hit's distance, for the rounding of the division by the determinant
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TINY = np.float32(1e-18)
_SLACK = np.float32(4 * 2.0**-24)
_MIN_SLACK = np.float32(2.0**-30)  # least slack of a plane's coordinate: relative slack is zero for planes and origins at 0
_OF_ORIGIN = np.float32(0.25)
_LEAD = np.float32(2.0**-18)
_EARLIER = np.float32(1 - 2.0**-16)


class RayConstants(NamedTuple):
    """A ray's constants for `intersect_boxes` (node_test.py) and `intersect_triangles` (packet.py), per axis."""

    planes: Any  # first elements of the rows of a node that hold the near planes
    inverse: Any  # 1 / direction, for boxes
    near: Any  # a near plane at x is hit at distance x * inverse + near,
    far: Any  # a far one at x * inverse + far
    axes: Any  # of a packet's corners: rows of the axes, permuted so that the last is the direction's largest
    shear: Any
    origin: Any  # in the order of `axes`
    margin: Any  # from `_margin_of`


@device
def _margin_of(o, scale):
    """Returns the margin for the rounding of coordinates, which is added to a hit's distance in its error bound.

    Two tessellations of one plane differ by the rounding of their vertices, some ulps of their coordinates, however short the ray
    is. o: the ray's origin. scale: 1 / the direction's component of largest magnitude.
    """
    return max(abs(o[0]), max(abs(o[1]), abs(o[2]))) * abs(scale) * _OF_ORIGIN


@device
def _planes_of(o, inverse, margin):
    """Returns the constants (near plane, far plane) of one axis: a ray hits a plane at x at distance x * inverse + constant.

    inverse: reciprocal of the direction's component, times `_NEARER`.
    """
    constant = -o * inverse
    slack = abs(constant) * _SLACK + abs(inverse) * _MIN_SLACK
    return constant - (slack + margin * _LEAD), constant + slack


@device
def entry_limit(t, margin):
    """Returns the distance before which no box can contain a hit at distance t or beyond; at least 0."""
    return max(t * _EARLIER - margin * _LEAD, _ZERO)


@device
def _inverse(d):
    """Returns 1/d. A component near zero is replaced by +-1e-18: 0 * inf would be NaN, and the ray would visit the whole tree."""
    return _ONE / math.copysign(max(abs(d), _TINY), d)


@device
def ray_constants(o, d, width):
    """Returns the RayConstants of one ray, or of eight if the components of o and d are eight-lane vectors.

    width: WIDTH of renderer/bvh/layout.py, in the type of the integers. Values are selected without branches, since the axis of
    the largest component is unpredictable.
    """
    ix, iy, iz = _inverse(d[0]), _inverse(d[1]), _inverse(d[2])
    ax, ay, az = abs(d[0]), abs(d[1]), abs(d[2])
    first, second = ax > max(ay, az), ay > az
    zero, two = width - width, width + width
    four = two + two
    axes = (
        select(first, width, select(second, two, zero)),
        select(first, two, select(second, zero, width)),
        select(first, zero, select(second, width, two)),
    )
    scale = select(first, ix, select(second, iy, iz))
    dx = select(first, d[1], select(second, d[2], d[0]))
    dy = select(first, d[2], select(second, d[0], d[1]))
    origin = (
        select(first, o[1], select(second, o[2], o[0])),
        select(first, o[2], select(second, o[0], o[1])),
        select(first, o[0], select(second, o[1], o[2])),
    )
    margin = _margin_of(o, scale)
    ix, iy, iz = ix * _NEARER, iy * _NEARER, iz * _NEARER
    x, y, z = _planes_of(o[0], ix, margin), _planes_of(o[1], iy, margin), _planes_of(o[2], iz, margin)
    planes = (
        select(ix > _ZERO, zero, width),
        select(iy > _ZERO, two, two + width),
        select(iz > _ZERO, four, four + width),
    )
    shear = dx * scale, dy * scale, scale
    return RayConstants(planes, (ix, iy, iz), (x[0], y[0], z[0]), (x[1], y[1], z[1]), axes, shear, origin, margin)
