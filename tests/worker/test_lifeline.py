"""Tests that a worker counts as connected exactly while Redis lists its connection, even if it sends no reports."""

from __future__ import annotations

import time

import redis

from protocol.contract import WorkerReport, worker_key
from protocol.lifeline import connected, lifeline
from tests.helpers import wait_until
from worker.heartbeat import Reporter


def test_worker_is_connected_while_connection_is_open(redis_url: str, store: redis.Redis) -> None:
    name = "a name with spaces, ümläuts\nand lines"
    reporter = Reporter(redis_url)
    assert connected(store, {name}) == set()
    assert reporter.write_report(WorkerReport(name, "host", 1, 2, "cpu", "kind", "ready", time.time()))
    store.delete(worker_key(name))
    assert connected(store, {name, "another"}) == {name}
    reporter.redis.close()
    wait_until(lambda: connected(store, {name, "another"}) == set(), 10, "Redis sees that the connection is closed")
    assert " " not in lifeline(name)


def test_no_worker_is_connected_if_redis_cannot_list_connections(redis_url: str, store: redis.Redis) -> None:
    store.execute_command("ACL SETUSER", "narrow", "on", ">narrow", "~*", "+@all", "-@dangerous")
    try:
        with redis.Redis.from_url(f"redis://narrow:narrow@{redis_url.rpartition('@')[2]}") as narrow:
            assert connected(narrow, {"a"}) == set()
    finally:
        store.execute_command("ACL DELUSER", "narrow")
