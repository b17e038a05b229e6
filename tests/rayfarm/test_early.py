"""Tests of the worker process that `rayfarm up` starts before its own imports.

The process waits until it receives its options, and ends when `rayfarm up` ends.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from rayfarm import preload
from rayfarm.local import early
from rayfarm.local.supervisor import Part, Supervisor
from renderer.child_processes import delayed_command, start_line
from tests.helpers import ROOT, wait_until

WAITS = """
import json, os, sys, time
from renderer.child_processes import wait_for_start_line
arguments = wait_for_start_line()
if arguments is not None:
    print(json.dumps([arguments, os.environ["GIVEN"], os.environ.get("KEPT"), sys.stdin.readline()]), flush=True)
    time.sleep(float(arguments[0]))
"""


@pytest.fixture
def waits(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(early, "waiting_command", lambda module: [sys.executable, "-c", WAITS])
    yield
    early.end_processes()


def test_waiting_process_reads_options_environment_and_log(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.write_text("before\n")
    line = start_line(["0", "two words"], {"GIVEN": "a\nb"}, log)
    assert line.count(b"\n") == 1
    environment = {**os.environ, "KEPT": "yes", "GIVEN": "no"}
    done = subprocess.run([sys.executable, "-c", WAITS], input=line, cwd=ROOT, env=environment, capture_output=True, check=True)
    assert done.stdout == done.stderr == b""
    before, said = log.read_text().splitlines()
    assert before == "before"
    assert json.loads(said) == [["0", "two words"], "a\nb", "yes", ""]


def test_waiting_process_ends_at_end_of_input() -> None:
    done = subprocess.run([sys.executable, "-c", WAITS], input=b"", cwd=ROOT, capture_output=True, check=True)
    assert done.stdout == done.stderr == b""


def test_process_starts_without_log(tmp_path: Path) -> None:
    line = start_line(["0"], {"GIVEN": ""}, tmp_path / "missing" / "log")
    done = subprocess.run([sys.executable, "-c", WAITS], input=line, cwd=ROOT, capture_output=True, check=True)
    assert json.loads(done.stdout)[0] == ["0"]


def test_supervisor_takes_over_early_process(waits: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    early.start_processes(["a.module"])
    process = early.take_process("a.module")
    assert process is not None
    assert early.take_process("a.module") is None
    monkeypatch.setenv("KEPT", "set after the process was started")
    part = Part("part", early.waiting_command("a.module"), tmp_path / "log", {"GIVEN": "x"}, arguments=["100"], spare=process)
    supervisor = Supervisor(ROOT, print)
    try:
        supervisor.start(part)
        assert part.process is process
        wait_until(lambda: part.last_log_lines() != "", 20, "it has begun")
        assert json.loads(part.last_log_lines()) == [["100"], "x", "set after the process was started", ""]
    finally:
        supervisor.stop(lambda: True)
    assert not psutil.pid_exists(process.pid)


def test_dead_early_process_is_restarted(waits: None, tmp_path: Path) -> None:
    early.start_processes(["a.module"])
    process = early.take_process("a.module")
    assert process is not None
    process.kill()
    process.wait()
    part = Part("part", early.waiting_command("a.module"), tmp_path / "log", {"GIVEN": "x"}, arguments=["100"], spare=process)
    supervisor = Supervisor(ROOT, print)
    try:
        supervisor.start(part)
        assert part.process is not process
        wait_until(lambda: part.last_log_lines() != "", 20, "another has begun")
    finally:
        supervisor.stop(lambda: True)


def test_unused_early_process_is_ended(waits: None) -> None:
    early.start_processes(["a.module", "another.module"])
    pids = [child.pid for child in psutil.Process().children() if "wait_for_start_line" in " ".join(child.cmdline())]
    early.end_processes()
    assert not any(map(psutil.pid_exists, pids))


@pytest.mark.parametrize(
    ("words", "started"),
    [
        (["up", "--port", "0"], [early.SERVICE, early.WORKER]),
        (["worker", "--join=x"], [early.WORKER]),
        (["up", "--help"], []),
        (["jobs"], []),
        ([], []),
    ],
)
def test_only_commands_that_start_processes_start_them_early(
    monkeypatch: pytest.MonkeyPatch, words: list[str], started: list[str]
) -> None:
    found: list[str] = []
    monkeypatch.setattr(early, "start_processes", found.extend)
    preload.start_preloading(words)
    assert found == started


def test_module_runs_with_later_arguments(tmp_path: Path) -> None:
    (tmp_path / "printing.py").write_text("import sys\nif __name__ == '__main__': print(sys.argv[1:])\n")
    command = [*delayed_command("printing", 0.01), "--one", "two"]
    assert subprocess.check_output(command, cwd=tmp_path, text=True) == "['--one', 'two']\n"
