"""Tests that `rayfarm worker` and `rayfarm site` end with the reason as the last line, after the output of libraries."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from rayfarm.errors import CommandError
from rayfarm.joining import FATAL_EXIT_CODE, run

REASON = "http://127.0.0.1:8000 does not know this token."
LATER = "nanobind: leaked 1 functions!"  # printed by a library while the process exits
SAID = f"rayfarm worker: {REASON}"


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ([SAID], REASON),
        ([SAID, LATER], REASON),
        ([json.dumps({"level": "ERROR", "message": SAID}), LATER], REASON),
        (["Segmentation fault"], "Segmentation fault"),
    ],
    ids=["last line", "earlier line", "JSON", "no reason"],
)
def test_exit_reason_is_shown_despite_later_output(
    lines: list[str], expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RAYFARM_CACHE", str(tmp_path))
    program = f"print({chr(10).join(lines)!r}); raise SystemExit({FATAL_EXIT_CODE})"
    with pytest.raises(CommandError) as ended:
        run("worker", [sys.executable, "-c", program], "token", "Joining.")
    assert str(ended.value) == expected
