"""Renders hair fibres as opaque glossy surfaces in the colour of a full head of hair, without transmission through fibres.

Source: Chiang et al., "A practical and controllable hair and fur model for production path tracing", 2016, eq. 9 (absorption and
colour) and eq. 7 (longitudinal roughness and its variance); d'Eon et al., "An energy-conserving hair reflectance model",
EGSR 2011 (pigments).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Material, Vec3
from renderer.scene.readers.number_ranges import clamped, unit_color

__all__ = ["BROWN", "color_of", "deviation", "fibre", "pigments"]

F64 = npt.NDArray[np.float64]
BROWN = 1.3  # default concentration of eumelanin
_EUMELANIN, _PHEOMELANIN = np.array([0.419, 0.697, 1.37]), np.array([0.187, 0.4, 1.05])


def fibre(color: Vec3, along: float, ior: float) -> Material:
    """Returns the glossy material of a fibre. along: longitudinal roughness, 0..1."""
    rough = clamped(math.sqrt(deviation(clamped(along, 0.0, 1.0))), 0.0, 1.0)
    return Material(kind="metallic_roughness", base_color=unit_color(color), ior=clamped(ior, 1.0, 4.0), roughness=rough)


def deviation(beta: float) -> float:
    """Returns the standard deviation, in radians, of a fibre's longitudinal scattering.

    It is the square root of the variance in Chiang et al., eq. 7. beta: longitudinal roughness.
    """
    return 0.726 * beta + 0.812 * beta**2 + 3.7 * beta**20


def pigments(eumelanin: float, pheomelanin: float) -> F64:
    """Returns (3,) RGB absorption coefficients for concentrations of eumelanin and pheomelanin."""
    return max(eumelanin, 0.0) * _EUMELANIN + max(pheomelanin, 0.0) * _PHEOMELANIN


def color_of(absorption: Any, beta: float) -> Vec3:
    """Returns the colour of hair whose fibres have these absorption coefficients, for a fibre diameter of 2.

    beta: azimuthal roughness.
    """
    spread = 5.969 - 0.215 * beta + 2.532 * beta**2 - 10.73 * beta**3 + 5.574 * beta**4 + 0.245 * beta**5
    r, g, b = (float(v) for v in np.exp(-np.sqrt(np.maximum(np.asarray(absorption, float), 0.0)) * spread))
    return r, g, b
