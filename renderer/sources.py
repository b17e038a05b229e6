"""A hash of the meaning of Python sources.

Comments, docstrings, whitespace, line numbers and user-facing texts (calls of `SettingTexts` and `Sentence`) do not affect it. So
machine code and compiled scenes remain valid after an edit that changes no behaviour, and hosts with different Python versions
agree.
"""

from __future__ import annotations

import ast
import contextlib
import hashlib
import os
from collections.abc import Callable, Iterable
from pathlib import Path

from renderer.cache_folders import make_private

__all__ = ["ARRAYS", "MACHINE_CODE", "cached_meaning", "files_of", "meaning"]

ROOT = Path(__file__).parent

# The sources of kernels (folders completely). tests/renderer/test_sources.py checks that the list is complete.
MACHINE_CODE = (
    "jit.py",
    "target.py",
    "cpu.py",
    "inline_templates.py",
    "prune_absent_features.py",
    "fused_multiply_add.py",
    "lane_types.py",
    "linking.py",
    "machine_code.py",
    "reference.py",
    "settings.py",
    "view.py",
    "lens_distortion.py",
    "setting_declaration.py",
    "errors.py",
    "cryptomatte.py",
    "deep.py",
    "film.py",
    "luminance.py",
    "threads.py",
    "trigonometry.py",
    "arrays",
    "bvh",
    "kernel",
    "wide",
    "scene/readers/obj_lines.py",
)
# Further sources that decide which arrays and settings a kernel reads.
ARRAYS = (
    "render.py",
    "preparation_kernels.py",
    "work.py",
    "formats.py",
    "frames.py",
    "presets.py",
    "preview_mesh.py",
    "variation.py",
    "zips.py",
    "blender",
    "scene",
    "guiding",
    "image/__init__.py",
    "image/channels.py",
    "image/kinds.py",
    "image/ocio.py",
    "image/openimageio.py",
    "image/read.py",
    "image/rgbe9995.py",
    "image/unread.py",
    "image/tonemap.py",
)

TEXTS = ("SettingTexts", "Sentence")  # the classes of user-facing texts


def files_of(parts: Iterable[str], root: Path = ROOT) -> list[Path]:
    """Returns the source files in these files and folders, including the kernels' tables, in an order independent of the host."""
    found: set[Path] = set()
    for part in parts:
        path = root / part
        found |= {*path.rglob("*.py"), *path.rglob("*.npy")} if path.is_dir() else {path}
    return sorted(found)


def meaning(files: Iterable[Path], root: Path = ROOT) -> str:
    """Returns a SHA-256 hash of the files' names and of the meaning of their content."""
    total = hashlib.sha256()
    for path in files:
        total.update(path.relative_to(root).as_posix().encode() + b"\0")
        if path.suffix == ".py":
            total.update("\n".join(_as_text(ast.parse(path.read_bytes()))).encode())
        else:
            total.update(path.read_bytes())
        total.update(b"\0")
    return total.hexdigest()


def cached_meaning(files: Iterable[Path], kept: Path, root: Path = ROOT) -> str:
    """Returns the hash `meaning` of the files, cached in the file `kept` with a hash of the files' bytes and of this module's.

    Computing `meaning` takes a good part of a second.
    """
    files = list(files)
    raw = hashlib.sha256(Path(__file__).read_bytes())  # the cached hash depends on this module too
    for path in files:
        raw.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    with contextlib.suppress(OSError, ValueError):
        known, found = kept.read_text().split()
        if known == raw.hexdigest() and len(found) == 64:
            return found
    found = meaning(files, root)
    with contextlib.suppress(OSError):  # if it cannot be stored, it is computed again
        make_private(kept.parent)
        beside = kept.with_name(f"{kept.name}.{os.getpid()}")
        beside.write_text(f"{raw.hexdigest()} {found}")
        beside.replace(kept)
    return found


def _as_text(tree: ast.AST) -> list[str]:
    """Returns a syntax tree as text: only fields that are set, so that new fields of later Python versions have no effect."""
    words: list[str] = []
    _write_node(tree, words.append)
    return words


def _write_node(node: object, say: Callable[[str], None]) -> None:
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in TEXTS:
        say(node.func.id)
    elif isinstance(node, ast.AST):
        say(type(node).__name__)
        for name in node._fields:
            value = getattr(node, name, None)
            if isinstance(value, list):
                value = [each for each in value if not _is_text(each)]
            if value is not None and value != [] and name not in ("ctx", "kind"):
                say(name)
                _write_node(value, say)
    elif isinstance(node, list):
        say("[")
        for each in node:
            _write_node(each, say)
        say("]")
    else:
        say(repr(node))


def _is_text(statement: object) -> bool:
    """Returns True if a statement is only a string: the documentation of its scope or of the attribute before it."""
    return (
        isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant) and isinstance(statement.value.value, str)
    )
