"""Writes what is published of the settings' declarations: their part of renderer/scene/schema.json and of docs/scene-format.md.

    python docs/settings_table.py

tests/renderer/scene/test_scene_format.py holds that this was done.
"""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Mapping
from dataclasses import MISSING
from pathlib import Path

from renderer.scene.readers.yaml.schema import SCENE_SETTINGS, filled_in
from renderer.setting_declaration import Declared
from renderer.setting_docs import values

ROOT = Path(__file__).resolve().parents[1]
SCHEMA = ROOT / "renderer" / "scene" / "schema.json"
GUIDE = ROOT / "docs" / "scene-format.md"


def schema_text(text: str, settings: Mapping[str, Declared] = SCENE_SETTINGS) -> str:
    """The schema file with what the declarations say in its place, a line each; all else as it is."""
    whole = filled_in(json.loads(text), settings)
    lines = [f"        {json.dumps(name)}: {_line(part)}" for name, part in _settings(whole).items()]
    start, _, end = _between(text, '"settings": {', '"properties": {\n', "\n      }\n")
    text = start + ",\n".join(lines) + end
    start, camera, end = _between(text, '    "camera": {\n', "", "\n    },\n")
    for name, part in whole["$defs"]["camera"]["properties"].items():
        own = rf"^(        {json.dumps(name)}: )\{{.*\}}(,?)$"
        camera = re.sub(own, functools.partial(_replaced, _line(part)), camera, flags=re.M)
    return start + camera + end


def guide_text(text: str, settings: Mapping[str, Declared] = SCENE_SETTINGS) -> str:
    """The guide with the table of settings between its marks."""
    rows = ["| field | default | takes | |", "|---|---|---|---|", *(_row(each) for each in settings.values())]
    start, _, end = _between(text, "", "<!-- settings -->\n", "<!-- /settings -->\n")
    return start + "\n".join(rows) + "\n" + end


def _replaced(line: str, found: re.Match[str]) -> str:
    return f"{found[1]}{line}{found[2]}"


def _settings(schema: dict[str, dict[str, dict[str, dict[str, object]]]]) -> dict[str, dict[str, object]]:
    return schema["properties"]["settings"]["properties"]


def _line(part: object) -> str:
    return json.dumps(part, ensure_ascii=False)


def _between(text: str, after: str, begin: str, end: str) -> tuple[str, str, str]:
    """Text up to the first `begin` after `after`, what follows up to `end`, and the rest from `end` on."""
    first = text.index(begin, text.index(after)) + len(begin)
    last = text.index(end, first)
    return text[:first], text[first:last], text[last:]


def _row(each: Declared) -> str:
    default = "" if each.default in (MISSING, None, "") else f"`{_short(each.default)}`"
    choices = each.setting.choices
    said = [each.shown.help]
    if choices is not None:
        said += [f"`{name}`: {shown.help}" for name, shown in choices.shown.items() if name]
    elif each.shown.integrators:
        said.append(f"Of {', '.join(f'`{name}`' for name in each.shown.integrators)}.")
    return f"| `{each.name}` | {default} | {values(each)} | {' '.join(said)} |"


def _short(value: object) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_short, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    SCHEMA.write_text(schema_text(SCHEMA.read_text()))
    GUIDE.write_text(guide_text(GUIDE.read_text()))
