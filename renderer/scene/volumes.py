"""Packs the density and emission grids of heterogeneous media, with a coarse grid of bounds (kernel/medium/volume.py)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.arrays.rows import VOLUME_COLUMNS, VOLUME_EMISSION, VOLUME_GRID_COLUMNS
from renderer.errors import SceneError
from renderer.scene.description import F32, I32, SceneDescription, Volume
from renderer.sentences import Sentence

__all__ = ["MOST_VALUE", "MOST_VOXELS", "VolumeTables", "tabulate_volumes", "volume_numbers"]

MOST_VOXELS = 1 << 27  # of a scene: 512 MiB
MOST_VALUE = 1e6  # of a density, or of an emission
_CELL = 4  # least number of voxels along a side of a cell
_MOST_CELLS = 64  # along an axis
_MARGIN = 1 + 2.0**-16  # of bounds, above the rounding error of interpolation


class VolumeTables(NamedTuple):
    """The tables of CompiledScene for heterogeneous media: renderer/arrays/rows.py names their columns."""

    volume: F32
    volume_grid: I32
    voxel: F32
    majorant: F32


def volume_numbers(description: SceneDescription) -> dict[str, int]:
    """Returns name -> number of the volumes that a material or the world's medium uses. Raises SceneError for unknown names."""
    used = [material.volume for material in description.materials if material.volume]
    if description.medium is not None and description.medium.volume:
        used.append(description.medium.volume)
    for name in used:
        if name not in description.volumes:
            raise SceneError(
                Sentence(
                    "volume-name-unknown",
                    "There is no volume {name}; known are {known}",
                    name=name[:80],
                    known=sorted(description.volumes)[:10],
                )
            )
    return {name: number for number, name in enumerate(sorted(set(used)))}


def tabulate_volumes(description: SceneDescription) -> VolumeTables:
    """Returns the tables of the volumes that are used, numbered by `volume_numbers`. Raises SceneError for invalid grids."""
    numbers = volume_numbers(description)
    table = np.zeros((len(numbers), VOLUME_COLUMNS), np.float32)
    grid = np.zeros((len(numbers), VOLUME_GRID_COLUMNS), np.int32)
    voxels: list[F32] = []
    majorants: list[F32] = []
    total = sum(_voxels(description.volumes[name]) for name in numbers)
    if total > MOST_VOXELS:
        raise SceneError(
            Sentence(
                "volumes-too-large",
                "The scene's volumes have {count} voxels; at most {most} are supported. Reduce their resolution",
                count=total,
                most=MOST_VOXELS,
            )
        )
    first = cell = 0
    for name, number in numbers.items():
        volume = description.volumes[name]
        _check(name, volume)
        nz, ny, nx = volume.density.shape
        table[number, :VOLUME_EMISSION] = _to_unit(name, volume)[:3].reshape(-1)
        table[number, VOLUME_EMISSION:] = volume.emission_color
        grids = [volume.density] if volume.emission is None else [volume.density, volume.emission]
        bounds = _majorants(volume)
        cz, cy, cx = bounds.shape[:3]
        glows = -1 if volume.emission is None else first + volume.density.size
        grid[number] = nx, ny, nz, first, glows, cx, cy, cz, cell
        voxels += [np.ascontiguousarray(each, np.float32).reshape(-1) for each in grids]
        majorants.append(bounds.reshape(-1, 2))
        first, cell = first + len(grids) * volume.density.size, cell + cx * cy * cz
    return VolumeTables(
        table,
        grid,
        np.concatenate(voxels) if voxels else np.zeros(0, np.float32),
        np.concatenate(majorants) if majorants else np.zeros((0, 2), np.float32),
    )


def _voxels(volume: Volume) -> int:
    return int(volume.density.size + (0 if volume.emission is None else volume.emission.size))


def _check(name: str, volume: Volume) -> None:
    for what, values in (("density", volume.density), ("emission", volume.emission)):
        if values is None:
            continue
        if values.ndim != 3 or 0 in values.shape:
            raise SceneError(
                Sentence(
                    "volume-shape-wrong",
                    "The volume {name}: its {what} has the shape {shape}; it needs three axes of at least one voxel",
                    name=name,
                    what=what,
                    shape=list(values.shape),
                )
            )
        if values.shape != volume.density.shape:
            raise SceneError(
                Sentence(
                    "volume-shapes-differ",
                    "The volume {name}: its emission has the shape {shape}, its density {other}; give both the same",
                    name=name,
                    shape=list(values.shape[::-1]),
                    other=list(volume.density.shape[::-1]),
                )
            )
        least, most = float(values.min()), float(values.max())
        if not (np.isfinite(least) and np.isfinite(most) and least >= 0 and most <= MOST_VALUE):
            raise SceneError(
                Sentence(
                    "volume-value-out-of-range",
                    "The volume {name}: its {what} has values from {least} to {most}; they must be from 0 to {limit}",
                    name=name,
                    what=what,
                    least=f"{least:g}",
                    most=f"{most:g}",
                    limit=f"{MOST_VALUE:g}",
                )
            )


def _to_unit(name: str, volume: Volume) -> npt.NDArray[Any]:
    """Returns the 4x4 matrix from the world to the volume's unit cube."""
    place = np.asarray(volume.to_world, np.float64)
    if not np.isfinite(place).all() or abs(np.linalg.det(place[:3, :3])) < 1e-30:
        raise SceneError(
            Sentence("volume-transform-flat", "The volume {name}: its transform or its bounds have no extent", name=name)
        )
    return np.linalg.inv(place)


def _majorants(volume: Volume) -> F32:
    """Returns the cells of a volume, (cz, cy, cx, 2): a bound of the density, and a coefficient for collisions with emission."""
    shape = [min(_MOST_CELLS, max(1, -(-count // _CELL))) for count in volume.density.shape]
    found = np.zeros((*shape, 2), np.float32)
    found[..., 0] = _largest(volume.density, shape) * _MARGIN
    if volume.emission is not None:
        edges = np.linalg.norm(np.asarray(volume.to_world, np.float64)[:3, :3], axis=0)[::-1] / shape
        found[..., 1] = (_largest(volume.emission, shape) > 0) / max(float(np.linalg.norm(edges)), 1e-30)
    return found


def _largest(values: F32, shape: list[int]) -> F32:
    """Returns the largest value in each cell, with the neighbours that interpolation reads there."""
    found: F32 = values
    for axis, cells in enumerate(shape):
        count = found.shape[axis]
        edges = np.arange(cells + 1) * count / cells  # in voxels
        low = np.clip(np.floor(edges[:-1] - 0.5).astype(int) - 1, 0, count - 1)
        high = np.clip(np.floor(edges[1:] - 0.5).astype(int) + 2, 0, count - 1)
        parts = [found.take(range(a, b + 1), axis=axis).max(axis=axis) for a, b in zip(low, high, strict=True)]
        found = np.stack(parts, axis=axis)
    return found
