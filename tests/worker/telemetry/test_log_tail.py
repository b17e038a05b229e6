"""Tests of the end of a log that several processes write, and that the parent reads."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator

import pytest

from worker.telemetry import log_tail
from worker.telemetry.log_tail import LogTail


@pytest.fixture
def tail() -> Iterator[LogTail]:
    tail = LogTail()
    yield tail
    tail.close()


def log_line(tail: LogTail, text: str) -> None:
    tail.handle(logging.LogRecord("worker", logging.INFO, "", 0, text, (), None))


def test_parent_reads_complete_lines_of_slots_in_order(tail: LogTail) -> None:
    children = []
    for child in range(4):
        if (pid := os.fork()) == 0:
            for i in range(200):
                log_line(tail, f"slot {child} line {i} " + "x" * 40)
            os._exit(0)
        children.append(pid)
    for pid in children:
        os.waitpid(pid, 0)
    lines = tail.lines(10_000)
    for child in range(4):
        own = [line for line in lines if line.startswith(f"slot {child} ")]
        assert own == [f"slot {child} line {i} " + "x" * 40 for i in range(200)]
    assert tail.lines(3) == lines[-3:]


def test_log_keeps_last_lines_within_limit(tail: LogTail, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_tail, "BYTES_READ", 1000)
    monkeypatch.setattr(log_tail, "MAX_FILE_BYTES", 5000)
    for i in range(1000):
        log_line(tail, f"line {i}")
        tail.trim()
    lines = tail.lines(10_000)
    assert lines == [f"line {i}" for i in range(1000 - len(lines), 1000)] and len(lines) > 50
    assert os.fstat(tail._file.fileno()).st_size < 6000


def test_missing_file_is_tolerated(tail: LogTail) -> None:
    tail._file.close()
    log_line(tail, "still here")
    tail.trim()
    assert tail.lines() == []
