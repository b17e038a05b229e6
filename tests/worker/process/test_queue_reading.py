"""Tests that invalid entries in a queue do not harm a worker."""

from __future__ import annotations

import json
from typing import Any

import kombu
import pytest
import redis
from kombu.transport import redis as transport

from worker.process.queue_reading import skip_malformed_messages

GARBAGE = (b"\xff\xfe", b"{", b"", b"{}", b"[1, 2]", b"7", b'{"properties": {}}', b'{"properties": 3}', b"[" * 100_000)


@pytest.mark.parametrize("garbage", GARBAGE, ids=[str(each[:8]) for each in GARBAGE])
def test_malformed_messages_are_skipped(redis_url: str, garbage: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transport.Transport, "Channel", transport.Transport.Channel)  # restored after the test
    skip_malformed_messages()
    got: list[Any] = []
    with redis.Redis.from_url(redis_url) as store, kombu.Connection(redis_url) as connection:
        queue = kombu.Queue("garbage", durable=False)
        store.delete("garbage")
        store.lpush("garbage", garbage)
        with connection.Producer() as producer:
            producer.publish({"good": True}, routing_key="garbage", declare=[queue])
        assert store.llen("garbage") == 2, "the garbage lies before it"
        with connection.Consumer(queue, accept=["json"], callbacks=[lambda body, message: (got.append(body), message.ack())]):
            while not got:
                connection.drain_events(timeout=20)
        assert store.llen("garbage") == 0
    assert json.dumps(got) == '[{"good": true}]'


def test_returned_messages_go_into_the_own_queue(redis_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transport.Transport, "Channel", transport.Transport.Channel)
    monkeypatch.setattr("worker.process.queue_reading.SkippingChannel.own_queue", "")
    skip_malformed_messages("own")
    got: list[Any] = []
    options = {"ack_emulation": False}
    with redis.Redis.from_url(redis_url) as store, kombu.Connection(redis_url, transport_options=options) as connection:
        shared, own = (kombu.Queue(name, durable=False) for name in ("shared", "own"))
        store.delete("shared", "own", "unacked")
        with connection.Producer() as producer:
            producer.publish({"work": 1}, routing_key="shared", declare=[shared])
        with connection.Consumer([shared, own], accept=["json"], callbacks=[lambda body, message: got.append((body, message))]):
            while not got:
                connection.drain_events(timeout=20)
            assert not store.exists("unacked"), "what is not acknowledged is in the worker's memory"
            got.pop()[1].requeue()
            assert (store.llen("shared"), store.llen("own")) == (0, 1)
            while not got:
                connection.drain_events(timeout=20)
    (body, message) = got[0]
    assert body == {"work": 1}
    assert message.delivery_info["redelivered"], "its deaths are counted"
