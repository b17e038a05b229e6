"""A worker's process that is started before the command knows what for."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from rayfarm import early
from tests.helpers import ROOT, wait_until

SAYS = "import os, sys; from worker.told import be_told; print(be_told(), sys.argv[1:], os.environ.get('TOLD'), sys.stdin.read())"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("worker --join http://farm:8000", True),
        ("worker --slots 2 --join=farm", True),
        ("worker --help", False),
        ("worker --join farm -h", False),
        ("worker", False),
        ("render a.glb --join x", False),
    ],
)
def test_when_it_is_of_use(words: str, expected: bool) -> None:
    assert early.is_of_use(words.split()) is expected


def test_it_is_told_its_options_its_environment_and_its_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = [sys.executable, "-c", SAYS, "--told"]
    process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)
    monkeypatch.setattr(early, "_process", process)
    log = tmp_path / "logs" / "worker.log"
    assert early.told(["--slots", "2"], {"TOLD": "ünï"}, log) is process
    assert process.wait(30) == 0
    assert log.read_text() == "True ['--slots', '2'] ünï \n"
    assert early.told([], {}, log) is None, "it is there once"


@pytest.mark.parametrize("said", [b"", json.dumps({"options": []}).encode()], ids=["nothing", "half a line"])
def test_without_a_word_it_ends(said: bytes) -> None:
    done = subprocess.run([sys.executable, "-c", SAYS], cwd=ROOT, input=said, capture_output=True, check=True)
    assert done.stdout.startswith(b"False")


def test_where_it_has_died_a_worker_is_started_in_the_usual_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    process = subprocess.Popen([sys.executable, "-c", ""], stdin=subprocess.PIPE)
    wait_until(lambda: process.poll() is not None, 30, "it has ended")
    monkeypatch.setattr(early, "_process", process)
    assert early.told([], dict(os.environ), tmp_path / "log") is None
