"""Query of whether the service has recalled a slot's message, because other work waits for the slot."""

from __future__ import annotations

import contextlib
import time

import redis

from protocol.contract import recall_key

__all__ = ["Recall"]

LOOK_EVERY_S = 0.25


class Recall:
    """The recall of one message. `is_recalled`: whether the service had recalled it when `look` last asked Redis."""

    def __init__(self, connection: redis.Redis, message: str, every_s: float = LOOK_EVERY_S) -> None:
        """Stores the parameters. message: the id of the Celery message. every_s: seconds between two questions."""
        self._redis = connection
        self._key = recall_key(message)
        self._every_s = every_s
        self._looked = time.monotonic()
        self.is_recalled = False

    def look(self) -> None:
        """Asks Redis, unless it did shortly before. If Redis is unreachable or refuses, the message goes on."""
        if self.is_recalled or time.monotonic() - self._looked < self._every_s:
            return
        self._looked = time.monotonic()
        with contextlib.suppress(redis.RedisError, OSError):
            self.is_recalled = bool(self._redis.exists(self._key))
