"""Tests of the worker's health file, and of the container's health check that reads it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers import ROOT
from worker import healthy
from worker.machine import health_file
from worker.machine.health_file import WorkerState


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(health_file.HEALTH_FILE_VARIABLE, str(tmp_path / "alive"))
    return tmp_path / "alive"


@pytest.mark.parametrize("state", WorkerState)
def test_waiting_worker_is_healthy_but_not_ready(state: WorkerState, file: Path) -> None:
    health_file.write_state(state)
    assert healthy.unhealthy_reason(str(file)) == ""
    assert bool(healthy.unhealthy_reason(str(file), ready=True)) is (state is not WorkerState.WORKING)


@pytest.mark.parametrize(
    ("state", "why"), [(WorkerState.WORKING, "last seen"), (WorkerState.AWAY, ""), (WorkerState.STARTING, "")]
)
def test_old_health_file_is_unhealthy_only_while_working(state: WorkerState, why: str, file: Path) -> None:
    """Checks that an old health file means unhealthy only if the event loop should run.

    A worker that waits for the service or Redis is healthy however old its file is.
    """
    health_file.write_state(state)
    os.utime(file, (1.0, 1.0))
    assert (why in healthy.unhealthy_reason(str(file)), bool(healthy.unhealthy_reason(str(file)))) == (True, bool(why))
    health_file.write_state(state)
    assert healthy.unhealthy_reason(str(file)) == "", "what is said again is fresh"


def test_ended_worker_is_unhealthy(file: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        ended.wait()
    health_file.write_state(WorkerState.WORKING, ended.pid)
    assert "has ended" in healthy.unhealthy_reason(str(file))
    file.write_text("nonsense")
    assert "does not contain" in healthy.unhealthy_reason(str(file))
    file.unlink()
    assert "does not contain" in healthy.unhealthy_reason(str(file))


def test_health_check_runs_as_program(file: Path) -> None:
    command = [sys.executable, "-IS", str(ROOT / "worker" / "healthy.py")]
    health_file.write_state(WorkerState.STARTING)
    assert subprocess.run(command, check=False).returncode == 0
    done = subprocess.run([*command, "--ready"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "the worker is starting\n")


def test_no_health_file_without_setting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(health_file.HEALTH_FILE_VARIABLE, raising=False)
    health_file.write_state(WorkerState.WORKING)
    monkeypatch.setenv(health_file.HEALTH_FILE_VARIABLE, "/nowhere/alive")
    health_file.write_state(WorkerState.WORKING)
