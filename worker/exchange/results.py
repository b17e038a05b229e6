"""Sends events and sums on the RESULTS stream, and retries while Redis or the service restarts."""

from __future__ import annotations

import logging
import time

import redis
from redis.backoff import ExponentialBackoff
from redis.retry import Retry

from protocol.contract import RESULTS, Result
from worker.exchange.chunked_socket import chunked_redis

__all__ = ["PIECE_TIMEOUT_S", "RELAYED_PIECE_TIMEOUT_S", "ResultStream"]

# The service trims the stream after the merge. If it does not, workers wait at this many entries instead of filling the
# broker's memory (a 64x64 batch packs to about 100 kB), and finally drop the result, which is rendered again.
MAX_ENTRIES = 2000
RETRY_FOR_S = 120.0
PIECE_TIMEOUT_S = 10.0  # timeout of a piece of a result
RELAYED_PIECE_TIMEOUT_S = 60.0  # through a relay, which holds some pieces; it finds out itself whether the line is dead

log = logging.getLogger(__name__)


class ResultStream:
    """The RESULTS stream, for writing. Each process creates its own."""

    def __init__(
        self,
        redis_url: str,
        max_entries: int = MAX_ENTRIES,
        timeout_s: float = RETRY_FOR_S,
        piece_timeout_s: float = PIECE_TIMEOUT_S,
    ) -> None:
        self.max_entries = max_entries
        self.timeout_s = timeout_s
        self._length = max_entries  # the stream's last known length
        self.redis = chunked_redis(
            redis_url,
            socket_timeout=piece_timeout_s,
            socket_connect_timeout=5,
            retry=Retry(ExponentialBackoff(cap=0.5, base=0.05), 2),
        )

    def send(self, result: Result, timeout_s: float | None = None) -> bool:
        """Appends a result. Returns False if the stream stays full, or Redis unreachable, for `timeout_s` seconds.

        timeout_s: None means the default of two minutes; 0 makes one attempt, for events that may be dropped. A retry after a
        lost reply may append a result twice; merging into the film drops the duplicate.
        """
        fields = result.to_fields()
        timeout_s = self.timeout_s if timeout_s is None else timeout_s
        deadline = time.monotonic() + timeout_s
        pause = 0.05
        waits = False
        while True:
            try:
                if self._length >= self.max_entries:
                    self._length = int(self.redis.xlen(RESULTS))
                if self._length < self.max_entries:
                    with self.redis.pipeline(transaction=False) as both:  # one round trip
                        both.xadd(RESULTS, fields)  # type: ignore[arg-type]
                        both.xlen(RESULTS)
                        self._length = int(both.execute()[1])
                    if waits:
                        log.warning("results are taken again")
                    return True
                why = f"{self.max_entries} results wait for the service"
            except (redis.RedisError, OSError) as error:
                why = f"Redis: {error}"
            if time.monotonic() >= deadline:
                if timeout_s:
                    log.warning("a result is dropped after %.0f s (%s); it will be rendered again", timeout_s, why)
                return False
            if not waits:
                waits = True
                log.warning("a result waits (%s)", why)
            time.sleep(pause)
            pause = min(pause * 2, 1.0)
