"""The JSON schema of scene files: schema.json, completed by the declarations of other modules.

These declare the settings and the lens (renderer/settings.py, renderer/view.py), material parameters and kinds
(renderer/scene/material.py), lights (renderer/scene/description.py), blend operations (renderer/kernel/material/blend.py) and
light presets (renderer/presets.py).
`python docs/settings_table.py` writes the complete schema, with descriptions, to docs/scene-schema.json.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from importlib.resources import files
from types import MappingProxyType
from typing import Any

from renderer.kernel.material.blend import OPERATIONS
from renderer.presets import PRESETS
from renderer.scene.description import LIGHT_PARAMETERS
from renderer.scene.material import PARAMETERS
from renderer.scene.parameters import Parameter
from renderer.scene.readers.metals import METALS
from renderer.scene.readers.yaml.lights import LIGHT_TYPES
from renderer.scene.readers.yaml.materials import SPELLINGS
from renderer.setting_declaration import MAX_NAME, NAME_PATTERN, DeclaredSetting
from renderer.settings import OPTIONAL, SETTINGS, VIEW
from renderer.work import WORK

__all__ = ["SCENE_SETTINGS", "filled_in", "material_properties", "schema", "template_text"]

Json = dict[str, Any]

# Settings of scene files, in the order of the documentation.
SCENE_SETTINGS: Mapping[str, DeclaredSetting] = {
    **{name: SETTINGS[name] for name in ("width", "height")},
    "spp": WORK["spp"],
    **{name: SETTINGS[name] for name in OPTIONAL},
}
# Camera fields with the renderer's own names and units.
_LENS = ("projection", "fov", "height", "aperture", "near", "shift_x", "shift_y")
# Schemas of alternative spellings of material parameters.
_SPELLINGS: dict[str, Json] = {
    "abbe": {"description": "Abbe number, instead of the dispersion.", "type": "number", "minimum": 1},
    "metal": {"description": "A measured one, instead of eta and k.", "enum": sorted(METALS)},
}


def filled_in(
    document: Json,
    settings: Mapping[str, DeclaredSetting] = SCENE_SETTINGS,
    materials: Mapping[str, str] = MappingProxyType({}),
    lights: Mapping[str, str] = MappingProxyType({}),
) -> Json:
    """Returns the schema document with the parts that other modules declare inserted.

    settings: the settings that a file may contain; materials, lights: descriptions of parameters of materials and lights, by
    name.
    """
    defs = document["$defs"]
    document["properties"]["settings"]["properties"] = {name: each.json_schema() for name, each in settings.items()}
    document["properties"]["environment"]["properties"]["preset"]["enum"] = list(PRESETS)
    defs["camera"]["properties"] |= {name: VIEW[name].json_schema() for name in _LENS}
    defs["material"]["properties"] = material_properties(materials)
    defs["light"]["properties"]["type"] = {"enum": list(LIGHT_TYPES)}
    defs["light"]["properties"] |= {p.in_file: _described(p, lights) for p in LIGHT_PARAMETERS}
    defs["texture_layer"]["properties"]["blend"] = {"enum": list(OPERATIONS)}
    return document


def schema() -> Json:
    """Returns the schema that scene files are checked against, without descriptions of material and light parameters."""
    return filled_in(json.loads(template_text()))


def template_text() -> str:
    """Returns the text of schema.json, the part of the schema that no other module declares."""
    return files("renderer.scene").joinpath("schema.json").read_text()


def material_properties(descriptions: Mapping[str, str] = MappingProxyType({})) -> Json:
    """Returns the schemas of a material's fields, by their names in scene files. descriptions: by parameter name."""
    found: Json = {}
    for parameter in PARAMETERS:
        for other, same in SPELLINGS.items():
            if same == parameter.in_file:
                found[other] = _SPELLINGS[other]
        found[parameter.in_file] = _described(parameter, descriptions)
    return found


def _described(parameter: Parameter, descriptions: Mapping[str, str]) -> Json:
    words = {"description": descriptions[parameter.name]} if parameter.name in descriptions else {}
    return {**words, **_json_schema(parameter)}


def _json_schema(p: Parameter) -> Json:
    if p.form == "texture":
        return {"$ref": "#/$defs/texture_name"}
    if p.form == "name":
        return {"type": "string", "maxLength": MAX_NAME, "pattern": NAME_PATTERN}
    if p.form == "flag":
        return {"type": "boolean"}
    if p.form == "choice":
        return {"enum": list(p.choices)}
    if p.form == "radiance":
        return {"$ref": "#/$defs/radiance"}
    if p.form == "degrees":
        return {"type": "number"}
    if p.form == "number":
        return {"$ref": "#/$defs/unit"} if (p.low, p.high) == (0.0, 1.0) else {"type": "number", **_range(p)}
    if p.form == "color" and p.high == 1.0:
        return {"$ref": "#/$defs/color"}
    count = 2 if p.form == "pair" else 3
    several = {"items": {"type": "number", **_range(p)}, "minItems": count, "maxItems": count, **_range(p)}
    if p.form == "color":
        return {"type": ["array", "number", "string"], **several, "pattern": "^#[0-9a-fA-F]{6}$"}
    return {"type": ["array", "number"], **several}


def _range(p: Parameter) -> Json:
    lowest = {"exclusiveMinimum" if p.above else "minimum": _int_if_integral(p.low)} if math.isfinite(p.low) else {}
    return {**lowest, **({"maximum": _int_if_integral(p.high)} if math.isfinite(p.high) else {})}


def _int_if_integral(value: float) -> float:
    return int(value) if value == int(value) else value
