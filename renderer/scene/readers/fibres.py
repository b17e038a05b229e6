"""Fibres of hair as glossy surfaces of the colour that a head of them has: light that goes through fibres is not followed.

Source: Chiang et al., "A practical and controllable hair and fur model for production path tracing", 2016, eq. 9 (absorption and
colour) and eq. 7 (roughness along the fibre, and the variance that it stands for); d'Eon et al., "An energy-conserving hair
reflectance model", EGSR 2011 (pigments).
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
BROWN = 1.3  # of eumelanin, where nothing is said
_EUMELANIN, _PHEOMELANIN = np.array([0.419, 0.697, 1.37]), np.array([0.187, 0.4, 1.05])


def fibre(color: Vec3, along: float, ior: float) -> Material:
    """A glossy surface of a colour. along: the longitudinal roughness, 0 to 1."""
    rough = clamped(math.sqrt(deviation(clamped(along, 0.0, 1.0))), 0.0, 1.0)
    return Material(kind="metallic_roughness", base_color=unit_color(color), ior=clamped(ior, 1.0, 4.0), roughness=rough)


def deviation(beta: float) -> float:
    """The angle, in radians, by which fibres of this longitudinal roughness spread light: the root of Chiang's variance."""
    return 0.726 * beta + 0.812 * beta**2 + 3.7 * beta**20


def pigments(eumelanin: float, pheomelanin: float) -> F64:
    """(3,) what fibres with so much of both absorb."""
    return max(eumelanin, 0.0) * _EUMELANIN + max(pheomelanin, 0.0) * _PHEOMELANIN


def color_of(absorption: Any, beta: float) -> Vec3:
    """The colour that a head of hair has whose fibres, 2 wide, absorb so much; beta: the azimuthal roughness."""
    spread = 5.969 - 0.215 * beta + 2.532 * beta**2 - 10.73 * beta**3 + 5.574 * beta**4 + 0.245 * beta**5
    r, g, b = (float(v) for v in np.exp(-np.sqrt(np.maximum(np.asarray(absorption, float), 0.0)) * spread))
    return r, g, b
