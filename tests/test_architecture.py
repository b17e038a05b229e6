"""Tests of import rules within the page and for single modules; pyproject.toml has the rules between packages."""

from __future__ import annotations

import re
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.helpers import ROOT

PACKAGES = ("renderer", "protocol", "telemetry", "worker", "service", "rayfarm")
PAGE = (
    "base",
    "mesh",
    "news",
    "shell",
    "film",
    "forms",
    "job",
    "shot",
    "scene",
    "compare",
    "views",
    "main.js",
)  # each may import those before it


@pytest.mark.long
def test_service_is_importable_without_numba() -> None:
    """The service can be imported without numba, which its image lacks."""
    program = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("numba", "llvmlite", "trimesh", "safetensors"):
            raise ModuleNotFoundError(f"{name} is not in the service's image")

sys.meta_path.insert(0, Missing())
import service.main
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_page_layers_import_downwards_only() -> None:
    folder = ROOT / "web" / "js"
    wrong = []
    for path in folder.rglob("*.js"):
        own = path.relative_to(folder).parts[0]
        for named in re.findall(r'^(?:import|\} from|export)\b.*"(\.[^"]+)"', path.read_text(), re.MULTILINE):
            other = (path.parent / named).resolve().relative_to(folder).parts[0]
            if PAGE.index(other) > PAGE.index(own):
                wrong.append(f"{path.relative_to(folder)} imports {named}")
    assert not wrong, f"of {PAGE} each folder imports from those before it: {wrong}"


# Parsing a thousand files takes five times as long as finding their imports by a regular expression.
TYPES_ONLY = re.compile(r"^if TYPE_CHECKING:\n(?:[ ]+.*\n|\n)+", re.MULTILINE)
FROM = re.compile(r"^[ ]*from ([\w.]+) import (?:\(([^)]*)\)|([^(\n]+))", re.MULTILINE)
IMPORT = re.compile(r"^[ ]*import ([\w.]+(?: as \w+)?(?:, [\w.]+(?: as \w+)?)*)", re.MULTILINE)
LAZY = re.compile(r"import_module\(\s*\"([\w.]+)\"")


def _imports(path: Path, modules: set[str]) -> set[str]:
    """Returns the modules that a file imports, also within functions, but without imports for type checkers only.

    modules: names of all modules of the project.
    """
    text = TYPES_ONLY.sub("", path.read_text())
    named = LAZY.findall(text)
    for names in IMPORT.findall(text):
        named += [name.split()[0] for name in names.split(", ")]
    for module, several, line in FROM.findall(text):
        inside = [f"{module}.{name.split()[0]}" for name in re.sub("#.*", "", several or line).split(",") if name.strip()]
        named += [name if name in modules else module for name in inside]
    return set(named) & modules


def test_no_import_cycles_between_modules() -> None:
    """No Python modules import each other in a cycle. Imports within functions and by `import_module` count too."""
    paths = {
        path.relative_to(ROOT).with_suffix("").parts: path for package in PACKAGES for path in (ROOT / package).rglob("*.py")
    }
    modules = {".".join(parts).removesuffix(".__init__"): path for parts, path in paths.items()}
    names = set(modules)
    TopologicalSorter({name: _imports(path, names) - {name} for name, path in modules.items()}).prepare()


def test_no_import_cycles_between_page_modules() -> None:
    """No modules of web/js import each other in a cycle. Dynamic imports count too, types in comments do not."""
    graph: dict[Path, set[Path]] = {}
    for path in (ROOT / "web" / "js").rglob("*.js"):
        code = re.sub(r"/\*.*?\*/|^\s*//.*?$", "", path.read_text(), flags=re.DOTALL | re.MULTILINE)
        named = re.findall(r"""(?:from|import)\s*\(?\s*["'](\.[^"']+)["']""", code)
        graph[path] = {(path.parent / name).resolve() for name in named}
    TopologicalSorter(graph).prepare()


def test_paths_in_the_additions_table_exist() -> None:
    """All paths in the table "To add X, touch Y" of docs/architecture.md exist.

    A file name without a folder is looked up in the folder of the first file in its row.
    """
    table = (ROOT / "docs" / "architecture.md").read_text().split("## To add X, touch Y", 1)[1].split("\n## ", 1)[0]
    for row in [line for line in table.splitlines() if line.startswith("| ")][1:]:
        folder = ROOT
        for word in re.findall(r"`([\w./-]+)`", row.split("|", 2)[2]):
            if "/" not in word and Path(word).suffix not in (".py", ".js", ".md", ".json", ".yaml", ".jpg"):
                continue  # an identifier, not a path
            pattern = word.replace("NAME", "*").strip("/")
            near = [folder.relative_to(ROOT).as_posix() + "/" + pattern, pattern]
            found = [path for each in near for path in ROOT.glob(each)]
            assert found, f"there is no {word}, which the row says to touch: {row}"
            folder = found[0].parent
