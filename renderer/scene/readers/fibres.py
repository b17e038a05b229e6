"""Returns materials of hair from the parameters of other formats."""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer.scene.description import Material
from renderer.scene.material import MOST_DENSE, PARAMETERS
from renderer.scene.readers.number_ranges import clamped

__all__ = ["BROWN", "fibre"]

BROWN = 1.3  # default concentration of eumelanin
_RANGES = {parameter.name: parameter for parameter in PARAMETERS}


def fibre(along: float, around: float, tilt: float, ior: float, absorption: Any = (0.0, 0.0, 0.0), **pigments: float) -> Material:
    """Returns a material of kind hair. along, around: beta_m and beta_n; tilt: radians; absorption: (3,) per radius.

    pigments: `eumelanin` and `pheomelanin`, concentrations. Numbers outside their ranges are clamped.
    """
    numbers = {"beta_m": along, "beta_n": around, "tilt": tilt, "ior": ior, **pigments}
    fields: dict[str, Any] = {name: _RANGES[name].clamped(value) for name, value in numbers.items()}
    r, g, b = (clamped(float(v), 0.0, MOST_DENSE) for v in np.asarray(absorption, float))
    return Material(kind="hair", sigma_a=(r, g, b), **fields)
