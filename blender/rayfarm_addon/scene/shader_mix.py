"""Expresses Blender's shaders, and mixes of two, as inputs of one Principled BSDF.

A mix with a constant or image factor becomes a surface with mixed inputs; a mix of a glossy shader by Fresnel's law becomes a
reflection on the other surface. Mixes that cannot be expressed exactly (such as of a metal and a dielectric of different
colours) are approximated, with a warning.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from ..farm.protocol.sentences import Sentence
from .cycles_differences import warn_of_shader, warn_of_surface
from .fibres import hair_color
from .nodes import Blend, ConstantValue, SocketInGroups, Source, SquareRoot, constant_value, source_of

__all__ = ["PrincipledLook", "brushed", "input_for_camera_rays", "principled_look", "under_coat"]

BLACK, WHITE = ConstantValue([0.0] * 3), ConstantValue([1.0] * 3)
SHARE = 0.5
CLEAR = 0.999
# Mean path length through a coat, relative to its thickness, of light from a matt surface, for an IOR of 1.5.
COAT_PATH_LENGTH = 1.15
MOST_POLISHED = 0.95  # weight of the metal in a mix from which on the mix is a metal
# Inputs of a Principled BSDF that other shaders lack, with the values equivalent to their absence.
DEFAULTS: dict[str, ConstantValue] = {
    "Base Color": ConstantValue([0.8] * 3),
    "Metallic": ConstantValue(0.0),
    "Roughness": ConstantValue(0.5),
    "IOR": ConstantValue(1.5),
    "Alpha": ConstantValue(1.0),
    "Specular IOR Level": ConstantValue(0.5),
    "Specular Tint": ConstantValue([1.0] * 3),
    "Transmission Weight": ConstantValue(0.0),
    "Translucent Weight": ConstantValue(0.0),
    "Translucent Color": ConstantValue([0.8] * 3),
    "Coat Weight": ConstantValue(0.0),
    "Coat Roughness": ConstantValue(0.03),
    "Sheen Weight": ConstantValue(0.0),
    "Sheen Tint": ConstantValue([1.0] * 3),
    "Sheen Roughness": ConstantValue(0.5),
    "Emission Color": ConstantValue([1.0] * 3),
    "Emission Strength": ConstantValue(0.0),
    "Anisotropic": ConstantValue(0.0),
    "Anisotropic Rotation": ConstantValue(0.0),
    "Subsurface Weight": ConstantValue(0.0),
}
LINKED = ("Normal", "Coat Normal", "Tangent")  # inputs that are not interpolated: one of the two is used
OF_GLOSS = ("Roughness", "IOR", "Specular IOR Level", "Specular Tint", "Anisotropic", "Anisotropic Rotation")


class PrincipledLook:
    """A shader expressed by the inputs of a Principled BSDF; called a "look" in this package.

    inputs: by input name. beneath: returns inputs that are not in `inputs`. is_matt: whether the shader only reflects diffusely.
    """

    is_clear = False  # whether the surface is completely transparent

    def __init__(self, inputs: Mapping[str, Any], beneath: Callable[..., Any] | None = None, is_matt: bool = False) -> None:
        self._inputs, self._beneath, self.is_matt = inputs, beneath, is_matt

    def input(self, *names: str) -> Any:
        """Returns the look's first input with one of these names; None if it has none of them."""
        for name in names:
            if name in self._inputs:
                return self._inputs[name]
        return self._beneath(*names) if self._beneath is not None else None

    def with_inputs(self, inputs: Mapping[str, Any], is_matt: bool = False) -> PrincipledLook:
        """Returns a copy of the look in which these inputs are replaced."""
        return PrincipledLook(inputs, self.input, is_matt)


class _Clear(PrincipledLook):
    is_clear = True

    def __init__(self) -> None:
        super().__init__({"Alpha": ConstantValue(0.0)})


