"""The reflectance of thin films by the matrix method."""

from __future__ import annotations

import numpy as np

__all__ = ["by_matrices"]


def by_matrices(base: float, ior: float, thickness: float, cosine: float, wavelengths: np.ndarray) -> np.ndarray:
    """Returns the reflectance of a film between air and a base by characteristic matrices (Born & Wolf, 1.6), unpolarised."""
    within, beyond = (np.sqrt(1 - (1 - cosine**2) / index**2) for index in (ior, base))
    phase = 2 * np.pi * ior * thickness * within / wavelengths
    sides = (cosine, ior * within, base * beyond), (1 / cosine, ior / within, base / beyond)  # admittances, s and p
    squares = []
    for air, film, last in sides:
        electric = np.cos(phase) + 1j * np.sin(phase) * last / film
        magnetic = 1j * film * np.sin(phase) + np.cos(phase) * last
        squares.append(np.abs((air * electric - magnetic) / (air * electric + magnetic)) ** 2)
    return np.asarray(sum(squares) / 2)
