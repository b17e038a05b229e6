"""The properties of a glTF file that can be animated here: the supported pointers of KHR_animation_pointer.

Source: glTF 2.0 Asset Object Model, and the README of each extension. Pointers to material properties are derived from the
parameter table.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

from renderer.scene.material import PARAMETERS
from renderer.scene.parameters import Parameter
from renderer.scene.readers.gltf import extensions
from renderer.scene.readers.replaced_values import Path

__all__ = ["IDLE", "Kind", "find", "kind_of", "template"]

Kind = Literal["number", "pair", "triple", "quadruple", "rotation", "list", "flag"]

_EACH = "{}"  # placeholder of an array index

_LIGHT = "/extensions/KHR_lights_punctual/lights/{}"
_MATERIAL = "/materials/{}"
_PBR = f"{_MATERIAL}/pbrMetallicRoughness"
_GLOSSY = f"{_MATERIAL}/extensions/KHR_materials_pbrSpecularGlossiness"

_KINDS: dict[str, Kind] = {
    "/nodes/{}/translation": "triple",
    "/nodes/{}/rotation": "rotation",
    "/nodes/{}/scale": "triple",
    "/nodes/{}/weights": "list",
    "/nodes/{}/weights/{}": "number",
    "/nodes/{}/extensions/KHR_node_visibility/visible": "flag",
    "/meshes/{}/weights": "list",
    "/meshes/{}/weights/{}": "number",
    "/cameras/{}/orthographic/ymag": "number",
    "/cameras/{}/perspective/yfov": "number",
    "/cameras/{}/orthographic/znear": "number",
    "/cameras/{}/perspective/znear": "number",
    f"{_LIGHT}/color": "triple",
    f"{_LIGHT}/intensity": "number",
    f"{_LIGHT}/spot/innerConeAngle": "number",
    f"{_LIGHT}/spot/outerConeAngle": "number",
    f"{_PBR}/baseColorFactor": "quadruple",
    f"{_MATERIAL}/emissiveFactor": "triple",
    f"{_MATERIAL}/extensions/KHR_materials_emissive_strength/emissiveStrength": "number",
    f"{_MATERIAL}/extensions/KHR_materials_ior/ior": "number",
    f"{_MATERIAL}/extensions/KHR_materials_volume/attenuationDistance": "number",
    f"{_MATERIAL}/extensions/KHR_materials_volume/thicknessFactor": "number",
    f"{_MATERIAL}/extensions/KHR_materials_iridescence/iridescenceThicknessMinimum": "number",
    f"{_MATERIAL}/extensions/KHR_materials_iridescence/iridescenceThicknessMaximum": "number",
    f"{_GLOSSY}/diffuseFactor": "quadruple",
    f"{_GLOSSY}/specularFactor": "triple",
    f"{_GLOSSY}/glossinessFactor": "number",
}
_TEXTURES = [f"{_MATERIAL}/emissiveTexture", f"{_GLOSSY}/diffuseTexture", f"{_GLOSSY}/specularGlossinessTexture"]
_KIND_OF_FORM: dict[str, Kind] = {
    "number": "number",
    "degrees": "number",
    "color": "triple",
    "radiance": "triple",
    "triple": "triple",
}
_TEXTURE_TRANSFORM_KINDS: dict[str, Kind] = {"offset": "pair", "rotation": "number", "scale": "pair"}


def _pointer_of(parameter: Parameter) -> str:
    steps = (parameter.gltf or "").split(".")
    return "/".join([_MATERIAL, *(f"extensions/{s}" if s in extensions.NAMES else s for s in steps)])


for _each in PARAMETERS:
    if _each.gltf and _each.form == "texture":
        _TEXTURES.append(_pointer_of(_each))
    elif _each.gltf and _each.form in _KIND_OF_FORM:
        _KINDS[_pointer_of(_each)] = _KIND_OF_FORM[_each.form]
for _texture in _TEXTURES:
    _KINDS |= {f"{_texture}/extensions/KHR_texture_transform/{key}": kind for key, kind in _TEXTURE_TRANSFORM_KINDS.items()}

# Animated properties without effect on the image: hints for rasterisers, and interactivity.
_OCCLUSION = f"{_MATERIAL}/occlusionTexture"
IDLE = {
    *(f"/cameras/{{}}/orthographic/{key}" for key in ("xmag", "zfar")),
    *(f"/cameras/{{}}/perspective/{key}" for key in ("aspectRatio", "zfar")),
    f"{_LIGHT}/range",
    f"{_OCCLUSION}/strength",
    *(f"{_OCCLUSION}/extensions/KHR_texture_transform/{key}" for key in _TEXTURE_TRANSFORM_KINDS),
    "/nodes/{}/extensions/KHR_node_selectability/selectable",
    "/nodes/{}/extensions/KHR_node_hoverability/hoverable",
}


def kind_of(pointer: str) -> Kind | None:
    """Returns the kind of value under a pointer; None if it cannot be animated here."""
    return _KINDS.get(template(pointer))


def template(pointer: str) -> str:
    """Returns the pointer with {} in place of each array index."""
    return "/".join(_EACH if part.isdigit() else part for part in pointer.split("/"))


def find(root: Any, pointer: str) -> Path | None:
    """Returns the path, as keys and indices, that a JSON pointer denotes; None if no such path exists in the file.

    The value at the path may be missing, and so may the object that contains it if that object is an extension.
    """
    path: list[str | int] = []
    at: Any = root
    for part in pointer.split("/")[1:]:
        if part.isdigit():
            is_there = isinstance(at, list) and len(part) < 10 and int(part) < len(at)
            if not is_there and path[-1:] != ["weights"]:
                return None
            path.append(int(part))
            at = at[int(part)] if is_there else None
            continue
        if not isinstance(at, dict | None) or (at is None and not _may_be_missing(path)):
            return None
        path.append(part)
        at = None if at is None else at.get(part)
    return tuple(path)


def _may_be_missing(path: Sequence[str | int]) -> bool:
    last = path[-1]
    return last in ("extensions", "pbrMetallicRoughness", "spot") or (isinstance(last, str) and last.startswith("KHR_"))
