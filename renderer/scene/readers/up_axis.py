"""Rotations of files whose up axis is not Y, as 4 x 4 matrices of column vectors."""

from __future__ import annotations

import numpy as np

__all__ = ["X_UP", "Z_UP"]

X_UP = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
