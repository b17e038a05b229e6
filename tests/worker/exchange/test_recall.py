"""Tests of recalled messages: a slot asks Redis while it renders, and goes on if there is no answer."""

from __future__ import annotations

import threading

import redis

from protocol.contract import recall_key
from tests.helpers import wait_until
from worker.exchange.recall import Recall


def test_recall_is_noticed_while_a_message_is_rendered(redis_url: str) -> None:
    with redis.Redis.from_url(redis_url) as store, Recall(store, "m", every_s=0.01) as mine, Recall(store, "n", 0.01) as other:
        assert not mine.is_recalled
        store.set(recall_key("m"), 1, ex=10)
        wait_until(lambda: mine.is_recalled, 10, "it is recalled")
        assert not other.is_recalled
        store.delete(recall_key("m"))
    assert not [each for each in threading.enumerate() if each.name == "recall"], "a slot may fork again"


def test_message_goes_on_without_redis() -> None:
    nowhere = redis.Redis(port=1, socket_connect_timeout=0.1)
    with Recall(nowhere, "m", every_s=0.001) as recall:
        threading.Event().wait(0.05)
        assert not recall.is_recalled
        assert [each for each in threading.enumerate() if each.name == "recall"], "it asks again"
