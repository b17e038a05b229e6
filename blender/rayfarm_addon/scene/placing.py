"""Decomposes many matrices into translation, rotation and scale."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["decompose", "followed"]

F64 = npt.NDArray[np.float64]
SHEAR = 1e-5


def decompose(matrices: F64) -> tuple[F64, F64, F64, npt.NDArray[np.bool_]]:
    """Decomposes matrices (N, 4, 4) into translations (N, 3), rotations (N, 4) as x, y, z, w, and scales (N, 3).

    The fourth result is whether each matrix has no shear. A mirroring matrix has a negative first scale.
    """
    linear = matrices[:, :3, :3]
    scales = np.linalg.norm(linear, axis=1)
    scales[:, 0] *= np.where(np.linalg.det(linear) < 0, -1.0, 1.0)
    safe = np.where(np.abs(scales) < 1e-30, 1.0, scales)
    turns = linear / safe[:, None, :]
    straight = np.abs(np.swapaxes(turns, 1, 2) @ turns - np.eye(3)).max(axis=(1, 2), initial=0.0) < SHEAR
    return matrices[:, :3, 3].copy(), _quaternions(turns), scales, straight & (np.abs(scales) > 1e-30).all(axis=1)


def _quaternions(r: F64) -> F64:
    """Returns rotation matrices as quaternions x, y, z, w, computed from the greatest component (Shepperd 1978).

    Starting from the greatest component avoids dividing by the root of a small number.
    """
    d = np.stack([r[:, 0, 0], r[:, 1, 1], r[:, 2, 2]], axis=1)
    trace = d.sum(axis=1)
    which = np.argmax(np.concatenate([d, trace[:, None]], axis=1), axis=1)
    q = np.empty((len(r), 4))
    for k in range(3):
        i = which == k
        j, l = (k + 1) % 3, (k + 2) % 3  # noqa: E741
        q[i, k] = 1 + 2 * d[i, k] - trace[i]
        q[i, j] = r[i, j, k] + r[i, k, j]
        q[i, l] = r[i, l, k] + r[i, k, l]
        q[i, 3] = r[i, l, j] - r[i, j, l]
    i = which == 3
    q[i, 0], q[i, 1], q[i, 2] = r[i, 2, 1] - r[i, 1, 2], r[i, 0, 2] - r[i, 2, 0], r[i, 1, 0] - r[i, 0, 1]
    q[i, 3] = 1 + trace[i]
    return q / np.maximum(np.linalg.norm(q, axis=1, keepdims=True), 1e-30)


def followed(rotations: F64) -> F64:
    """Returns the quaternions, negated where necessary so that interpolation from each to the next takes the shorter arc."""
    found = rotations.copy()
    for i in range(1, len(found)):
        if found[i] @ found[i - 1] < 0:
            found[i] *= -1
    return found