def brushed(strength: float, roughness: float, turns: float) -> tuple[float, dict[str, float]]:
    """Returns (glTF's roughness, glTF's anisotropy parameters) for an anisotropic highlight of Cycles.

    Cycles stretches the lobe in both directions relative to the roughness, glTF along the tangent only. strength: at most 1 for
    the Principled BSDF; values up to 1 / 0.9 come from other shaders. turns: the rotation, in full turns.
    """
    aspect = math.sqrt(max(1 - 0.9 * strength, 1e-4))
    along, across = min(roughness**2 / aspect, 1.0), roughness**2 * aspect
    stretch = math.sqrt(max(along - across, 0.0) / max(1 - across, 1e-6))
    return math.sqrt(across), {"anisotropyStrength": min(stretch, 1.0), "anisotropyRotation": turns * 2 * math.pi}


def under_coat(surface: PrincipledLook) -> list[float] | None:
    """Returns the approximate factor, rgb, by which a tinted coat multiplies the colours beneath it; None if it is colourless."""
    weight, tint = constant_value(surface.input("Coat Weight")), constant_value(surface.input("Coat Tint"))
    if not isinstance(weight, float) or not isinstance(tint, list) or weight <= 0 or min(tint) > CLEAR:
        return None
    share = min(weight, 1.0)
    return [1 + share * (min(max(c, 0.0), 1.0) ** COAT_PATH_LENGTH - 1) for c in tint]


def _principled_anisotropy(anisotropy: Any, rotation: Any) -> dict[str, Any]:
    """Converts the anisotropy and rotation of a Glossy BSDF to those of a Principled BSDF.

    The lobe of a Glossy BSDF is narrower along the tangent, by a factor of 1 - anisotropy.
    """
    strength, turns = constant_value(anisotropy), constant_value(rotation)
    if not strength or not isinstance(turns, float):
        return {} if strength == 0.0 or anisotropy is None else {"Anisotropic": anisotropy}
    aspect = 1 - min(abs(strength), 0.99)
    turned = turns + (0.25 if strength > 0 else 0.0)
    return {"Anisotropic": ConstantValue((1 - aspect**2) / 0.9), "Anisotropic Rotation": ConstantValue(turned)}


def input_for_camera_rays(socket: SocketInGroups) -> int | None:
    """Returns which shader input of a Mix Shader, 0 or 1, camera rays see, if its factor depends on the kind of ray; else None.

    socket: the socket of the factor.
    """
    by, _ = source_of(socket)
    if by is None or by.node.type != "LIGHT_PATH":
        return None
    return int(by.output.name == "Is Camera Ray")


def principled_look(source: Source | None, warn: Callable[[str], None]) -> PrincipledLook | None:
    """Returns a shader expressed as a PrincipledLook; None if it is unknown or not a surface shader.

    warn: called with a sentence for each difference from Blender.
    """
    found = _look_of(source, warn)
    if found is not None:
        warn_of_surface(found, warn)
    return found


def _look_of(source: Source | None, warn: Callable[[str], None]) -> PrincipledLook | None:
    if source is None:
        return None
    made = _simple(source, warn)
    if made is not None:
        warn_of_shader(source, warn)
        return made
    if source.node.type == "MIX_SHADER":
        return _mix_shaders(source, warn)
    return _add_shaders(source, warn) if source.node.type == "ADD_SHADER" else None


