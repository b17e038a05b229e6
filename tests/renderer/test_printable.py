"""Tests of making text safe to print, and of log records."""

from __future__ import annotations

import ast
import json
import logging
import subprocess
import sys

import pytest

from renderer.printable import LogRecord, one_line, printable
from tests.helpers import ROOT

UNSAFE = [
    *map(chr, (*range(9), *range(11, 32), *range(127, 160), 0x2028, 0x2029, *range(0x202A, 0x202F), *range(0x2066, 0x206A)))
]
HOSTILE = "\x1b]0;owned\x07\x1b[2J\u202etxt.exe\x9b31m\r\ud800"


def test_unsafe_characters_are_escaped() -> None:
    assert [printable(f"a{character}b") for character in UNSAFE] == [f"a\\u{ord(character):04x}b" for character in UNSAFE]


def test_safe_text_is_unchanged() -> None:
    text = "Würfel 立方体 مشهد 🎬 a\tb\nc é \u200f\u200d"
    assert printable(text) == text
    assert one_line("a\tb\nc\x1b") == "a b c\\u001b"
    assert json.loads(printable(json.dumps({"a": "\x9b\\\u202e"}, ensure_ascii=False))) == {"a": "\x9b\\\u202e"}


def test_a_log_has_no_control_characters(capfd: pytest.CaptureFixture[str]) -> None:
    program = f"""
import logging
from renderer.printable import LogRecord
logging.setLogRecordFactory(LogRecord)
logging.warning("name %s", {HOSTILE!r}, extra={{"a": 1}})
try:
    raise ValueError({HOSTILE!r})
except ValueError as error:
    logging.exception("failed: %s", error)
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, check=True)
    said = done.stderr.decode()
    assert said.count("\\u001b]0;owned") == 3 and "Traceback" in said
    assert printable(said) == said
    assert LogRecord("x", logging.INFO, "", 1, "%s", (HOSTILE,), None).getMessage() == printable(HOSTILE)


def test_all_output_is_printable() -> None:
    """All output is made safe to print.

    All consoles are PlainConsole, and all arguments of `print` are constants, JSON or printable text.
    """
    wrong = []
    # Programs that import only Python's standard library, and print no text from elsewhere.
    alone = {"worker/healthy.py", "service/healthy.py", "renderer/precompile.py"}
    for folder in ("rayfarm", "service", "worker", "telemetry", "protocol", "renderer"):
        for path in (ROOT / folder).rglob("*.py"):
            name = str(path.relative_to(ROOT))
            if name in alone or name.startswith("renderer/blender/"):
                continue
            text = path.read_text()
            nodes = ast.walk(ast.parse(text)) if "print(" in text or "Console(" in text else ()
            for node in nodes:
                called = node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""
                if called == "Console" or (called == "print" and not all(_is_safe(each) for each in node.args)):
                    wrong.append(f"{name}:{node.lineno}: {ast.unparse(node)[:80]}")
    assert not wrong, wrong


def _is_safe(node: ast.expr) -> bool:
    if isinstance(node, ast.Call):
        return ast.unparse(node.func) in ("printable", "one_line", "json.dumps")
    return isinstance(node, ast.Constant) or ast.unparse(node) == "f'rayfarm {__version__}'"
