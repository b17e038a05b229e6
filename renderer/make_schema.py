"""Writes the parts of the scene file's schema that follow from tables: `python -m renderer.make_schema`.

renderer/scene/schema.json is one file for the reader, for editors and for people. What is declared elsewhere is written into
it from there, and the rest of it is edited by hand; tests/renderer/scene/test_schema.py holds that both agree.
"""

from __future__ import annotations

import ast
import json
import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

from renderer.scene import material
from renderer.scene.material import PARAMETERS
from renderer.scene.parameters import Parameter
from renderer.scene.readers.metals import METALS
from renderer.scene.readers.yaml.materials import SPELLINGS

__all__ = ["SCHEMA", "attribute_docs", "generated", "main"]

SCHEMA = Path(__file__).parent / "scene" / "schema.json"
_LINE = 150

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


def material_section() -> Json:
    """What may be said of a material."""
    docs = attribute_docs(Path(str(material.__file__)), "Material")
    properties: Json = {}
    for parameter in PARAMETERS:
        words = {"description": docs[parameter.name]} if parameter.name in docs else {}
        for other, same in SPELLINGS.items():
            if same == parameter.in_file:
                properties[other] = _SPELLINGS[other]
        properties[parameter.in_file] = {**words, **_form(parameter)}
    return {"type": "object", "additionalProperties": False, "properties": properties}


# Where each stands in the schema.
_SECTIONS: dict[tuple[str, ...], Callable[[], Json]] = {("$defs", "material"): material_section}


def generated(schema: Json) -> Json:
    """A schema with the sections in it that are written from tables."""
    made: Json = json.loads(json.dumps(schema))
    for (*way, last), section in _SECTIONS.items():
        place = made
        for step in way:
            place = place[step]
        place[last] = section()
    return made


def text(value: Any, indent: int = 0) -> str:
    """JSON in which what fits on a line stands on one."""
    line = json.dumps(value, ensure_ascii=False)
    if indent + len(line) <= _LINE or not isinstance(value, dict | list) or not value:
        return line
    pad = " " * (indent + 2)
    if isinstance(value, dict):
        parts = [f"{pad}{json.dumps(k)}: {text(v, indent + 2)}" for k, v in value.items()]
    else:
        parts = [f"{pad}{text(v, indent + 2)}" for v in value]
    opened, closed = "{}" if isinstance(value, dict) else "[]"
    return opened + "\n" + ",\n".join(parts) + "\n" + " " * indent + closed


def main() -> None:
    """Bring the file up to date."""
    SCHEMA.write_text(text(generated(json.loads(SCHEMA.read_text()))) + "\n")


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
    main()
