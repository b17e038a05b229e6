"""Whether the service has recalled a message with several batches, since other work waits for the slot that renders it."""

from __future__ import annotations

import contextlib
import threading
from typing import Self

import redis

from protocol.contract import recall_key

__all__ = ["Recall"]

LOOK_EVERY_S = 0.25


class Recall:
    """Context manager with a thread that asks Redis whether a message was recalled.

    `is_recalled`: whether it had been when the thread last asked. If Redis is unreachable or refuses, the message goes on. The
    thread ends with the context, so none runs when the slot forks a reader.
    """

    def __init__(self, connection: redis.Redis, message: str, every_s: float = LOOK_EVERY_S) -> None:
        """Stores the parameters. message: the id of the Celery message. every_s: seconds between two questions."""
        self._redis = connection
        self._key = recall_key(message)
        self._every_s = every_s
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._ask, name="recall", daemon=True)
        self.is_recalled = False

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def _ask(self) -> None:
        while not self.is_recalled and not self._ended.wait(self._every_s):
            with contextlib.suppress(redis.RedisError, OSError):
                self.is_recalled = bool(self._redis.exists(self._key))
