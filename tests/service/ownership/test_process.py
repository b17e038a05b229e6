"""Tests of identifying processes beyond their PID: whether one has ended or is stopped, and how it is killed."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from service.ownership.process import is_gone, is_stopped, kill_process, this_process
from tests.helpers import wait_until

pytestmark = pytest.mark.skipif(this_process() is None, reason="this system does not tell of processes")
PROGRAM = (
    "import json, sys; from service.ownership.process import this_process; print(json.dumps(this_process()), flush=True); input()"
)


@pytest.fixture
def other() -> Iterator[tuple[subprocess.Popen[bytes], dict[str, Any]]]:
    process = subprocess.Popen([sys.executable, "-c", PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout is not None
    yield process, json.loads(process.stdout.readline())
    process.kill()
    process.communicate()


def test_running_stopped_and_killed_process_are_detected(other: tuple[subprocess.Popen[bytes], dict[str, Any]]) -> None:
    process, known = other
    assert not is_gone(known)
    assert not is_stopped(known)
    process.send_signal(signal.SIGSTOP)
    wait_until(lambda: is_stopped(known), 20, "it stands still")
    assert kill_process(known)
    assert process.wait(20) == -signal.SIGKILL
    assert is_gone(known)
    assert not is_stopped(known)
    assert not kill_process(known)


def test_reused_pid_is_detected(other: tuple[subprocess.Popen[bytes], dict[str, Any]]) -> None:
    process, known = other
    earlier = {**known, "started": str(int(known["started"]) - 1)}
    assert is_gone(earlier)
    assert not kill_process(earlier)
    assert process.poll() is None


@pytest.mark.parametrize("where", ["boot", "numbers"])
def test_process_of_other_machine_is_unknown(where: str) -> None:
    elsewhere = {**(this_process() or {}), "pid": 2**22 - 1, where: "another"}
    assert not is_gone(elsewhere)
    assert not is_stopped(elsewhere)
    assert not kill_process(elsewhere)
    assert not is_gone(None)