def _simple(source: Source, warn: Callable[[str], None]) -> PrincipledLook | None:
    kind, at = source.node.type, source.input
    if kind == "BSDF_PRINCIPLED":
        return PrincipledLook(_transmitted_color(at) | _skin_input(getattr(source.node, "subsurface_method", "")), at)
    color = at("Color", "Base Color")
    if kind == "SUBSURFACE_SCATTERING":
        inside = {f"Subsurface {name}": at(name) for name in ("Radius", "Scale", "Anisotropy", "IOR")}
        inside |= _skin_input(getattr(source.node, "falloff", ""))
        return _matt({"Base Color": color, "Normal": at("Normal"), "Subsurface Weight": ConstantValue(1.0), **inside})
    if kind == "BSDF_HAIR_PRINCIPLED":
        names = ("Roughness", "Radial Roughness", "Offset", "IOR")
        if getattr(source.node, "model", "CHIANG") == "HUANG":
            names += ("Aspect Ratio", "Reflection", "Transmission", "Secondary Reflection")
        said = {f"Hair {name}": at(name) for name in names}
        return _matt({"Base Color": hair_color(source), "Hair": ConstantValue(1.0), **said})
    if kind in ("BSDF_DIFFUSE", "BSDF_TOON", "BSDF_HAIR"):
        if kind != "BSDF_DIFFUSE":
            warn(Sentence("cycles-shader-matte", "its {shader} is shown as matte", shader=source.node.bl_label or kind))
        rough = {"Diffuse Roughness": at("Roughness")} if kind == "BSDF_DIFFUSE" else {}
        return _matt({"Base Color": color, "Normal": at("Normal"), **rough})
    if kind in ("BSDF_GLOSSY", "BSDF_ANISOTROPIC", "BSDF_METALLIC"):
        if kind == "BSDF_METALLIC" and source.node.fresnel_type == "PHYSICAL_CONDUCTOR":
            color = _conductor_color(at("IOR"), at("Extinction"), color)
        said = {"Base Color": color, "Metallic": ConstantValue(1.0), "Roughness": at("Roughness"), "Normal": at("Normal")}
        return PrincipledLook(said | _principled_anisotropy(at("Anisotropy"), at("Rotation")))
    if kind in ("BSDF_GLASS", "BSDF_REFRACTION"):
        said = {"Base Color": color, "Transmission Weight": ConstantValue(1.0), "Roughness": at("Roughness"), "IOR": at("IOR")}
        return PrincipledLook(said | {"Normal": at("Normal")})
    if kind in ("BSDF_SHEEN", "BSDF_VELVET"):
        said = {"Sheen Weight": ConstantValue(1.0), "Sheen Tint": color, "Sheen Roughness": at("Roughness", "Sigma")}
        return _matt({"Base Color": BLACK, "Normal": at("Normal"), **said})
    if kind == "BSDF_TRANSLUCENT":
        return _matt(
            {"Base Color": BLACK, "Translucent Weight": ConstantValue(1.0), "Translucent Color": color, "Normal": at("Normal")}
        )
    if kind == "BSDF_TRANSPARENT":
        return _pane(color) if (constant_value(color) or BLACK.value) != WHITE.value else _Clear()
    if kind == "EMISSION":
        return _matt({"Base Color": BLACK, "Emission Color": color, "Emission Strength": at("Strength")})
    return None


def _skin_input(method: str) -> dict[str, Any]:
    """Returns the Principled BSDF input "Subsurface Skin": 1 if the subsurface radius is to be interpreted as for skin, else 0.

    method: Blender's subsurface method.
    """
    return {"Subsurface Skin": ConstantValue(float(method == "RANDOM_WALK_SKIN"))}


def _transmitted_color(socket: Callable[..., Any]) -> dict[str, Any]:
    """Returns the "Base Color" input of a shader that only transmits light: the square root of its colour; empty for others.

    Cycles applies the square root of the colour at each of two surfaces, glTF the full colour once.
    """
    weight, color = constant_value(socket("Transmission Weight", "Transmission")), socket("Base Color")
    is_clear = isinstance(weight, float) and weight >= 1 and color is not None
    return {"Base Color": SquareRoot(color)} if is_clear else {}


def _pane(color: Any) -> PrincipledLook:
    """Returns a smooth, coloured, transparent surface that does not refract, as a PrincipledLook."""
    said = {
        "Base Color": color,
        "Transmission Weight": ConstantValue(1.0),
        "Roughness": ConstantValue(0.0),
        "IOR": ConstantValue(1.0),
    }
    return PrincipledLook(said)


def _conductor_color(ior: Any, extinction: Any, color: Any) -> Any:
    """Returns a conductor's reflectance at normal incidence, or `color` if its ior and extinction are not constant."""
    n, k = constant_value(ior), constant_value(extinction)
    if not isinstance(n, list) or not isinstance(k, list):
        return color
    return ConstantValue([((a - 1) ** 2 + b * b) / ((a + 1) ** 2 + b * b) for a, b in zip(n, k, strict=True)])


def _matt(inputs: Mapping[str, Any]) -> PrincipledLook:
    return PrincipledLook({"Roughness": ConstantValue(1.0), "Specular IOR Level": ConstantValue(0.0), **inputs}, is_matt=True)


