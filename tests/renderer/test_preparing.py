"""The process that compiles what prepares scenes: started where that has to be compiled, and gone afterwards."""

from __future__ import annotations

import subprocess
from typing import Any

import psutil
import pytest

from renderer import preparing
from renderer.preparing import preparing_beside


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[subprocess.Popen[bytes]]:
    """What was started, in place of which something sleeps."""
    found: list[subprocess.Popen[bytes]] = []
    popen = subprocess.Popen

    def start(command: list[str], **options: Any) -> subprocess.Popen[bytes]:
        assert command[1:] == ["-m", "renderer.beside", "plain"]
        found.append(popen(["sleep", "0.2" if found == [] else "60"], **options))
        return found[-1]

    monkeypatch.setattr(subprocess, "Popen", start)
    monkeypatch.setattr(preparing, "cores", lambda: 2)
    preparing.prepare.cache_clear()
    return found


def test_it_is_waited_for(started: list[subprocess.Popen[bytes]]) -> None:
    with preparing_beside(True, "plain"):
        assert len(started) == 1
    assert started[0].returncode == 0


def test_it_does_not_outlive_what_fails(started: list[subprocess.Popen[bytes]]) -> None:
    with preparing_beside(True, "plain"):
        pass
    with pytest.raises(ZeroDivisionError), preparing_beside(True, "plain"):
        _ = 1 / 0
    assert not psutil.pid_exists(started[1].pid)


def test_nothing_is_started_where_there_is_nothing_to_compile(
    started: list[subprocess.Popen[bytes]], monkeypatch: pytest.MonkeyPatch
) -> None:
    with preparing_beside(False, "plain"):
        pass
    preparing.prepare()
    with preparing_beside(True, "plain"):
        pass
    preparing.prepare.cache_clear()
    monkeypatch.setattr(preparing, "cores", lambda: 1)
    with preparing_beside(True, "plain"):
        pass
    assert started == []
