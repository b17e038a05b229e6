"""Inverses and scales of instance transforms, with the same bits on every host: LAPACK's last bits depend on the processor."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.jit import device, entry

__all__ = ["invert_transforms", "place_boxes", "scale_range"]

F64 = npt.NDArray[np.float64]

_SWEEPS = 12  # of Jacobi rotations: three columns are orthogonal to the last bit after five or six


def invert_transforms(transform: F64) -> F64:
    """Returns the inverses of (I, 3, 4) transforms: a matrix and, last column, a translation."""
    transform = np.ascontiguousarray(transform, np.float64).reshape(-1, 3, 4)
    inverse = np.empty_like(transform)
    _invert(transform, inverse)
    return inverse


def scale_range(transform: F64) -> F64:
    """Returns the largest and the smallest scale factor of (I, 3, 4) transforms, (I, 2); NaN if not finite."""
    transform = np.ascontiguousarray(transform, np.float64).reshape(-1, 3, 4)
    found = np.empty((len(transform), 2))
    _singular_values(transform, np.empty((3, 3)), found)
    return found


@device
def _cofactor(m, i, row, column):
    """Returns the cofactor of a matrix element of transform i."""
    a, b = (row + 1) % 3, (row + 2) % 3
    c, d = (column + 1) % 3, (column + 2) % 3
    return m[i, a, c] * m[i, b, d] - m[i, a, d] * m[i, b, c]


@entry
def _invert(transform, inverse):
    """Inverts transforms by Cramer's rule.

    The caller must have rejected nearly singular ones (renderer/scene/instances.py does).
    """
    for i in range(len(transform)):
        determinant = 0.0
        for k in range(3):
            determinant += transform[i, 0, k] * _cofactor(transform, i, np.int64(0), k)
        for row in range(3):
            for column in range(3):
                inverse[i, row, column] = _cofactor(transform, i, column, row) / determinant
        for row in range(3):
            offset = 0.0
            for k in range(3):
                offset += inverse[i, row, k] * transform[i, k, 3]
            inverse[i, row, 3] = -offset


@entry
def _singular_values(transform, column, found):
    """Computes the largest and the smallest singular value of a transform's matrix.

    One-sided Jacobi: rotations make the columns orthogonal, and their lengths are then the singular values; Golub & Van Loan,
    "Matrix Computations", 8.6.3. column: scratch, (3, 3). found: receives the two values.
    """
    for i in range(len(transform)):
        largest = 0.0
        for j in range(3):
            for k in range(3):
                size = abs(transform[i, j, k])
                largest = largest if size <= largest else size  # preserves NaN
        if not largest < np.inf:
            found[i, 0] = found[i, 1] = np.nan
            continue
        if largest == 0.0:
            found[i, 0] = found[i, 1] = 0.0
            continue
        for j in range(3):
            for k in range(3):
                column[k, j] = transform[i, j, k] / largest
        for _ in range(_SWEEPS):
            for p in range(2):
                for q in range(p + 1, 3):
                    pp, qq, pq = 0.0, 0.0, 0.0
                    for j in range(3):
                        pp += column[p, j] * column[p, j]
                        qq += column[q, j] * column[q, j]
                        pq += column[p, j] * column[q, j]
                    if pq == 0.0:
                        continue
                    ratio = (qq - pp) / (2.0 * pq)
                    tangent = 1.0 / (abs(ratio) + np.sqrt(1.0 + ratio * ratio))
                    tangent = tangent if ratio >= 0.0 else -tangent
                    cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
                    sine = cosine * tangent
                    for j in range(3):
                        a, b = column[p, j], column[q, j]
                        column[p, j] = cosine * a - sine * b
                        column[q, j] = sine * a + cosine * b
        most, least = 0.0, np.inf
        for k in range(3):
            length = np.sqrt(column[k, 0] * column[k, 0] + column[k, 1] * column[k, 1] + column[k, 2] * column[k, 2])
            most, least = max(most, length), min(least, length)
        found[i, 0], found[i, 1] = most * largest, least * largest


@entry
def place_boxes(box, first, shown, to_world, slack, placed):
    """Fills placed (I, 2, 3): lower and upper corners of the world-space bounds of all boxes of each instance's tree.

    box: (B, 2, 3) f64, the boxes of all trees; those of tree g start at first[g]. shown: (I,) the tree of each instance. slack:
    the enlargement of a box relative to its size and position. A tree without boxes becomes a point.
    """
    for i in range(len(shown)):
        tree = shown[i]
        for k in range(3):
            low, high = np.inf, -np.inf
            for b in range(first[tree], first[tree + 1]):
                center, extent = to_world[i, k, 3], 0.0
                for j in range(3):
                    center += to_world[i, k, j] * (0.5 * (box[b, 0, j] + box[b, 1, j]))
                    extent += abs(to_world[i, k, j]) * (0.5 * (box[b, 1, j] - box[b, 0, j]))
                low, high = min(low, center - extent), max(high, center + extent)
            if first[tree] == first[tree + 1]:
                low = high = to_world[i, k, 3]
            more = slack * max(abs(low), max(abs(high), high - low))
            placed[i, 0, k], placed[i, 1, k] = low - more, high + more