def _mix_shaders(source: Source, warn: Callable[[str], None]) -> PrincipledLook | None:
    first, second = (_look_of(source_of(source.input_at(i))[0], warn) for i in (1, 2))
    share = source.input_at(0)
    if (which := input_for_camera_rays(share)) is not None:
        warn(Sentence("cycles-light-path-mix", "of shaders mixed by Light Path, all rays see the one for the camera"))
        return (first, second)[which]
    if first is None or second is None:
        known = first or second
        if known is not None:
            warn(Sentence("cycles-mix-one-shader", "of its mixed shaders only one is shown"))
        return known
    by, _ = source_of(share)
    if by is not None and by.node.type in ("FRESNEL", "LAYER_WEIGHT") and constant_value(second.input("Metallic")) == 1.0:
        return _with_reflection(by, first, second, warn)
    plain = constant_value(share)
    if plain in (0.0, 1.0):
        return second if plain else first
    if by is not None and by.node.type in ("FRESNEL", "LAYER_WEIGHT", "CAMERA", "NEW_GEOMETRY"):
        warn(
            Sentence(
                "cycles-mix-half", "its shaders are mixed in equal parts, not by {node}", node=by.node.bl_label or by.node.type
            )
        )
        share = ConstantValue(SHARE)
    polished = _as_coated_diffuse(plain, first, second)
    return polished if polished is not None else _Mix(share, first, second, warn)


def _as_coated_diffuse(share: Any, first: PrincipledLook, second: PrincipledLook) -> PrincipledLook | None:
    """Converts a mix of a diffuse shader and a metal to the diffuse shader under a coat; returns None for any other mix.

    share: the constant weight of `second`. The coat's reflectance at normal incidence equals the metal's weight.
    """
    matt, metal, part = (first, second, share) if first.is_matt else (second, first, None if share is None else 1 - share)
    is_metal = constant_value(metal.input("Metallic")) == 1.0 and not metal.is_matt
    if not (isinstance(part, float) and 0 < part < MOST_POLISHED and matt.is_matt and is_metal) or _is_black(matt):
        return None
    root = math.sqrt(part)
    said = {
        "Roughness": metal.input("Roughness"),
        "IOR": ConstantValue((1 + root) / (1 - root)),
        "Specular IOR Level": ConstantValue(0.5),
    }
    return matt.with_inputs(said | {"Specular Tint": metal.input("Base Color")})


def _with_reflection(
    fresnel: Source, beneath: PrincipledLook, gloss: PrincipledLook, warn: Callable[[str], None]
) -> PrincipledLook:
    """Converts a mix of two shaders by Fresnel's law to one shader: `beneath` with a reflection as rough as the shader `gloss`.

    fresnel: the node that computes the factor.
    """
    ior = constant_value(fresnel.input("IOR")) if fresnel.node.type == "FRESNEL" else None
    if fresnel.node.type == "LAYER_WEIGHT":
        blend = constant_value(fresnel.input("Blend"))
        ior = 1 / max(1 - (SHARE if blend is None else blend), 1e-3)
        if fresnel.output.name == "Facing":
            warn(Sentence("cycles-reflection-fresnel", "its reflection follows Fresnel's law, not the facing angle"))
    roughness = gloss.input("Roughness")
    if beneath.is_matt:
        said = {"Roughness": roughness, "IOR": ConstantValue(ior or 1.45), "Specular IOR Level": ConstantValue(0.5)}
        return beneath.with_inputs(said | {"Specular Tint": gloss.input("Base Color")})
    return beneath.with_inputs({"Coat Weight": ConstantValue(1.0), "Coat Roughness": roughness})


