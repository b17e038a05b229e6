"""Divides the strands of hair into lines along Catmull-Rom curves through their points, as Cycles draws hair.

The curve through a strand's end continues as if that point were there twice (intern/cycles/scene/hair.cpp).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["divided", "lines_per_segment"]

F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]
MOST_LINES = 6
TOLERANCE = 0.25  # distance from the curve, in mean radii of the strand


def lines_per_segment(points: F32, radii: F32, first: I32, most_points: int) -> I32:
    """Returns (S,) the number of lines for each segment of each strand: as few as follow its curve.

    points: (P, 3), radii: (P,), strand by strand. first: (S + 1,) start index of each strand, followed by P. most_points: the
    number of points after division above which strands are divided less.
    """
    strand, neighbours = _segments(first)
    before, a, b, after = (points[k].astype(np.float64) for k in neighbours)
    # A curve is within 3/4 of the distance of its Bezier handles from the line between its ends.
    chord = b - a
    length2 = np.maximum((chord * chord).sum(axis=1, keepdims=True), 1e-30)
    handles = [each - chord * ((each * chord).sum(axis=1, keepdims=True) / length2) for each in (b - before, after - a)]
    away = np.maximum(*(np.linalg.norm(each, axis=1) for each in handles)) / 8
    count = len(first) - 1
    furthest, width = np.zeros(count), np.zeros(count)
    np.maximum.at(furthest, strand, away)
    sizes = np.diff(first)
    np.add.at(width, np.repeat(np.arange(count), sizes), radii)
    width = np.maximum(TOLERANCE * width / np.maximum(sizes, 1), 1e-12)
    lines = np.clip(np.ceil(np.sqrt(furthest / width)), 1, MOST_LINES).astype(np.int32)
    while (lines * (sizes - 1)).sum() + count > most_points and lines.max() > 1:
        lines = np.maximum(lines - 1, 1)
    return lines


def divided(points: F32, radii: F32, first: I32, lines: I32) -> tuple[F32, F32, I32]:
    """Returns the points, radii and start indices of strands of which each segment is divided into some lines.

    lines: (S,) for each strand. The other arguments are as for `lines_per_segment`.
    """
    sizes = np.diff(first)
    ends = np.concatenate([[0], np.cumsum(lines * (sizes - 1) + 1)])
    strand, neighbours = _segments(first)
    per_segment = lines[strand]
    segment = np.repeat(np.arange(len(strand)), per_segment)
    place = np.arange(len(segment)) - np.repeat(np.cumsum(per_segment) - per_segment, per_segment)
    u = (place / per_segment[segment])[:, None]
    values = np.column_stack([points, radii]).astype(np.float64)
    before, a, b, after = (values[k][segment] for k in neighbours)
    curve = a + u / 2 * ((b - before) + u * ((2 * before - 5 * a + 4 * b - after) + u * (3 * (a - b) + after - before)))
    out = np.empty((ends[-1], 4))
    is_last = np.zeros(len(out), bool)
    is_last[ends[1:] - 1] = True
    out[is_last], out[~is_last] = values[first[1:] - 1], curve
    return out[:, :3].astype(np.float32), np.maximum(out[:, 3], 0).astype(np.float32), ends.astype(np.int32)


def _segments(first: I32) -> tuple[I32, tuple[I32, I32, I32, I32]]:
    """Returns each segment's strand, and the indices of the four points that determine its curve."""
    sizes = np.diff(first)
    strand = np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)
    index = np.arange(first[-1], dtype=np.int32)
    is_last = index == (first[1:] - 1)[strand]
    a, strand = index[~is_last], strand[~is_last]
    return strand, (np.maximum(a - 1, first[strand]), a, a + 1, np.minimum(a + 2, first[strand + 1] - 1))
