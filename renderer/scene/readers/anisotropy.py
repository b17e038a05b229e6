"""Converts anisotropic roughness to glTF's anisotropy parameters."""

from __future__ import annotations

import math
from typing import Any

__all__ = ["brushed"]

_LEAST = 1e-3  # minimum alpha


def brushed(along: float, across: float) -> dict[str, Any]:
    """Returns the material fields for a microfacet distribution with alpha `along` the tangent and `across` it, each 0..1.

    In the direction of glTF's anisotropy, alpha is interpolated towards 1 by strength squared. Source: KHR_materials_anisotropy.
    """
    if along == across:
        return {"roughness": math.sqrt(along)}
    least, most = min(along, across), max(along, across)
    strength = math.sqrt((most - least) / (1 - least)) if least < 1 else 0.0
    return {
        "roughness": math.sqrt(max(least, _LEAST)),
        "anisotropy": strength,
        "anisotropy_rotation": 0.0 if along > across else math.pi / 2,
    }
