"""Writes documentation from declarations: docs/scene-schema.json, and the table in docs/scene-format-settings.md.

    python docs/settings_table.py

tests/renderer/scene/test_scene_format.py checks that both are up to date.
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Mapping
from dataclasses import MISSING
from itertools import pairwise
from pathlib import Path

from renderer.scene import description, material
from renderer.scene.readers.yaml.schema import SCENE_SETTINGS, filled_in, template_text
from renderer.setting_declaration import DeclaredSetting
from renderer.setting_docs import values

ROOT = Path(__file__).resolve().parents[1]
SCHEMA = ROOT / "docs" / "scene-schema.json"
GUIDE = ROOT / "docs" / "scene-format-settings.md"


def schema_text(settings: Mapping[str, DeclaredSetting] = SCENE_SETTINGS) -> str:
    """Returns the text of the complete schema: that of schema.json, with one line for each declared property."""
    text = template_text()
    materials = attribute_docs(Path(str(material.__file__)), "Material")
    lights = attribute_docs(Path(str(description.__file__)), "Light")
    whole = filled_in(json.loads(text), settings, materials, lights)
    defs = whole["$defs"]
    text = _filled(text, '    "settings": {\n', whole["properties"]["settings"]["properties"])
    text = _filled(text, '    "material": {\n      "type"', defs["material"]["properties"])
    text = _replaced(text, '    "environment": {\n', "preset", whole["properties"]["environment"]["properties"]["preset"])
    text = _replaced(text, '    "texture_layer": {\n', "blend", defs["texture_layer"]["properties"]["blend"])
    for kind in ("camera", "light"):
        for name, part in defs[kind]["properties"].items():
            text = _replaced(text, f'    "{kind}": {{\n', name, part)
    return text


def attribute_docs(path: Path, name: str) -> dict[str, str]:
    """Returns the strings below the attributes of a class, by attribute name, each joined to one line.

    path: the Python file. name: the class.
    """
    body = next(n.body for n in ast.parse(path.read_text()).body if isinstance(n, ast.ClassDef) and n.name == name)
    found = {}
    for field, words in pairwise(body):
        match field, words:
            case ast.AnnAssign(target=ast.Name(id=attribute)), ast.Expr(value=ast.Constant(value=str(said))):
                found[attribute] = " ".join(said.split())
    return found


def guide_text(text: str, settings: Mapping[str, DeclaredSetting] = SCENE_SETTINGS) -> str:
    """Returns the guide's text with the settings table inserted between its marks."""
    rows = ["| field | default | |", "|---|---|---|", *(_row(each) for each in settings.values())]
    start, _, end = _split_at(text, "", "<!-- settings -->\n", "<!-- /settings -->\n")
    return start + "\n".join(rows) + "\n" + end


def _filled(text: str, after: str, properties: Mapping[str, object]) -> str:
    """Returns the text with `properties` inserted into the first empty JSON object that follows `after`."""
    start, end = text[: text.index(after)], text[text.index(after) :]
    lines = [f"        {json.dumps(name)}: {_line(part)}" for name, part in properties.items()]
    return start + end.replace('"properties": {}', '"properties": {\n' + ",\n".join(lines) + "\n      }", 1)


def _replaced(text: str, after: str, name: str, part: object) -> str:
    """Returns the text with one property of a JSON definition replaced, or added if missing.

    after: text with which the definition begins. name, part: the property's name and its new value.
    """
    start = text.index(after)
    end = text.index("\n    }", start)
    section = text[start:end]
    own = rf"^( +{json.dumps(name)}: )\{{.*?\}}(,?)$"
    section, count = re.subn(own, lambda found: f"{found[1]}{_line(part)}{found[2]}", section, count=1, flags=re.M)
    if not count:
        whole = section.removesuffix("\n      }")
        section = f"{whole},\n        {json.dumps(name)}: {_line(part)}\n      }}"
    return text[:start] + section + text[end:]


def _line(part: object) -> str:
    return json.dumps(part, ensure_ascii=False)


def _split_at(text: str, after: str, begin: str, end: str) -> tuple[str, str, str]:
    """Returns three parts of the text: up to the first `begin` that follows `after`, then up to `end`, then the rest."""
    first = text.index(begin, text.index(after)) + len(begin)
    last = text.index(end, first)
    return text[:first], text[first:last], text[last:]


def _row(each: DeclaredSetting) -> str:
    default = "" if each.default in (MISSING, None, "") else f"`{_short(each.default)}`"
    choices = each.setting.choices
    said = [each.shown.help]
    if choices is not None:
        said += [f"`{name}`: {shown.help}" for name, shown in choices.shown.items() if name]
    else:
        accepted = values(each)
        said += [f"Takes {accepted}."] if accepted else []
        said += [f"Of {', '.join(f'`{name}`' for name in each.shown.integrators)}."] if each.shown.integrators else []
    return f"| `{each.name}` | {default} | {' '.join(said)} |"


def _short(value: object) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_short, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    SCHEMA.write_text(schema_text())
    GUIDE.write_text(guide_text(GUIDE.read_text()))
