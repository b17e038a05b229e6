"""What a worker reports of itself, and what it is called."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest
import redis

from tests.helpers import wait_until
from worker.contract import HEARTBEAT_TTL_S, WorkerReport, render_queue, worker_key
from worker.heartbeat import Reporter, StartingBeat, free_name


def report(name: str, pid: int, host: str = "here") -> WorkerReport:
    return WorkerReport(name, host, pid, 2, "cpu", "kind", "starting", time.time())


@pytest.fixture
def store(redis_url: str) -> Iterator[redis.Redis]:
    with redis.Redis.from_url(redis_url) as connection:
        connection.flushall()
        yield connection
        connection.flushall()


def test_a_report_expires_and_can_be_taken_away(redis_url: str, store: redis.Redis) -> None:
    reporter = Reporter(redis_url)
    mine = report("a", 1)
    assert reporter.beat(mine)
    assert WorkerReport.from_bytes(store.get(worker_key("a"))) == mine  # type: ignore[arg-type]
    assert 0 < store.ttl(worker_key("a")) <= HEARTBEAT_TTL_S
    reporter.leave("a")
    assert store.get(worker_key("a")) is None


def test_a_worker_outlives_a_redis_that_is_away() -> None:
    reporter = Reporter("redis://127.0.0.1:9/0")
    assert not reporter.beat(report("a", 1))
    reporter.leave("a")
    assert reporter.waiting("kind") == 0


def test_what_waits_is_counted(redis_url: str, store: redis.Redis) -> None:
    store.rpush(render_queue("kind"), b"1", b"2")
    assert Reporter(redis_url).waiting("kind") == 2


def test_starting_is_reported_while_the_main_thread_is_busy(redis_url: str, store: redis.Redis) -> None:
    with StartingBeat(lambda: report("busy", os.getpid()), redis_url):
        wait_until(lambda: store.get(worker_key("busy")) is not None, 5, "the report is there")


def test_a_name_in_use_gets_a_number(redis_url: str, store: redis.Redis) -> None:
    assert free_name("vm", redis_url, "here") == "vm"
    store.set(worker_key("vm"), report("vm", 1).to_bytes())  # process 1 lives
    assert free_name("vm", redis_url, "here") == "vm-2"
    store.set(worker_key("vm-2"), report("vm-2", 12345, host="elsewhere").to_bytes())
    assert free_name("vm", redis_url, "here") == "vm-3"


def test_the_name_of_a_dead_worker_of_this_host_is_taken_again(redis_url: str, store: redis.Redis) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    store.set(worker_key("vm"), report("vm", dead.pid).to_bytes())
    assert free_name("vm", redis_url, "here") == "vm"
