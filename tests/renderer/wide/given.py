"""Test inputs for formulas: random numbers, including rare and extreme values."""

import numpy as np

__all__ = ["SMALL", "N", "directions", "square"]

N = 8 * 1000
SMALL = np.float32(2.0**-24)


def square(rng, n=N):
    """Returns (n, 2) points in the unit square, including its corners and centre."""
    u = rng.random((n, 2), np.float32)
    u[:6] = [(0, 0), (0.5, 0.5), (1 - SMALL, 1 - SMALL), (0, 1 - SMALL), (1 - SMALL, 0), (0.5, 0)]
    return u


def directions(rng, n=N, above=False):
    w = rng.standard_normal((n, 3))
    w /= np.linalg.norm(w, axis=1)[:, None]
    if above:
        w[:, 2] = abs(w[:, 2])
    return w.astype(np.float32)
