"""Tests of the reader of the result stream, which returns every entry exactly once, with its position."""

from __future__ import annotations

import json
from collections.abc import Iterator

import pytest
import redis

from protocol.contract import RESULTS, Result
from service.scheduling.incoming import results as results_module
from service.scheduling.incoming.results import Entry, Results


@pytest.fixture
def connection(redis_url: str) -> Iterator[redis.Redis]:
    with redis.Redis.from_url(redis_url) as made:
        made.delete(RESULTS)
        yield made


def append(connection: redis.Redis, number: int) -> None:
    connection.xadd(RESULTS, Result({"number": number}).to_fields())  # type: ignore[arg-type]


def read(results: Results) -> list[int]:
    return [entry.result.event["number"] for entry in results.read(10) if entry.result is not None]


def test_undeleted_entries_are_read_once(connection: redis.Redis) -> None:
    results = Results(connection)
    for number in range(100):
        append(connection, number)
    assert read(results) == list(range(64))
    assert read(results) == list(range(64, 100))
    append(connection, 100)
    assert read(results) == [100]
    assert read(results) == []
    results.reread()
    assert read(results)[0] == 0, "nothing was deleted"


def test_position_is_read_after_all_earlier_entries(connection: redis.Redis) -> None:
    results = Results(connection)
    assert results.has_read(results.latest_position()), "there is no stream"
    for number in range(70):
        append(connection, number)
    end = results.latest_position()
    entries = results.read(10)
    assert not results.has_read(end)
    results.delete(entries + results.read(10))
    assert results.has_read(end)
    assert (results.length(), results.latest_position()) == (0, end)


@pytest.fixture
def limited_connection(connection: redis.Redis) -> Iterator[redis.Redis]:
    """Yields a connection to a Redis that closes connections whose reply exceeds 2 MiB. The farm's own limit is 192 MiB."""
    name = "client-output-buffer-limit"
    before = connection.config_get(name)[name]
    connection.config_set(name, "normal 2097152 0 0")
    yield connection
    connection.config_set(name, before)


def read_with_retries(results: Results) -> list[Entry]:
    """Returns the next entries of the stream. Retries after Redis has closed the connection."""
    for _ in range(20):
        try:
            return results.read(10)
        except redis.ConnectionError:
            continue
    raise AssertionError("the connection always ends")


def test_entry_above_reply_limit_has_fault(limited_connection: redis.Redis) -> None:
    results = Results(limited_connection)
    append(limited_connection, 0)
    large = limited_connection.xadd(RESULTS, {"event": json.dumps({"number": 1}), "sums": bytes(3 << 20)})
    for number in (2, 3):
        append(limited_connection, number)
    entries = [entry for _ in range(4) for entry in read_with_retries(results)]
    assert [entry.result and entry.result.event["number"] for entry in entries] == [0, None, 2, 3]
    assert entries[1].id == large
    assert "too large" in entries[1].fault
    assert limited_connection.xinfo_groups(RESULTS) == []
    results.delete(entries)
    assert results.length() == 0


def test_fewer_entries_are_read_near_reply_limit(limited_connection: redis.Redis) -> None:
    results = Results(limited_connection)
    for number in range(12):
        limited_connection.xadd(RESULTS, {"event": json.dumps({"number": number}), "sums": bytes(400 << 10)})
    found: list[int] = []
    while len(found) < 12:
        found += [entry.result.event["number"] for entry in read_with_retries(results) if entry.result is not None]
    assert found == list(range(12))


def test_latest_position_does_not_read_entries(limited_connection: redis.Redis) -> None:
    results = Results(limited_connection)
    id = limited_connection.xadd(RESULTS, {"sums": bytes(3 << 20)}, id="5-1")
    assert id == b"5-1"
    assert results.latest_position() == (5, 1)
    assert not results.has_read((5, 1))


def test_large_entry_goes_to_dead_letters(connection: redis.Redis, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results_module, "MAX_ENTRY_BYTES", 1000)
    results = Results(connection)
    connection.xadd(RESULTS, {"event": json.dumps({"number": 1}), "sums": bytes(2000)})
    append(connection, 2)
    large, small = results.read(10)
    assert large.result is None
    assert "2,0" in large.fault and "1,000" in large.fault
    assert small.result is not None
