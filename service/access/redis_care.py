"""Care for the farm's Redis: ends scripts that block it, removes keys of the wrong type, and names known security flaws."""

from __future__ import annotations

import contextlib
import logging

import redis
from redis.lock import Lock

from service.access.redis_release import release_of

__all__ = ["RedisCare", "end_busy", "is_busy"]

log = logging.getLogger(__name__)

# The type of each key of a farm by the beginning of its name; the first that fits counts.
TYPES: tuple[tuple[bytes, bytes], ...] = (
    (b"rayfarm:results", b"stream"),
    (b"rayfarm:view-answers", b"list"),
    (b"rayfarm:explained:", b"list"),
    (b"rayfarm:", b"string"),
    (b"rayfarm.", b"list"),
    (b"_kombu.binding", b"set"),
    (b"unacked_index", b"zset"),
    (b"unacked_mutex", b"string"),
    (b"unacked", b"hash"),
)
MATCHES = ("rayfarm[:.]*", "_kombu.binding*", "unacked*")
EVERY = 6  # rounds between two looks at all keys


def is_busy(error: Exception) -> bool:
    """Whether Redis answers nothing but this since a script or function runs without end."""
    return isinstance(error, redis.ResponseError) and str(error).startswith("BUSY")


def end_busy(connection: redis.Redis) -> bool:
    """End the script or function that blocks Redis; False if it has written already, so that only a restart ends it."""
    ended = False
    for command in ("SCRIPT KILL", "FUNCTION KILL"):
        with contextlib.suppress(redis.ResponseError):
            ended = bool(connection.execute_command(command)) or ended
    return ended


class RedisCare:
    """Looks after one Redis; `look` is called every few seconds."""

    def __init__(self, connection: redis.Redis) -> None:
        self._redis = connection
        self._rounds = 0
        self._said = ""

    def look(self) -> None:
        """Load what older workers run, look for wrong keys, and warn of flaws. Raises redis.RedisError."""
        self._redis.script_load(Lock.LUA_RELEASE_SCRIPT)  # older workers release locks with it, and may load none
        if self._rounds % EVERY == 0:
            self._warn()
            self._repair()
        self._rounds += 1

    def unblock(self) -> None:
        """End a script that blocks Redis. Raises redis.RedisError."""
        if end_busy(self._redis):
            log.warning("a script blocked Redis and was ended")
        else:
            log.error("a script blocks Redis and has written already; only a restart of Redis ends it")

    def _warn(self) -> None:
        flaw = release_of(self._redis.info("server")).flaw
        if flaw is not None and flaw != self._said:
            log.warning("%s", flaw)
        self._said = flaw or ""

    def _repair(self) -> None:
        for pattern in MATCHES:
            names = list(self._redis.scan_iter(pattern, count=1000))
            with self._redis.pipeline(transaction=False) as types:
                for name in names:
                    types.type(name)
                found = types.execute()
            for name, kind in zip(names, found, strict=True):
                wanted = next((wanted for start, wanted in TYPES if name.startswith(start)), kind)
                if kind not in (wanted, b"none"):
                    log.warning(
                        "the Redis key %.200r was a %s in place of a %s and is removed", name, kind.decode(), wanted.decode()
                    )
                    self._redis.unlink(name)
