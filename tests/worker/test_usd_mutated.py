"""Tests that damaged USD files, read in a confined child, yield a scene or an error message, and that the worker survives."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers import ROOT

TRIES = 2


@pytest.fixture(scope="module")
def error_messages(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, list[str]]]:
    """Returns the folder of the damaged USD files, and the error messages of reading them, by file suffix."""
    folder = tmp_path_factory.mktemp("usd")
    command = [sys.executable, "-m", "tests.worker.damaged_stages", str(folder), str(TRIES)]
    done = subprocess.run(command, capture_output=True, cwd=ROOT, timeout=300, check=False)
    found: dict[str, list[str]] = {}
    for line in done.stdout.splitlines():
        found |= json.loads(line)
    assert done.returncode == 0, f"after {[*found]}: {done.stderr.decode()}"
    return folder, found


@pytest.mark.long
@pytest.mark.parametrize("suffix", ["usda", "usdc", "usdz"])
def test_damaged_stage_gives_scene_or_error_message(error_messages: tuple[Path, dict[str, list[str]]], suffix: str) -> None:
    folder, found = error_messages
    sentences = [sentence for sentence in found[suffix] if sentence]
    for sentence in sentences:
        assert sentence.startswith((f"a.{suffix}: ", f"a.{suffix} ", f"a.{suffix}[")), sentence
        assert "crash" not in sentence and "took longer" not in sentence
        assert str(folder) not in sentence
    assert len(found[suffix]) == TRIES
    assert len(sentences) < TRIES or suffix != "usda"  # in so small a binary file most bytes matter, so all may fail
