"""The page's JavaScript keeps the types that its JSDoc says."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

WEB = Path(__file__).resolve().parents[2] / "web"


def test_the_types_hold() -> None:
    compiler = WEB / "node_modules" / ".bin" / "tsc"
    if not compiler.exists():
        pytest.skip("TypeScript is not installed: npm install, in web/")
    result = subprocess.run([compiler, "--project", WEB], capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stdout
