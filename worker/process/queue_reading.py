"""Kombu's channel with the changes that workers need.

It skips malformed messages: kombu raises any error of decoding, so such a message would end one worker after another. And a
worker over HTTPS keeps the messages that it has not acknowledged in its own memory, and puts those of killed slots into its own
queue, since it may change no other. If the worker itself is killed, the service's leases end.
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

    own_queue = ""  # for returned messages, if not the one that they came from

    def _restore(self, message: Any, leftmost: bool = False) -> None:
        """Puts an unacknowledged message back into its queue, or into the worker's own."""
        if not self.own_queue:
            super()._restore(message, leftmost)
            return
        returned = message.serializable()
        returned["properties"]["delivery_info"]["redelivered"] = True
        self._put(self.own_queue, returned)

    def _get_client(self) -> Any:
        super()._get_client()  # checks redis-py's version
        return ScriptlessRedis

    def _brpop_read(self, **options: Any) -> Any:
        try:
            return super()._brpop_read(**options)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            log.warning("an invalid entry in the queue is skipped (%s: %.200s)", type(error).__name__, error)
            return True  # something was read


def skip_malformed_messages(own_queue: str = "") -> None:
    """Makes this process read all queues with SkippingChannel.

    own_queue: for returned messages, of a worker over HTTPS; "": they go back to the queue that they came from.
    """
    SkippingChannel.own_queue = own_queue
    redis.Transport.Channel = SkippingChannel
