"""The page's JavaScript keeps the types that its JSDoc says."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

WEB = Path(__file__).resolve().parents[1] / "web"


def test_the_types_hold() -> None:
    tools = (WEB, WEB.parent / ".venv" / "typescript")  # the second is where farm.py puts it
    compiler = next((found for tool in tools if (found := tool / "node_modules" / ".bin" / "tsc").exists()), None)
    if compiler is None:
        pytest.skip("TypeScript is not installed: npm install, in web/")
    result = subprocess.run([compiler, "--project", WEB], capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stdout
