"""Converts anisotropic roughness to glTF's anisotropy parameters."""

from __future__ import annotations

import math
from typing import Any

__all__ = ["brushed"]

_MIN_ALPHA = 1e-3  # minimum alpha


def brushed(along: float, across: float) -> dict[str, Any]:
    """Returns the material fields roughness, anisotropy and rotation for an anisotropic microfacet distribution.

    along, across: the distribution's alpha in the tangent's direction and perpendicular to it, each 0..1. glTF's anisotropy
    raises alpha in one direction only: from a to a + (1 - a) * strength^2. Source: KHR_materials_anisotropy.
    """
    if along == across:
        return {"roughness": math.sqrt(along)}
    least, most = min(along, across), max(along, across)
    strength = math.sqrt((most - least) / (1 - least)) if least < 1 else 0.0
    return {
        "roughness": math.sqrt(max(least, _MIN_ALPHA)),
        "anisotropy": strength,
        "anisotropy_rotation": 0.0 if along > across else math.pi / 2,
    }
