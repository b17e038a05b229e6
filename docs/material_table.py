"""Writes what is published of a material's table (renderer/scene/material.py): its part of renderer/scene/schema.json.

    python docs/material_table.py

tests/renderer/scene/test_material_table.py holds that this was done.
"""

from __future__ import annotations

import ast
import json
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

from renderer.scene import material
from renderer.scene.material import PARAMETERS
from renderer.scene.parameters import Parameter
from renderer.scene.readers.metals import METALS
from renderer.scene.readers.yaml.materials import SPELLINGS

SCHEMA = Path(str(material.__file__)).with_name("schema.json")

Json = dict[str, Any]

_SPELLINGS: dict[str, Json] = {
    "abbe": {"description": "Abbe number, instead of the dispersion.", "type": "number", "minimum": 1},
    "metal": {"description": "A measured one, instead of eta and k.", "enum": sorted(METALS)},
}


def attribute_docs(path: Path, name: str) -> dict[str, str]:
    """The string beneath each attribute of a class, its lines joined: words for people, which no running code reads."""
    body = next(n.body for n in ast.parse(path.read_text()).body if isinstance(n, ast.ClassDef) and n.name == name)
    found = {}
    for field, words in pairwise(body):
        match field, words:
            case ast.AnnAssign(target=ast.Name(id=attribute)), ast.Expr(value=ast.Constant(value=str(said))):
                found[attribute] = " ".join(said.split())
    return found


def properties() -> Json:
    """What may be said of a material."""
    docs = attribute_docs(Path(str(material.__file__)), "Material")
    found: Json = {}
    for parameter in PARAMETERS:
        words = {"description": docs[parameter.name]} if parameter.name in docs else {}
        for other, same in SPELLINGS.items():
            if same == parameter.in_file:
                found[other] = _SPELLINGS[other]
        found[parameter.in_file] = {**words, **_form(parameter)}
    return found


def schema_text(text: str) -> str:
    """The schema file with what the table says in its place, a line each; all else as it is."""
    begin, end = '    "material": {\n', "\n      }\n    },\n"
    begin += text.split(begin, 1)[1].split('"properties": {\n', 1)[0] + '"properties": {\n'
    before, _, rest = text.partition(begin)
    lines = [f"        {json.dumps(name)}: {json.dumps(part, ensure_ascii=False)}" for name, part in properties().items()]
    return before + begin + ",\n".join(lines) + end + rest.split(end, 1)[1]


def _form(p: Parameter) -> Json:
    if p.form == "texture":
        return {"$ref": "#/$defs/texture_name"}
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
    lowest = {"exclusiveMinimum" if p.above else "minimum": _plain(p.low)} if math.isfinite(p.low) else {}
    return {**lowest, **({"maximum": _plain(p.high)} if math.isfinite(p.high) else {})}


def _plain(value: float) -> float:
    return int(value) if value == int(value) else value


if __name__ == "__main__":
    SCHEMA.write_text(schema_text(SCHEMA.read_text()))
