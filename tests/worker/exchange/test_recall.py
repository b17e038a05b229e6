"""Tests of recalled messages: a slot asks Redis while it renders, and goes on if there is no answer."""

from __future__ import annotations

import redis

from protocol.contract import recall_key
from worker.exchange.recall import Recall


def test_recall_of_one_message_is_noticed(redis_url: str) -> None:
    with redis.Redis.from_url(redis_url) as store:
        mine, other, late = Recall(store, "m", every_s=0.0), Recall(store, "n", every_s=0.0), Recall(store, "m", every_s=60.0)
        mine.look()
        assert not mine.is_recalled
        store.set(recall_key("m"), 1, ex=10)
        for each in (mine, other, late):
            each.look()
        assert (mine.is_recalled, other.is_recalled, late.is_recalled) == (True, False, False), "one asks seldom"
        store.delete(recall_key("m"))
        mine.look()
        assert mine.is_recalled


def test_message_goes_on_without_redis() -> None:
    recall = Recall(redis.Redis(port=1, socket_connect_timeout=0.1), "m", every_s=0.0)
    recall.look()
    assert not recall.is_recalled
