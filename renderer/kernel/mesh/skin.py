"""Skins a mesh's vertices; compiled like the kernels so that the result has the same bits on every host."""

from __future__ import annotations

import numpy as np

from renderer.jit import device, entry

__all__ = ["carry"]


@entry
def carry(matrix, joint, weight, point, normal, tangent, placed, turned, bent):
    """Skins vertices: fills placed, turned and bent, (V, 3) float32, with transformed points, normals and tangents.

    Each vertex is transformed by the weighted mean of its joints' matrices. matrix: (J, 4, 4) f64, one for each joint. joint,
    weight: (V, K), the joints of a vertex and their weights, in any scale; a vertex whose weights are all 0 does not move. normal
    with turned, and tangent with bent, may have no rows. Normals are transformed by the cofactor matrix and not normalised.
    """
    for i in range(len(point)):
        total = 0.0
        for k in range(weight.shape[1]):
            total += np.float64(weight[i, k])
        x, y, z, t = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)  # columns of the mean matrix
        if total > 0.0:
            x = y = z = (0.0, 0.0, 0.0)
            for k in range(weight.shape[1]):
                share = np.float64(weight[i, k]) / total
                if share != 0.0:
                    x = _add_joint_column(x, share, matrix, joint[i, k], 0)
                    y = _add_joint_column(y, share, matrix, joint[i, k], 1)
                    z = _add_joint_column(z, share, matrix, joint[i, k], 2)
                    t = _add_joint_column(t, share, matrix, joint[i, k], 3)
        px, py, pz = np.float64(point[i, 0]), np.float64(point[i, 1]), np.float64(point[i, 2])
        for k in range(3):
            placed[i, k] = x[k] * px + y[k] * py + z[k] * pz + t[k]
        if len(normal) > 0:
            nx, ny, nz = np.float64(normal[i, 0]), np.float64(normal[i, 1]), np.float64(normal[i, 2])
            a, b, c = _cross(y, z), _cross(z, x), _cross(x, y)
            for k in range(3):
                turned[i, k] = a[k] * nx + b[k] * ny + c[k] * nz
        if len(tangent) > 0:
            tx, ty, tz = np.float64(tangent[i, 0]), np.float64(tangent[i, 1]), np.float64(tangent[i, 2])
            for k in range(3):
                bent[i, k] = x[k] * tx + y[k] * ty + z[k] * tz


@device
def _add_joint_column(column, share, matrix, joint, k):
    """Returns `column` plus `share` times column k of joint matrix `joint`: one step in summing a vertex's mean matrix."""
    return (
        column[0] + share * matrix[joint, 0, k],
        column[1] + share * matrix[joint, 1, k],
        column[2] + share * matrix[joint, 2, k],
    )


@device
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
