"""Counts how many segments of paths cross the voxels of a grid."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.guiding.histograms import sums

__all__ = ["Voxels"]

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


class Voxels:
    """A grid of cubic voxels between two corners, and the pairs of a segment and a voxel that it crosses.

    The voxel in which a segment begins is left out. origin, direction: (n, 3), unit directions. length: (n,). low, high: (3,).
    size: of a voxel.
    """

    def __init__(self, origin: F64, direction: F64, length: F64, low: F64, high: F64, size: float) -> None:
        self.size, self._low = size, low
        self._counts = np.ceil((high - low) / size - 1e-9).astype(np.int64)
        pairs: list[tuple[I64, I64]] = []
        alive = np.arange(len(origin))
        own = last = self._voxels(origin)
        for step in range(1, 2 * int(self._counts.max())):
            at = step * size
            point = origin[alive] + at * direction[alive]
            inside = ((point >= low) & (point < high)).all(axis=1) & (at < length[alive])
            alive, point, last, own = alive[inside], point[inside], last[inside], own[inside]
            if not len(alive):
                break
            voxel = self._voxels(point)
            new = (voxel != last) & (voxel != own)
            pairs.append((alive[new], voxel[new]))
            last = voxel
        self._segment, self._voxel = (
            np.concatenate([pair[k] for pair in pairs]) if pairs else np.zeros(0, np.int64) for k in (0, 1)
        )

    def _voxels(self, point: F64) -> I64:
        x, y, z = np.clip(((point - self._low) / self.size).astype(np.int64), 0, self._counts - 1).T
        return (x * self._counts[1] + y) * self._counts[2] + z

    def largest(self, number: I64) -> tuple[int, int]:
        """Returns (the count, the voxel) of the voxel that is crossed most. number: how often each segment counts, (n,)."""
        crossed = sums(self._voxel, number[self._segment], int(self._counts.prod()))
        voxel = int(np.argmax(crossed))
        return int(crossed[voxel]), voxel

    def center(self, voxel: int) -> F64:
        """Returns the centre of a voxel, (3,)."""
        rest, z = divmod(voxel, int(self._counts[2]))
        x, y = divmod(rest, int(self._counts[1]))
        center: F64 = self._low + (np.array([x, y, z]) + 0.5) * self.size
        return center
