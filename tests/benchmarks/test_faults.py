"""Tests of the fault campaign's timeouts, which count only idle time, and of its counts of repeated batches."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import redis

from protocol.contract import RESULTS
from tests.benchmarks.faults.patience import Patience
from tests.benchmarks.faults.stream import Stream
from tests.benchmarks.faults.tally import BEGIN, END, Fault, into_page, read, table, write
from tests.helpers import ROOT, wait_until


def test_table_has_a_row_per_kind_and_a_correct_total(tmp_path: Path) -> None:
    faults = [
        Fault("a", "here", recovered_s=1.0, repeated=2, digest_is_right=True),
        Fault("a", "here", recovered_s=3.0, digest_is_right=False),
        Fault("b", "here", recovered_s=None, digest_is_right=None, asked=True),
        Fault("c", "here", undone="no mount"),
    ]
    write(tmp_path / "log", faults[:1])
    write(tmp_path / "log", faults[1:])
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table(read([tmp_path / "log"])).splitlines()[2:]]
    assert rows == [
        ["a", "2", "1", "0", "0", "2", "2.0 s", "3.0 s"],
        ["b", "1", "0", "1", "1", "0", "", ""],
        ["**all**", "3", "1", "1", "1", "2", "2.0 s", "3.0 s"],
    ]


def test_table_replaces_the_text_between_markers(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    into_page(page, "new")
    assert page.read_text() == f"before\n{BEGIN}\n\nnew\n\n{END}\nafter\n"
    page.write_text("no marks")
    with pytest.raises(SystemExit, match="has no place"):
        into_page(page, "new")
    assert BEGIN in (ROOT / "docs" / "fault-tests.md").read_text()


def test_timeout_counts_idle_time_only() -> None:
    clock = [0.0]

    def after(seconds: float, patience: Patience) -> bool:
        clock[0] += seconds
        return patience.is_over

    idle = Patience(10.0, list, lambda: clock[0])
    assert not after(9.9, idle)
    assert after(1.2, idle)

    busy = [0.0]
    patience = Patience(10.0, list, lambda: clock[0])
    patience._busy = lambda: {1: busy[0], 2: 0.0}  # type: ignore[method-assign]
    for _ in range(7):  # a busy machine: the process works all the time
        busy[0] += 10.0
        assert not after(10.0, patience)
    assert not after(9.0, patience)
    assert after(2.0, patience)  # 11 s of idle time in total

    patience = Patience(10.0, list, lambda: clock[0])
    patience._busy = lambda: {1: clock[0]}  # type: ignore[method-assign]
    assert not after(80.0, patience)
    assert after(1.1, patience)  # the limit in wall time applies


def test_busy_process_time_is_measured() -> None:
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as process:
        patience = Patience(1.0, lambda: [process.pid])
        wait_until(lambda: sum(patience._busy().values()) > 0.2, 60, "it computed, or waited to")
        process.kill()


def test_repeated_results_are_counted_and_forged_ones_are_not(redis_url: str) -> None:
    def answer(first: int) -> dict[bytes, bytes]:
        event = {"type": "batch", "job": "j", "frame": 0, "tile": [0, 0, 8, 8], "first": first, "count": 4}
        return {b"event": json.dumps(event).encode(), b"sums": b"x"}

    with redis.Redis.from_url(redis_url) as store:
        store.delete(RESULTS)
        with Stream(lambda: redis.Redis.from_url(redis_url)) as stream:
            store.xadd(RESULTS, answer(0))  # type: ignore[arg-type]
            wait_until(lambda: stream.batches == 1, 20, "it is read")
            stream.forge(store, stream.latest[-1])
            for first in (4, 6, 12):  # the second repeats samples of the first
                store.xadd(RESULTS, answer(first))  # type: ignore[arg-type]
            wait_until(lambda: stream.latest[-1] == answer(12), 20, "all are read")
        assert (stream.batches, stream.repeated) == (4, 1)
        store.delete(RESULTS)
