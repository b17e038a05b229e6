"""Tests of the converter's imports from the add-on, whose names only Blender would look up."""

from __future__ import annotations

import ast
import re

from renderer.blender.inside.principled_materials import MODULES
from tests.helpers import ROOT

INSIDE, ADDON = ROOT / "renderer/blender/inside", ROOT / "blender/rayfarm_addon/scene"
USED = re.compile(r"(?:modules|known)\.([a-z_]+)\.([A-Za-z_]+)|\bgetattr\(known, \"([a-z_]+)\"")


def test_the_converter_uses_what_the_add_on_has() -> None:
    names = {module: _names(module) for module in MODULES}
    found = [use.groups() for path in INSIDE.glob("*.py") for use in USED.finditer(path.read_text())]
    assert len(found) > 20
    assert not [use for use in found if not (use[2] in MODULES if use[2] else use[1] in names.get(use[0], ()))]


def _names(module: str) -> set[str]:
    """Returns the names that a module of the add-on defines or imports."""
    found: set[str] = set()
    for node in ast.parse((ADDON / f"{module}.py").read_text()).body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            found.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign | ast.ImportFrom):
            found |= {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}
            found |= {each.name for each in getattr(node, "names", [])}
    return found
