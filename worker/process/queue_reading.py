"""Skips malformed messages in queues.

Kombu raises any error of decoding, so such a message would end one worker after another.
"""

from __future__ import annotations

import logging
from typing import Any

from kombu.transport import redis
from redis import Redis

from worker.process.redis_lock import ScriptlessLock

__all__ = ["skip_malformed_messages"]

log = logging.getLogger(__name__)


class ScriptlessRedis(Redis):
    """A Redis client whose locks run no scripts, since a worker's Redis user may not run any."""

    def lock(self, name: str, *positional: Any, **options: Any) -> Any:
        """Returns a lock without scripts. Celery takes one before it restores messages of dead workers."""
        return super().lock(name, *positional, **{"lock_class": ScriptlessLock, **options})


class SkippingChannel(redis.Channel):
    """Kombu's Redis channel, which skips malformed messages."""

    def _get_client(self) -> Any:
        super()._get_client()  # checks redis-py's version
        return ScriptlessRedis

    def _brpop_read(self, **options: Any) -> Any:
        try:
            return super()._brpop_read(**options)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            log.warning("an invalid entry in the queue is skipped (%s: %.200s)", type(error).__name__, error)
            return True  # something was read


def skip_malformed_messages() -> None:
    """Makes this process read all queues with SkippingChannel."""
    redis.Transport.Channel = SkippingChannel
