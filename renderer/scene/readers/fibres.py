"""Returns materials of hair from the parameters of other formats."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Material
from renderer.scene.material import MOST_DENSE, PARAMETERS
from renderer.scene.readers.number_ranges import clamped

__all__ = ["BROWN", "absorption_of", "absorption_of_melanin", "elliptic_fibre", "fibre"]

F64 = npt.NDArray[np.float64]
BROWN = 1.3  # default concentration of eumelanin
_EUMELANIN, _PHEOMELANIN = (0.506, 0.841, 1.653), (0.343, 0.733, 1.924)  # as in Cycles and Arnold
_LEAST = 1e-4
_RANGES = {parameter.name: parameter for parameter in PARAMETERS}


def fibre(along: float, around: float, tilt: float, ior: float, absorption: Any = (0.0, 0.0, 0.0), **pigments: float) -> Material:
    """Returns a material of kind hair. along, around: beta_m and beta_n; tilt: radians; absorption: (3,) per radius.

    pigments: `eumelanin` and `pheomelanin`, concentrations. Numbers outside their ranges are clamped.
    """
    numbers = {"beta_m": along, "beta_n": around, "tilt": tilt, "ior": ior, **pigments}
    fields: dict[str, Any] = {name: _RANGES[name].clamped(value) for name, value in numbers.items()}
    r, g, b = (clamped(float(v), 0.0, MOST_DENSE) for v in np.asarray(absorption, float))
    return Material(kind="hair", base_color=(1.0, 1.0, 1.0), sigma_a=(r, g, b), **fields)


def elliptic_fibre(hair: Material, alpha: float, aspect: float, r: float, tt: float, trt: float) -> Material:
    """Returns hair with the model huang. alpha: the roughness of its facets; aspect: of its radii, either over the other."""
    numbers = {"aspect_ratio": aspect if aspect <= 1 else 1 / aspect, "r": r, "tt": tt, "trt": trt}
    fields: dict[str, Any] = {name: _RANGES[name].clamped(value) for name, value in numbers.items()}
    return replace(hair, model="huang", roughness=math.sqrt(clamped(alpha, 0.001, 1.0)), **fields)


def absorption_of(color: Any, around: float) -> F64:
    """Returns (3,) the absorption per radius at which much hair has a colour (Chiang et al. 2016, equation 9). around: beta_n."""
    powers = (5.969, -0.215, 2.532, -10.73, 5.574, 0.245)
    bright = np.log(np.clip(np.asarray(color, np.float64), _LEAST, 1.0))
    return np.asarray((bright / sum(c * around**k for k, c in enumerate(powers))) ** 2)


def absorption_of_melanin(melanin: float, redness: float, brown: Any = _EUMELANIN, red: Any = _PHEOMELANIN) -> F64:
    """Returns (3,) the absorption per radius by pigments of which 0 is none and 1 the most, as in Cycles.

    redness: the share of the red one. brown, red: (3,) absorption of either.
    """
    amount = -math.log(max(1 - max(melanin, 0.0), _LEAST))
    return np.asarray(amount * ((1 - redness) * np.asarray(brown) + redness * np.asarray(red)))