def _add_shaders(source: Source, warn: Callable[[str], None]) -> PrincipledLook | None:
    """Returns the look of an Add Shader. Emission is added; of several surfaces, only one is used."""
    parts = [look for look in (_look_of(source_of(source.input_at(i))[0], warn) for i in (0, 1)) if look is not None]
    shining = [each for each in parts if _is_black(each) and constant_value(each.input("Emission Strength")) != 0.0]
    others = [each for each in parts if each not in shining]
    if shining and any(each.is_clear for each in others):
        warn(Sentence("cycles-transparency-half", "shaders added to its transparency hide half of the background"))
        return _Mix(ConstantValue(SHARE), others[0], shining[0], warn)
    if len(others) > 1:
        leaf = next((each for each in others if constant_value(each.input("Translucent Weight")) == 1.0), None)
        solid = next((each for each in others if each is not leaf), others[0])
        if leaf is None:
            warn(Sentence("cycles-add-one-shader", "of its added shaders only one is shown"))
        else:
            warn(Sentence("cycles-translucency-shared", "light reflected and transmitted by it is shared, not added"))
            solid = _Mix(ConstantValue(SHARE), solid, leaf, warn)
        others = [solid]
    if not others:
        return shining[0] if shining else None
    if not shining:
        return others[0]
    names = ("Emission Color", "Emission Strength")
    return others[0].with_inputs({name: shining[0].input(name) for name in names}, others[0].is_matt)


def _is_black(surface: PrincipledLook) -> bool:
    told = constant_value(surface.input("Base Color"))
    return isinstance(told, list) and max(told) <= 0 and constant_value(surface.input("Translucent Weight")) in (None, 0.0)


class _Mix(PrincipledLook):
    """A blend of two converted shaders (PrincipledLook). share: the weight of the second, 0 to 1."""

    def __init__(
        self, share: SocketInGroups | ConstantValue, first: PrincipledLook, second: PrincipledLook, warn: Callable[[str], None]
    ) -> None:
        super().__init__({}, None, first.is_matt and second.is_matt)
        self.is_clear = first.is_clear and second.is_clear
        self._share, self._first, self._second = share, first, second
        a, b = (constant_value(look.input("Metallic")) for look in (first, second))
        colors = [constant_value(look.input("Base Color")) for look in (first, second)]
        glass, rough = (
            [constant_value(look.input(name)) for look in (first, second)] for name in ("Transmission Weight", "Roughness")
        )
        if glass[0] != glass[1] and (glass[0] or glass[1]) and not (first.is_clear or second.is_clear):
            warn(Sentence("cycles-glass-mix-color", "glass and the shader mixed with it have the same, intermediate color"))
        if rough[0] != rough[1] and not (first.is_matt or second.is_matt or first.is_clear or second.is_clear):
            warn(Sentence("cycles-mix-roughness", "its two mixed roughnesses are replaced by their mean"))
        is_one_clear = first.is_clear or second.is_clear or _is_black(first) or _is_black(second)
        if a != b and (None in colors or colors[0] != colors[1]) and not is_one_clear:
            warn(Sentence("cycles-metal-mix-color", "metal and the shader mixed with it have the same, intermediate color"))

    def input(self, *names: str) -> Any:
        a, b = self._first.input(*names), self._second.input(*names)
        if a is None and b is None:
            return None
        if self._first.is_clear != self._second.is_clear and names[0] != "Alpha":
            return b if self._first.is_clear else a
        if names[0] in LINKED:
            return a if a is not None and (b is None or source_of(a)[0] is not None) else b
        if names[0] in OF_GLOSS and self._first.is_matt != self._second.is_matt and names[0] != "Specular IOR Level":
            return b if self._first.is_matt else a
        if names[0] == "Emission Color":
            if _is_dark(self._first):
                return b
            if _is_dark(self._second):
                return a
        if names[0] == "Translucent Color":  # without translucency, its colour has no effect
            none = [constant_value(each.input("Translucent Weight")) in (None, 0.0) for each in (self._first, self._second)]
            if none[0] != none[1]:
                return b if none[0] else a
        if names[0].startswith("Subsurface ") and names[0] != "Subsurface Weight":  # likewise
            none = [constant_value(each.input("Subsurface Weight")) in (None, 0.0) for each in (self._first, self._second)]
            if none[0] != none[1]:
                return b if none[0] else a
        if names[0] == "Base Color":  # for transmitted light, its weight is used
            through = [constant_value(each.input("Translucent Weight")) == 1.0 for each in (self._first, self._second)]
            if through[0] != through[1]:
                return b if through[0] else a
        default = DEFAULTS.get(names[0])
        a, b = (default if each is None else each for each in (a, b))
        return b if a is None else a if b is None else Blend(self._share, a, b)


def _is_dark(surface: PrincipledLook) -> bool:
    strength = surface.input("Emission Strength")
    return strength is None or constant_value(strength) == 0.0
