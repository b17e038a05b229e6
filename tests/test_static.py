"""What is checked without running anything: style and types. The import contracts are in test_architecture.py."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.helpers import ROOT

# An eighth of its time mypy looks for garbage, of which it has next to none.
MYPY = "import gc; gc.disable(); gc.enable = gc.disable; from mypy.__main__ import console_entry; console_entry()"
COMMANDS = {
    "ruff check": ["-m", "ruff", "check", "."],
    "ruff format": ["-m", "ruff", "format", "--check", "."],
    "mypy": ["-c", MYPY],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_nothing_is_found(command: str) -> None:
    done = subprocess.run([sys.executable, *COMMANDS[command]], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
