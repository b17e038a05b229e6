"""Tests that the add-on's modules have the names by which the conversion that runs inside Blender imports them.

The conversion imports the modules by strings, which type checkers do not check.
"""

from __future__ import annotations

import ast
import json
import subprocess
import sys

from tests.helpers import ROOT

INSIDE = ROOT / "renderer" / "blender" / "inside"
ADDON = ROOT / "blender" / "rayfarm_addon"
HOLDERS = ("modules", "_modules")  # variables and attributes that hold all modules
# Variables and attributes that hold one module, by file.
MODULES = {
    "settings.py": {"addon_module": "cycles"},
    "lights.py": {"_known": "lights"},
    "world.py": {"skies": "skies", "subsurface": "subsurface"},
}

PROGRAM = """
import json, sys
from functools import reduce
from pathlib import Path
from renderer.blender.inside.principled_materials import modules_of
modules = modules_of(Path(sys.argv[1]))
missing = object()
print(json.dumps([name for name in sys.argv[2:]
    if reduce(lambda at, part: getattr(at, part, missing), name.split("."), modules) is missing]))
"""


def last_name(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def holds_modules(node: ast.expr) -> bool:
    if isinstance(node, ast.Call):
        return last_name(node.func) == "modules_of"
    return last_name(node) in HOLDERS and ast.unparse(node) != "sys.modules"


def used_names() -> set[str]:
    """Returns the add-on names that the conversion uses: `module` for each module, and `module.name` for each name in it."""
    found: set[str] = set()
    for path in INSIDE.glob("*.py"):
        of_file = MODULES.get(path.name, {})
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Attribute):
                holder = node.value
                if holds_modules(holder):
                    found.add(node.attr)
                elif isinstance(holder, ast.Attribute) and holds_modules(holder.value):
                    found.add(f"{holder.attr}.{node.attr}")
                elif last_name(holder) in of_file and ast.unparse(holder) in (last_name(holder), f"self.{last_name(holder)}"):
                    found.add(f"{of_file[last_name(holder)]}.{node.attr}")
            elif isinstance(node, ast.Call) and last_name(node.func) == "getattr" and holds_modules(node.args[0]):
                found.add(str(ast.literal_eval(node.args[1])))
    return found


def test_used_add_on_names_exist() -> None:
    names = sorted(used_names())
    assert {"cycles.depths_of", "lights.bounce_limit", "shader_mix.principled_look", "skies.photographed", "meshes.hair"} <= set(
        names
    )
    command = [sys.executable, "-c", PROGRAM, str(ADDON), *names]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    assert json.loads(done.stdout) == []
