"""Converts a path's light by group and by path (light_groups.py, light_paths.py) from its wavelengths to linear Rec.709."""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.kernel.light_groups import GroupLight, gather_group, scatter_group
from renderer.kernel.spectrum.wavelengths import to_rgb

__all__ = ["planes_to_rgb"]

_BEHIND = np.uint32(1)  # ChosenGroup, between the rows of groups and of paths


@device
def _convert(tables, stream, table, row):
    light = gather_group(table, row, GroupLight).light
    scatter_group(table, row, GroupLight(to_rgb(tables, stream, light)))


@device
def planes_to_rgb(tables, stream, table, row, options):
    """Converts the light by group and by path of a terminated branch, or of eight.

    tables: the scene's SpectrumTables. stream: as for `to_rgb`. table: of light_groups.py. row: of the branch's first group.
    """
    for k in range(options.groups):
        _convert(tables, stream, table, row + np.uint32(k))
    for k in range(options.paths):
        _convert(tables, stream, table, row + (options.groups + _BEHIND + np.uint32(k)))
