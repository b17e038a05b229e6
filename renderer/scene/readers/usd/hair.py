"""Reads hair shaders in USD: MaterialX's chiang_hair_bsdf within a surface, and Arnold's standard_hair.

Sources: MaterialX 1.39.2, "PBR nodes" and mx_chiang_hair_bsdf.glsl; Arnold's documentation of standard_hair; Chiang et al., "A
practical and controllable hair and fur model for production path tracing", 2016.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdShade

from renderer.scene.description import Vec3
from renderer.scene.readers.fibres import absorption_of, absorption_of_melanin, fibre
from renderer.scene.readers.usd.preview_surface import Read, fill_base
from renderer.scene.readers.usd.surface_inputs import SurfaceInputs

__all__ = ["is_hair", "read_hair"]

ARNOLD = "arnold:standard_hair"
_SURFACE, _CHIANG = "ND_surface", "ND_chiang_hair_bsdf"  # documents in XML add the type to the name
_ROUGHNESS, _FROM_COLOR, _FROM_MELANIN = (
    *("ND_chiang_hair_roughness", "ND_chiang_hair_absorption_from_color", "ND_deon_hair_absorption_from_melanin"),
)
_WHITE: Vec3 = (1.0, 1.0, 1.0)
_BROWN: Vec3 = (0.657704, 0.498077, 0.254107)  # defaults of the pigments' colours
_RED: Vec3 = (0.829444, 0.67032, 0.349938)
_BETAS = np.linspace(0.0, 1.0, 4097)
_IS_NEUTRAL = {"tint_R": 1.0, "tint_TT": 1.0, "tint_TRT": 1.0}
_ARNOLD_NEUTRAL = {"specular_tint": 1.0, "specular2_tint": 1.0, "transmission_tint": 1.0, "diffuse": 0.0, "emission": 0.0}


def is_hair(shader: Any, kind: str) -> bool:
    """Returns True if a surface shader is hair. kind: the shader's identifier."""
    return kind == ARNOLD or (kind.split("_surfaceshader")[0] == _SURFACE and _source(shader, "bsdf", _CHIANG) is not None)


def read_hair(shader: Any, kind: str, read: Read) -> None:
    """Fills the material from a surface shader that is hair."""
    if kind == ARNOLD:
        _standard_hair(SurfaceInputs(shader, read), read)
    else:
        _chiang(_source(shader, "bsdf", _CHIANG), read)


def _source(shader: Any, name: str, kind: str) -> Any:
    """Returns the shader whose output an input has, if it is of a kind; else None. kind: how its identifier begins."""
    given = shader.GetInput(name)
    found: list[Any] = given.GetValueProducingAttributes() if given else []
    if not found or UsdShade.Utils.GetType(found[0].GetName()) != UsdShade.AttributeType.Output:
        return None
    source = UsdShade.Shader(found[0].GetPrim())
    return source if str(source.GetIdAttr().Get() or "").startswith(kind) else None


def _chiang(shader: Any, read: Read) -> None:
    inputs = SurfaceInputs(shader, read)
    inputs.leave_out(_IS_NEUTRAL)
    along, around = _betas(shader, inputs, read)
    tilt = math.pi * (0.5 - inputs.number("cuticle_angle", 0.5))  # above 0.5 scales are tilted towards the root
    ior = inputs.number("ior", 1.55)
    colored = _source(shader, "absorption_coefficient", _FROM_COLOR)
    pigments = _source(shader, "absorption_coefficient", _FROM_MELANIN)
    if colored is not None:
        name = read.material.name
        read.material = replace(fibre(along, around, tilt, ior), name=name)
        fill_base(read, SurfaceInputs(colored, read)("color", True), _WHITE)
        return
    if pigments is not None:
        said = SurfaceInputs(pigments, read)
        colors = (said.color(f"{pigment}_color", default) for pigment, default in (("eumelanin", _BROWN), ("pheomelanin", _RED)))
        brown, red = (-np.log(np.clip(color, 1e-4, 1.0)) for color in colors)
        concentration, redness = said.number("melanin_concentration", 0.25), said.number("melanin_redness", 0.5)
        absorption: Any = absorption_of_melanin(concentration, redness, brown, red)
    else:
        absorption = inputs.color("absorption_coefficient", (0.0, 0.0, 0.0))
    read.material = replace(fibre(along, around, tilt, ior, absorption), name=read.material.name)


def _betas(shader: Any, inputs: SurfaceInputs, read: Read) -> tuple[float, float]:
    """Returns the roughnesses along a fibre and around it, beta_m and beta_n.

    They are those of a node chiang_hair_roughness, or follow from the first lobe's variance and scale.
    """
    made = _source(shader, "roughness_R", _ROUGHNESS)
    if made is not None:
        said = SurfaceInputs(made, read)
        said.leave_out({"scale_TT": 0.5, "scale_TRT": 2.0})
        return said.number("longitudinal", 0.1), said.number("azimuthal", 0.2)
    given = inputs("roughness_R").value
    try:
        variance, scale = (float(v) for v in tuple(given)[:2])
    except (TypeError, ValueError):
        variance, scale = 0.1, 0.1
    spreads: npt.NDArray[np.float64] = 0.726 * _BETAS + 0.812 * _BETAS**2 + 3.7 * _BETAS**20
    scales: npt.NDArray[np.float64] = 0.265 * _BETAS + 1.194 * _BETAS**2 + 5.372 * _BETAS**22
    return float(np.interp(math.sqrt(max(variance, 0.0)), spreads, _BETAS)), float(np.interp(scale, scales, _BETAS))


def _standard_hair(inputs: SurfaceInputs, read: Read) -> None:
    inputs.leave_out(_ARNOLD_NEUTRAL)
    along = inputs.number("roughness", 0.2)
    around = inputs.number("roughness_azimuthal", 0.2) if inputs.number("roughness_anisotropic", 0.0) else along
    tilt, ior = -math.radians(inputs.number("shift", 3.0)), inputs.number("ior", 1.55)  # positive shifts are towards the root
    melanin, redness = inputs.number("melanin", 1.0), inputs.number("melanin_redness", 0.5)
    if melanin <= 0:
        name, base = read.material.name, inputs.number("base", 1.0)
        read.material = replace(fibre(along, around, tilt, ior), name=name)
        fill_base(read, inputs("base_color", True), _WHITE)
        if base != 1:
            r, g, b = (base * c for c in read.material.base_color)
            read.material.base_color = (r, g, b)
        return
    dye = absorption_of(np.array(inputs.color("base_color")) * inputs.number("base", 1.0), around)
    absorption = absorption_of_melanin(melanin, redness) + dye
    read.material = replace(fibre(along, around, tilt, ior, absorption), name=read.material.name)
