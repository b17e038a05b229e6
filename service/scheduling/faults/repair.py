"""Deletes Redis keys of the wrong type. Workers can write any of the farm's keys, and commands on such a key fail."""

from __future__ import annotations

import logging
from typing import Any

import redis

from protocol.contract import (
    RESULTS,
    WORKER_KEYS,
    denoise_queue,
    pause_key,
    prepare_queue,
    render_queue,
)
from protocol.explained import explained_key
from protocol.joint import HELP_QUEUES
from protocol.site import secret_key, site_key
from protocol.terms import offer_key, terms_key
from protocol.view_parts import VIEW_ANSWERS, card_view_queue, view_key, view_queue
from protocol.vitals import log_key, log_wanted_key, vitals_key

__all__ = ["is_wrong_type", "repair", "repair_all"]

KEYS_PER_SCAN = 1000
TYPES = (
    (RESULTS, "stream"),
    (VIEW_ANSWERS, "list"),
    *((queue("*"), "list") for queue in (render_queue, prepare_queue, denoise_queue, view_queue, card_view_queue, explained_key)),
    (f"{HELP_QUEUES}*", "list"),
    (WORKER_KEYS, "string"),
    *(
        (key("*"), "string")
        for key in (*(pause_key, offer_key, terms_key, vitals_key, log_key, log_wanted_key, site_key, secret_key, view_key),)
    ),
    ("rayfarm:service", "string"),
    ("unacked", "hash"),  # these three belong to kombu
    ("unacked_index", "zset"),
    ("_kombu.binding.*", "set"),
)

log = logging.getLogger(__name__)


def is_wrong_type(error: BaseException) -> bool:
    """Returns True if a Redis command failed because its key has the wrong type."""
    return isinstance(error, redis.ResponseError) and "WRONGTYPE" in str(error)


def repair(connection: redis.Redis, key: str | bytes, type: str) -> bool:
    """Deletes a key if its Redis type differs from `type`. Returns whether it was deleted. Raises redis.RedisError."""
    with connection.pipeline() as pipe:
        pipe.watch(key)
        found: Any = pipe.type(key)
        if found.decode() in ("none", type):
            return False
        pipe.multi()
        pipe.delete(key)
        try:
            pipe.execute()
        except redis.WatchError:
            return False
    log.warning("the key %r is deleted: it was a %s, not a %s", key, found.decode(), type)
    return True


def repair_all(connection: redis.Redis) -> int:
    """Deletes all keys of the farm that have the wrong type. Returns their number. Raises redis.RedisError."""
    repaired = 0
    for pattern, type in TYPES:
        keys = list(connection.scan_iter(pattern, count=KEYS_PER_SCAN)) if pattern.endswith("*") else [pattern.encode()]
        for begin in range(0, len(keys), KEYS_PER_SCAN):
            some = keys[begin : begin + KEYS_PER_SCAN]
            with connection.pipeline(transaction=False) as pipe:
                for key in some:
                    pipe.type(key)
                found = pipe.execute()
            wrong = [key for key, each in zip(some, found, strict=True) if each.decode() not in ("none", type)]
            repaired += sum(repair(connection, key, type) for key in wrong)
    return repaired
