"""The reader of the result stream: every entry once, and where in the stream it is."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import redis

from service.scheduling.incoming.results import Results
from worker.protocol.contract import RESULTS, Result


@pytest.fixture
def connection(redis_url: str) -> Iterator[redis.Redis]:
    with redis.Redis.from_url(redis_url) as made:
        made.delete(RESULTS)
        yield made


def append(connection: redis.Redis, number: int) -> None:
    connection.xadd(RESULTS, Result({"number": number}).to_fields())  # type: ignore[arg-type]


def read(results: Results) -> list[int]:
    return [entry.result.event["number"] for entry in results.read(10) if entry.result is not None]


def test_what_is_kept_in_the_stream_holds_up_nothing(connection: redis.Redis) -> None:
    results = Results(connection)
    for number in range(100):
        append(connection, number)
    assert read(results) == list(range(64))
    assert read(results) == list(range(64, 100))
    append(connection, 100)
    assert read(results) == [100]
    assert read(results) == []
    results.start_over()
    assert read(results)[0] == 0, "nothing was deleted"


def test_an_answer_may_be_unread_up_to_the_end(connection: redis.Redis) -> None:
    results = Results(connection)
    assert results.has_read(results.end()), "there is no stream"
    for number in range(70):
        append(connection, number)
    end = results.end()
    entries = results.read(10)
    assert not results.has_read(end)
    results.delete(entries + results.read(10))
    assert results.has_read(end)
    assert (results.length(), results.end()) == (0, end)
