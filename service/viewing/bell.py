"""Wakes the desk, which waits for answers in Redis, from any thread, without the caller having to wait for a Redis that may
hang."""

from __future__ import annotations

import threading

import redis

from worker.protocol.view_parts import ANSWERS_TTL_S, VIEW_ANSWERS

__all__ = ["Bell"]


class Bell:
    """Rung, it puts an empty answer into the list, in a thread of its own."""

    def __init__(self, connection: redis.Redis) -> None:
        self._redis = connection
        self._rung = threading.Event()
        self._stopped = False
        self._thread = threading.Thread(target=self._run, name="viewing-bell", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End. A Redis that hangs is not waited for."""
        self._stopped = True
        self._rung.set()
        if self._thread.is_alive():
            self._thread.join(1)

    def ring(self) -> None:
        """Wake the desk soon. Returns at once."""
        self._rung.set()

    def _run(self) -> None:
        while True:
            self._rung.wait()
            self._rung.clear()
            if self._stopped:
                return
            try:
                with self._redis.pipeline(transaction=False) as at_once:
                    at_once.rpush(VIEW_ANSWERS, b"")
                    at_once.expire(VIEW_ANSWERS, ANSWERS_TTL_S)
                    at_once.execute()
            except redis.RedisError:
                continue  # the desk wakes up by itself
