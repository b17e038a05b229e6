"""Exports Principled Hair: its colour from the absorption of its fibres, and its roughness as a material extension.

Source: Chiang et al., "A practical and controllable hair and fur model for production path tracing", 2016, eq. 9; pigments as
in intern/cycles/kernel/closure/bsdf_principled_hair_chiang.h.
"""

from __future__ import annotations

import math
from typing import Any

from .nodes import ConstantValue, Source, constant_value

__all__ = ["HAIR", "hair", "hair_color"]

HAIR = "RAYFARM_materials_hair"  # read by renderer/scene/readers/gltf/scattering.py
EUMELANIN, PHEOMELANIN = (0.506, 0.841, 1.653), (0.343, 0.733, 1.924)
LEAST = 1e-4


def hair(surface: Any) -> dict[str, Any] | None:
    """Returns the glTF extension of a surface that is hair; None for other surfaces. Inputs with nodes get their defaults.

    Cycles tilts by the opposite of Chiang's angle (bsdf_principled_hair_chiang.h, `bsdf_principled_hair_setup`), and takes the
    roughness of Huang's model for the alpha of GGX.
    """
    if surface.input("Hair") is None:
        return None
    names = {
        "betaM": ("Roughness", 0.3),
        "betaN": ("Radial Roughness", 0.3),
        "tilt": ("Offset", math.radians(2)),
        "ior": ("IOR", 1.55),
    }
    is_huang = surface.input("Hair Aspect Ratio") is not None
    if is_huang:
        names |= {"aspectRatio": ("Aspect Ratio", 0.85), "r": ("Reflection", 1.0)}
        names |= {"tt": ("Transmission", 1.0), "trt": ("Secondary Reflection", 1.0)}
    found = {key: (constant_value(surface.input(f"Hair {name}")), default) for key, (name, default) in names.items()}
    numbers = {key: value if isinstance(value, float) else default for key, (value, default) in found.items()}
    said: dict[str, Any] = {**numbers, "tilt": -numbers["tilt"]}
    return {**said, "model": "huang", "alpha": numbers["betaM"]} if is_huang else said


def hair_color(source: Source) -> Any:
    """Returns the colour of a Principled Hair BSDF: its Color input, or a constant computed from its absorption or pigments."""
    kind = getattr(source.node, "parametrization", "COLOR")
    beta = constant_value(source.input("Radial Roughness"))
    beta = beta if isinstance(beta, float) else 0.3
    if kind == "ABSORPTION":
        absorbed = constant_value(source.input("Absorption Coefficient"))
        return source.input("Color") if absorbed is None else ConstantValue(_reflectance_from_absorption(absorbed, beta))
    if kind != "MELANIN":
        return source.input("Color")
    melanin, redness, tint = (constant_value(source.input(name)) for name in ("Melanin", "Melanin Redness", "Tint"))
    if not isinstance(melanin, float) or not isinstance(redness, float):
        return source.input("Color")
    pigment = -math.log(max(1 - max(melanin, 0.0), LEAST))
    brown, red = pigment * (1 - redness), pigment * redness
    dyed = [_absorbed(c, beta) for c in tint] if isinstance(tint, list) else [0.0] * 3
    return ConstantValue(
        _reflectance_from_absorption(
            [brown * e + red * p + d for e, p, d in zip(EUMELANIN, PHEOMELANIN, dyed, strict=True)], beta
        )
    )


def _roughness_polynomial(beta: float) -> float:
    return 5.969 - 0.215 * beta + 2.532 * beta**2 - 10.73 * beta**3 + 5.574 * beta**4 + 0.245 * beta**5


def _reflectance_from_absorption(absorbed: list[float], beta: float) -> list[float]:
    return [math.exp(-math.sqrt(max(a, 0.0)) * _roughness_polynomial(beta)) for a in absorbed]


def _absorbed(color: float, beta: float) -> float:
    return (math.log(min(max(color, LEAST), 1.0)) / _roughness_polynomial(beta)) ** 2
