"""Wakes the scheduler of live views, which waits for answers in Redis, without blocking the caller if Redis hangs."""

from __future__ import annotations

import threading

import redis

from protocol.view_parts import ANSWERS_TTL_S, VIEW_ANSWERS

__all__ = ["Waker"]


class Waker:
    """Wakes the scheduler by pushing an empty answer to the list in Redis that it reads, from a separate thread."""

    def __init__(self, connection: redis.Redis) -> None:
        self._redis = connection
        self._requested = threading.Event()
        self._stopped = False
        self._thread = threading.Thread(target=self._run, name="viewing-waker", daemon=True)

    def start(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Stops the thread without waiting for Redis."""
        self._stopped = True
        self._requested.set()
        if self._thread.is_alive():
            self._thread.join(1)

    def wake(self) -> None:
        """Makes the scheduler continue soon. Does not block."""
        self._requested.set()

    def _run(self) -> None:
        while True:
            self._requested.wait()
            self._requested.clear()
            if self._stopped:
                return
            try:
                with self._redis.pipeline(transaction=False) as at_once:
                    at_once.rpush(VIEW_ANSWERS, b"")
                    at_once.expire(VIEW_ANSWERS, ANSWERS_TTL_S)
                    at_once.execute()
            except redis.RedisError:
                continue  # the scheduler also wakes up periodically
