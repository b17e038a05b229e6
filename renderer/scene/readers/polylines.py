"""Chooses how finely fibres are divided into lines: by how far they bend, relative to their width."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

__all__ = ["by_stride"]

F64 = npt.NDArray[np.float64]


def by_stride(
    lines: F64, radii: F64, steps: int, tolerance: float | None, most: int
) -> Iterator[tuple[npt.NDArray[np.int64], slice]]:
    """Yields the polylines that are to be as fine as each other: (their indices, the slice of their points that are kept).

    lines: (N, S, 3), `steps` lines for each segment of a cubic curve; radii: (N, S). A polyline keeps every point of which a
    divisor of `steps` is the distance: the largest one that leaves all its points within `tolerance` times its mean radius of it,
    or else the one that leaves `most` lines for each segment. tolerance: None keeps as many points of each polyline, whatever
    its shape, since polylines that bend over time must keep the same points.
    """
    rest = np.arange(len(lines))
    strides = [each for each in range(steps, 0, -1) if steps % each == 0 and steps // each <= most]
    for stride in strides:
        far = np.full(len(rest), stride != strides[-1])
        if stride != strides[-1] and tolerance is not None:
            far = _deviation(lines[rest], stride) > tolerance * radii[rest].mean(axis=1)
        chosen = rest[~far]
        rest = rest[far]
        if len(chosen):
            yield chosen, slice(None, None, stride)
        if not len(rest):
            break


def _deviation(lines: F64, stride: int) -> F64:
    """Returns (N,) the largest distance of a point from the line between the kept points around it, at equal shares of both."""
    found = np.zeros(len(lines))
    first, last = lines[:, :-1:stride], lines[:, stride::stride]
    for k in range(1, stride):
        apart = lines[:, k::stride] - (first + (last - first) * (k / stride))
        found = np.maximum(found, np.sqrt((apart * apart).sum(axis=2)).max(axis=1, initial=0))
    return found
