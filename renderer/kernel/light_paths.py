"""Light by path in kernels: diffuse, glossy, transmitted and volume light, direct and indirect, emission and environment.

As in Cycles, the first vertex decides. Its value for the direction that the path takes is a sum of lobes, in proportion to which
the path's light is divided, channel by channel: reflected light is diffuse or glossy, transmitted light diffuse or transmitted;
what a medium scatters is volume light. So a plane's mean is the light through its lobe, whichever lobe was sampled. Direct light
has one vertex, indirect light more; surfaces passed by their alpha are none.

A path's light lies in the table of light_groups.py: behind the rows of its groups and ChosenGroup, a row for each of LIGHT_PATHS,
the PathShare of its direction, and that of the light sampled at its first vertex.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.jit import device, template
from renderer.kernel import vec
from renderer.kernel.light_groups import GROUP_ROW, GroupLight, add_group_light, add_sample_by_group, scatter_group
from renderer.settings import LIGHT_PATHS
from renderer.wide.fields import Float, Layout, Vector, accessors
from renderer.wide.values import as_wide, u32, where, where3, zero_like

__all__ = [
    "EMISSION",
    "ENVIRONMENT",
    "OTHER_ROWS",
    "PathShare",
    "add_path_light",
    "add_sample_by_light",
    "add_sampled_path_light",
    "diffuse_fraction",
    "forget_lights",
    "share_after_vertex",
    "store_sampled_share",
    "store_share",
]

_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
_REFLECTED, _TRANSMITTED, _SCATTERED = np.float32(0.0), np.float32(1.0), np.float32(2.0)
_TWO = np.float32(2.0)
_BEHIND = np.uint32(1)  # ChosenGroup
_COUNT = np.uint32(len(LIGHT_PATHS))
OTHER_ROWS = len(LIGHT_PATHS) + 2  # a branch's rows besides those of light groups
EMISSION, ENVIRONMENT, DIFFUSE, GLOSSY, TRANSMISSION, VOLUME = (
    np.uint32(LIGHT_PATHS.index(name))
    for name in ("emission", "environment", "diffuse_direct", "glossy_direct", "transmission_direct", "volume_direct")
)
_NEXT = np.uint32(1)  # from direct to indirect light


class PathShare(NamedTuple):
    """How a path's light is divided: the diffuse fraction of its first vertex, and the kind of the rest."""

    diffuse: Vector  # 0 ... 1
    kind: Float  # 0: reflected, so the rest is glossy; 1: transmitted; 2: scattered in a medium


_LAYOUT = Layout(PathShare)
assert _LAYOUT.width == GROUP_ROW
_gather_share, _scatter_share = accessors(_LAYOUT, row_major=True)


@device
def diffuse_fraction(diffuse, f):
    """Returns the fraction of each channel of f that is diffuse, 0 ... 1. diffuse, f: f |cos| of the diffuse lobes and of all."""
    one = zero_like(f[0]) + _ONE
    return (
        where(f[0] > _ZERO, max(min(diffuse[0] / f[0], one), _ZERO), one - one),
        where(f[1] > _ZERO, max(min(diffuse[1] / f[1], one), _ZERO), one - one),
        where(f[2] > _ZERO, max(min(diffuse[2] / f[2], one), _ZERO), one - one),
    )


@device
def share_after_vertex(diffuse, f, wi, is_surface):
    """Returns the PathShare of a path that its first vertex scatters into the local direction wi.

    diffuse, f: as for `diffuse_fraction`. is_surface: False for a vertex in a medium.
    """
    kind = where(wi[2] > _ZERO, zero_like(wi[2]) + _REFLECTED, zero_like(wi[2]) + _TRANSMITTED)
    return PathShare(diffuse_fraction(diffuse, f), where(is_surface, kind, zero_like(kind) + _SCATTERED))


@device
def forget_lights(table, row, options):
    """Sets to 0 what one path or eight have gathered of each light group and light path. row: of the first light group."""
    none = as_wide(_ZERO, row)
    dark = GroupLight((none, none, none))
    for k in range(np.int64(options.groups)):
        scatter_group(table, row + np.uint32(k), dark)
    for k in range(np.int64(options.paths)):
        scatter_group(table, row + (options.groups + _BEHIND + np.uint32(k)), dark)


@device
def store_share(table, row, options, share):
    """Stores the PathShare of one path or of eight. row: the row of the branch's first light group."""
    _scatter_share(table, row + (options.groups + _BEHIND + _COUNT), share)


@device
def store_sampled_share(table, row, options, share):
    """Stores the PathShare of the light sampled at a first vertex; see `store_share`."""
    _scatter_share(table, row + (options.groups + _BEHIND + _COUNT + _NEXT), share)


@device
def _add(table, first, share, brought, bounces, from_camera, mask):
    """Adds light to the planes among which it is divided. bounces: number of vertices, a float. from_camera: plane if it is 0."""
    is_seen, later = bounces == _ZERO, where(bounces >= _TWO, as_wide(_NEXT, bounces), as_wide(np.uint32(0), bounces))
    other = where(share.kind == _REFLECTED, as_wide(GLOSSY, bounces), as_wide(TRANSMISSION, bounces))
    other = u32(where(share.kind == _SCATTERED, as_wide(VOLUME, bounces), other) + later)
    one = zero_like(bounces) + _ONE
    diffuse = where3(is_seen, (one, one, one), share.diffuse)
    rest = vec.sub((one, one, one), diffuse)
    mine, others = where(is_seen, as_wide(from_camera, bounces), u32(later + DIFFUSE)), where(is_seen, later, other)
    add_group_light(table, first + mine, vec.mul(brought, diffuse), mask)
    add_group_light(table, first + others, vec.mul(brought, rest), mask)


@device
def add_path_light(table, row, options, brought, bounces, from_camera, mask):
    """Adds `brought`, the radiance of light that a path's ray meets, to the path's planes where `mask` is True.

    row: as for `store_share`. bounces: number of the path's vertices, a float. from_camera: EMISSION or ENVIRONMENT, the plane of
    light that the camera sees without a vertex.
    """
    first = row + (options.groups + _BEHIND)
    _add(table, first, _gather_share(table, first + _COUNT, PathShare), brought, bounces, from_camera, mask)


@device
def add_sampled_path_light(table, row, options, brought, bounces, mask):
    """Adds the light of a light sample to the planes of its path; see `add_path_light`. bounces: with the sample's vertex."""
    first = row + (options.groups + _BEHIND)
    here, before = _gather_share(table, first + _COUNT + _NEXT, PathShare), _gather_share(table, first + _COUNT, PathShare)
    is_first = bounces < _TWO
    share = PathShare(where3(is_first, here.diffuse, before.diffuse), where(is_first, here.kind, before.kind))
    _add(table, first, share, brought, bounces, EMISSION, mask)


@template
def add_sample_by_light(planes, place, stride, table, rows, counts, radiance, scale, add):
    """Adds a sample's light by group and, behind that, by path to fixed-point sums.

    rows: first rows of the path's two branches. counts: numbers of groups and of paths; one may be 0. All else: as for
    `add_sample_by_group`.
    """
    (first, second), (groups, paths) = rows, counts
    add_sample_by_group(planes, place, stride, table, first, second, groups, radiance, scale, add)
    behind = np.uintp(groups) + np.uintp(_BEHIND)
    place += np.uintp(3) * np.uintp(groups) * stride
    add_sample_by_group(planes, place, stride, table, first + behind, second + behind, paths, radiance, scale, add)
