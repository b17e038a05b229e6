"""Tests of the source digest that identifies a worker's kind and the kernel cache: it covers all compiled code, nothing else."""

from __future__ import annotations

import ast
import functools
import os
import subprocess
import sys
from pathlib import Path

import pytest

from renderer import jit, sources
from renderer.sources import ARRAYS, MACHINE_CODE, ROOT, cached_meaning, files_of, meaning

DECORATORS = ("entry", "builder", "device", "template", "subroutine")
# Modules that compute the digest, locate files, confine processes, or hold error and warning sentences.
EXEMPT = {
    ROOT / "sources.py",
    ROOT / "sentences.py",
    ROOT / "library_messages.py",
    ROOT / "cache_folders.py",
    *(ROOT / "confine").glob("*.py"),
}


def changed(tmp_path: Path, before: str, after: str) -> bool:
    path = tmp_path / "module.py"
    path.write_text(before)
    one = meaning([path], tmp_path)
    path.write_text(after)
    return meaning([path], tmp_path) != one


def test_comments_and_docstrings_do_not_affect_the_hash(tmp_path: Path) -> None:
    before = '"""A."""\n\ndef f(x):\n    """B."""\n    return x + 1\n'
    after = '# note\n"""C,\nlonger."""\n\n\ndef f(x):\n    # why\n    return (x +\n        1)  # so\n'
    assert not changed(tmp_path, before, after)


def test_setting_texts_do_not_affect_the_hash(tmp_path: Path) -> None:
    """A setting's user-facing texts do not affect the digest; its range and a new choice do."""
    before = (
        'a: Annotated[int, Setting(1, 9), SettingTexts("A", "What it does.", group="lab")] = 3\n'
        'B = Choices({"x": SettingTexts("X")})\n'
    )
    assert not changed(tmp_path, before, before.replace("What it does", "What it is for").replace("lab", "advanced"))
    assert not changed(tmp_path, before, before.replace('SettingTexts("X")', 'SettingTexts("The letter", "It is the letter.")'))
    for old, new in (("9", "8"), ("= 3", "= 4"), ('"x": SettingTexts("X")', '"x": SettingTexts("X"), "y": SettingTexts("Y")')):
        assert changed(tmp_path, before, before.replace(old, new)), new


def test_sentence_texts_do_not_affect_the_hash(tmp_path: Path) -> None:
    """The text of an error message does not affect the digest; the condition under which it is raised does."""
    before = 'def f(x):\n    if x > 1:\n        raise ValueError(Sentence("too-large", "{x} is too large", x=x))\n'
    assert not changed(tmp_path, before, before.replace("is too large", "exceeds 1"))
    assert changed(tmp_path, before, before.replace("x > 1", "x > 2"))


def test_code_changes_affect_the_hash(tmp_path: Path) -> None:
    before = "A = 'a'\n\ndef f(x):\n    return x + 1\n"
    for old, new in (("+", "-"), ("1", "1.0"), ("x", "y"), ("'a'", "'b'"), ("f(", "g(")):
        assert changed(tmp_path, before, before.replace(old, new)), new


def test_function_with_only_a_docstring_is_hashed(tmp_path: Path) -> None:
    assert changed(tmp_path, 'class A:\n    """A."""\n', "class B:\n    x = 1\n")


def test_hash_is_cached_by_file_bytes(tmp_path: Path, monkeypatch) -> None:
    path = tmp_path / "module.py"
    path.write_text("x = 1\n")
    first = cached_meaning([path], tmp_path / "kept", tmp_path)
    assert first == meaning([path], tmp_path)
    monkeypatch.setattr(sources, "meaning", lambda *_: "f" * 64)
    assert cached_meaning([path], tmp_path / "kept", tmp_path) == first
    path.write_text("x = 2\n")
    assert cached_meaning([path], tmp_path / "kept", tmp_path) == "f" * 64
    monkeypatch.setattr(sources, "meaning", lambda *_: "e" * 64)
    monkeypatch.setattr(sources, "__file__", str(path))  # source of another release that finds its files differently
    assert cached_meaning([path], tmp_path / "kept", tmp_path) == "e" * 64
    monkeypatch.setattr(sources, "meaning", lambda *_: "f" * 64)
    path.write_text("x = 3\n")
    assert cached_meaning([path], path / "nowhere", tmp_path) == "f" * 64


def test_hashed_files_are_exactly_the_compiled_ones() -> None:
    """MACHINE_CODE lists all modules with compiled functions and all of our modules that they import, so no change is missed."""
    hashed = set(files_of(MACHINE_CODE))
    for path in ROOT.rglob("*.py"):
        if any(f"renderer.jit.{name}" in _named(path) for name in DECORATORS):
            assert path in hashed, f"{path.relative_to(ROOT)} compiles, and is not in renderer.sources.MACHINE_CODE"
    for path in hashed:
        if path.suffix == ".py":
            missing = _ours(path) - hashed - EXEMPT
            assert not missing, f"{path.relative_to(ROOT)} imports {missing}"


def test_every_reader_is_in_the_array_hash() -> None:
    hashed = set(files_of((*MACHINE_CODE, *ARRAYS)))
    assert set((ROOT / "scene").rglob("*.py")) <= hashed
    for path in hashed:
        if path.suffix == ".py" and path.name != "render.py":
            missing = _ours(path) - hashed - EXEMPT
            assert not missing, f"{path.relative_to(ROOT)} imports {missing}"


@pytest.mark.long
def test_checkouts_of_equal_sources_have_one_kind(tmp_path: Path) -> None:
    """A checkout of the same sources has the same kind, even with edited docstrings; touching a file recompiles nothing."""
    copy = tmp_path / "renderer"
    subprocess.run(["cp", "-r", str(ROOT), str(copy)], check=True)
    reader = copy / "scene" / "readers" / "obj.py"
    reader.write_text(reader.read_text().replace('"""', '"""Edited. ', 1))
    run = [sys.executable, "-c", "from renderer import jit; print(jit.__file__, jit.kind(), jit.cache_folder())"]
    theirs = subprocess.run(run, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(tmp_path)}, capture_output=True, text=True)
    assert theirs.stdout.split() == [str(copy / "jit.py"), jit.kind(), str(jit.cache_folder())]


@functools.cache
def _named(path: Path) -> set[str]:
    """Returns all names that a file imports, as module.name."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{name.name}" for name in node.names)}
        elif isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
    return found


def _ours(path: Path) -> set[Path]:
    """Returns the paths of the renderer's modules that a file imports."""
    found = set()
    for module in _named(path):
        if module.startswith("renderer."):
            place = ROOT.parent / module.replace(".", "/")
            found |= {p for p in (place.with_suffix(".py"), place / "__init__.py") if p.is_file()}
    return found
