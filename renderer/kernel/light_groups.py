"""Light groups in kernels: which group a light belongs to, the light of each group that a path gathers, and its exact sum.

A path's light by group lies in a table of float32 rows, one for each group: in the scalar backend behind the first hit, in the
pool and on a graphics card behind the rows of the paths.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.jit import device, template
from renderer.kernel import vec
from renderer.kernel.fixed_point import fixed
from renderer.wide.fields import Int, Layout, Vector, accessors
from renderer.wide.values import as_wide, lookup, u32, where, where3

__all__ = [
    "GROUP_ROW",
    "ChosenGroup",
    "GroupLight",
    "add_group_light",
    "add_sample_by_group",
    "add_to_plane",
    "forget_groups",
    "gather_group",
    "group_of_environment",
    "group_of_light",
    "group_of_material",
    "group_of_media",
    "group_of_sample",
    "scatter_group",
]

_ZERO = np.float32(0.0)
_NONE, _ANY = np.int64(0), np.int64(-1)
_ENVIRONMENT = _FIRST = np.uint32(0)


class GroupLight(NamedTuple):
    """The light of one group that a path has gathered so far."""

    light: Vector


class ChosenGroup(NamedTuple):
    """The group of the light that was sampled for a path's vertex; in the row behind those of the groups."""

    group: Int


_LAYOUT = Layout((GroupLight, ChosenGroup))
GROUP_ROW = _LAYOUT.width  # float32 in a row of the table
gather_group, scatter_group = accessors(_LAYOUT, row_major=True)


@device
def group_of_light(scene, light):
    """Returns the number of the planes of light number `light`."""
    return u32(lookup(scene.group_plane, u32(lookup(scene.light_group, light))))


@device
def group_of_sample(scene, choice, light):
    """Returns the number of the planes of what `sample_chosen` samples: the environment if `choice` selects it, else `light`."""
    from_far, group = choice < scene.environment_frame[3], group_of_environment(scene, choice)
    return where(from_far, group, group_of_light(scene, where(from_far, as_wide(_FIRST, choice), light)))


@device
def group_of_material(scene, material):
    """Returns the number of the planes of an unlit material."""
    return u32(lookup(scene.group_plane, u32(lookup(scene.material_group, material))))


@device
def group_of_environment(scene, like):
    """Returns the number of the planes of the environment. like: a float or lanes, which determine the type."""
    group = u32(lookup(scene.environment_group, _ENVIRONMENT))
    return as_wide(u32(lookup(scene.group_plane, group)), like)


@device
def group_of_media(scene):
    """Returns the number of the planes of media that emit, which are in no group."""
    return u32(lookup(scene.group_plane, _FIRST))


@device
def add_group_light(table, row, brought, mask):
    """Adds `brought`, the radiance that a light adds to a path, to the path's group where `mask` is True.

    table: float32, with a row of GROUP_ROW numbers for each group. row: the group's row, of one path or of eight.
    """
    before = gather_group(table, row, GroupLight).light
    scatter_group(table, row, GroupLight(where3(mask, vec.add(before, brought), before)))


@device
def forget_groups(table, row, count):
    """Sets `count` rows of the table, from row number `row` on, to 0."""
    for k in range(count):
        scatter_group(table, np.uintp(row) + np.uintp(k), GroupLight((_ZERO, _ZERO, _ZERO)))


@device
def _whole(total, scale, most):
    """Converts a sum of light groups to fixed point, clamped to at most `most` if `most` is not negative."""
    found = fixed(total, scale)
    return min(found, most) if most >= _NONE else found


@device
def add_to_plane(planes, index, value):
    """Adds `value` to element `index` of `planes`, a flat int64 array."""
    planes[index] += value


@device
def _light_of(table, first, second, k, channel):
    """Returns a channel of the light of group number k, of both branches."""
    one = gather_group(table, np.uintp(first) + np.uintp(k), GroupLight).light
    other = gather_group(table, np.uintp(second) + np.uintp(k), GroupLight).light
    return one[channel] + other[channel]


@template
def add_sample_by_group(planes, place, stride, table, first, second, count, radiance, scale, add):
    """Adds a sample's light by group to fixed-point sums, so that its groups add up to the sample's colour, integer by integer.

    The groups are rounded as a running sum: group k adds what the sum of the groups up to k, rounded, has more than that of the
    groups before it. The last group that has light ends at the colour itself. So each group is within one unit of its own rounded
    value, apart from the rounding of float32 sums, and is 0 where it has no light. No group is negative unless some light is, as
    light at a wavelength can be in Rec.709.

    planes: int64 array, with three channels for each group. place: flat index of the first channel. stride: from one channel to
    the next. table: float32 rows (GROUP_ROW). first, second: first rows of the path's two branches. count: number of groups.
    radiance: the sample's colour. scale: 2**film_exponent. add: `add_to_plane`, or what takes its place.
    """
    for channel in range(3):
        whole, last, most = fixed(radiance[channel], scale), _NONE, fixed(radiance[channel], scale)
        for k in range(count):
            light = _light_of(table, first, second, k, channel)
            if light != _ZERO:
                last = np.int64(k)
            if light < _ZERO:
                most = _ANY
        total, before = _ZERO, _NONE
        for k in range(count):
            total += _light_of(table, first, second, k, channel)
            upto = whole if np.int64(k) >= last else _whole(total, scale, most)
            if upto != before:
                add(planes, place + (np.uintp(3 * k) + np.uintp(channel)) * stride, upto - before)
            before = upto
