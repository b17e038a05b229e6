"""Surfaces that are rougher in one direction than across it, by glTF's anisotropy."""

from __future__ import annotations

import math
from typing import Any

__all__ = ["brushed"]

_LEAST = 1e-3  # alpha of what counts as rough


def brushed(along: float, across: float) -> dict[str, Any]:
    """Fields of a material whose microfacets have these alphas along the tangent and across it, 0 to 1.

    Along glTF's direction alpha goes towards 1 by the square of the strength. Source: KHR_materials_anisotropy.
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
