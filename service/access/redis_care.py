"""Maintenance of the farm's Redis: ends blocking scripts, removes excess data and keys of wrong types, warns of security flaws.

All data in Redis can be rebuilt from the database, the films and the workers' next reports, so any key may be removed.
"""

from __future__ import annotations

import contextlib
import logging
import re
from collections import Counter
from collections.abc import Iterator

import redis
from redis.lock import Lock

from service.access.redis_release import release_of

__all__ = ["RedisCare", "end_blocking_script", "is_busy"]

log = logging.getLogger(__name__)

# The type of the farm's keys by prefix of their names; the first match counts.
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
KEY_PATTERNS = ("rayfarm[:.]*", "_kombu.binding*", "unacked*")
ROUNDS_BETWEEN_SCANS = 6  # rounds between two scans of all keys
EXCESS_SHARE = 0.5  # share of Redis's memory, or of its connections, above which excess use is searched for
MAX_MEMORY_FRACTION = 0.125  # share of the memory for the keys of one kind, except results, whose size the service limits itself
MAX_CLIENT_FRACTION = 0.25  # share of the connections for one worker's Redis user
KIND = re.compile(rb"rayfarm:[a-z-]+|rayfarm\.|_kombu|unacked")
RESULTS = b"rayfarm:results"
WORKER_USER = "rayfarm-"
KEYS_PER_PIPELINE = 1000  # keys in one pipeline


def is_busy(error: Exception) -> bool:
    """Returns True if this error means that a running script or function blocks Redis."""
    return isinstance(error, redis.ResponseError) and str(error).startswith("BUSY")


def end_blocking_script(connection: redis.Redis) -> bool:
    """Ends the script or function that blocks Redis.

    Returns False if it has already written data: then only a restart ends it.
    """
    ended = False
    for command in ("SCRIPT KILL", "FUNCTION KILL"):
        with contextlib.suppress(redis.ResponseError):
            ended = bool(connection.execute_command(command)) or ended
    return ended


class RedisCare:
    """Maintains one Redis server. `maintain` is called every few seconds."""

    def __init__(self, connection: redis.Redis) -> None:
        self._redis = connection
        self._rounds = 0
        self._warned_flaw = ""

    def maintain(self) -> None:
        """Runs all maintenance: limits connections and memory, loads the script that older workers need, removes keys of wrong
        types, warns of security flaws.

        Raises redis.RedisError.
        """
        self._close_excess_connections()
        self._free_memory()
        self._redis.script_load(Lock.LUA_RELEASE_SCRIPT)  # older workers release locks with it, and may not load scripts
        if self._rounds % ROUNDS_BETWEEN_SCANS == 0:
            self._warn()
            self._repair()
        self._rounds += 1

    def unblock(self) -> None:
        """Ends a script that blocks Redis and logs the outcome. Raises redis.RedisError."""
        if end_blocking_script(self._redis):
            log.warning("a script that blocked Redis was killed")
        else:
            log.error("a script that has already written data blocks Redis; only a restart of Redis ends it")

    def _warn(self) -> None:
        flaw = release_of(self._redis.info("server")).flaw
        if flaw is not None and flaw != self._warned_flaw:
            log.warning("%s", flaw)
        self._warned_flaw = flaw or ""

    def _close_excess_connections(self) -> None:
        """Closes connections if Redis has few left.

        Closes all connections of each worker user that holds more than the fraction MAX_CLIENT_FRACTION of Redis's limit.
        """
        clients = self._redis.info("clients")
        most = int(clients.get("maxclients") or 0)
        if not most or int(clients["connected_clients"]) < EXCESS_SHARE * most:
            return
        users = Counter(str(client.get("user", "")) for client in self._redis.client_list())
        for user, count in users.items():
            if user.startswith(WORKER_USER) and count > MAX_CLIENT_FRACTION * most:
                log.warning("the Redis user %s of a worker has %d connections; all of them are closed", user, count)
                self._redis.execute_command("CLIENT", "KILL", "USER", user)

    def _free_memory(self) -> None:
        """If Redis has used half of its memory, closes the connections that fill it, and deletes the largest excess keys."""
        memory = self._redis.info("memory")
        limit = int(memory.get("maxmemory") or 0)
        if not limit or int(memory["used_memory"]) < EXCESS_SHARE * limit:
            return
        self._close_largest_connections(MAX_MEMORY_FRACTION * limit)
        self._remove_largest_keys(limit)

    def _close_largest_connections(self, most: float) -> None:
        """Closes all connections of each worker user whose commands and unread replies use more than `most` bytes."""
        sizes: Counter[str] = Counter()
        for client in self._redis.client_list():
            sizes[str(client.get("user", ""))] += int(client.get("tot-mem") or 0)
        for user, size in sizes.items():
            if user.startswith(WORKER_USER) and size > most:
                log.warning("the Redis user %s of a worker uses %d bytes for its connections; all of them are closed", user, size)
                self._redis.execute_command("CLIENT", "KILL", "USER", user)

    def _remove_largest_keys(self, limit: int) -> None:
        """Deletes the largest keys of each kind that exceeds its normal size. limit: Redis's memory, bytes."""
        kinds: dict[bytes, list[tuple[int, bytes]]] = {}
        for names in self._key_batches():
            with self._redis.pipeline(transaction=False) as sizes:
                for name in names:
                    sizes.memory_usage(name)
                for name, size in zip(names, sizes.execute(), strict=True):
                    if size is not None and name != RESULTS and (found := KIND.match(name)):
                        kinds.setdefault(found[0], []).append((size, name))
        for kind, known in kinds.items():
            over = sum(size for size, _ in known) - MAX_MEMORY_FRACTION * limit
            gone: list[bytes] = []
            for size, name in sorted(known, reverse=True):
                if over <= 0:
                    break
                over -= size
                gone.append(name)
            for at in range(0, len(gone), KEYS_PER_PIPELINE):
                self._redis.unlink(*gone[at : at + KEYS_PER_PIPELINE])
            if gone:
                log.warning(
                    "Redis is half full, mostly of keys %s*: %d are removed, as %.200r", kind.decode(), len(gone), gone[0]
                )

    def _key_batches(self) -> Iterator[list[bytes]]:
        """Yields the names of the farm's keys in lists of at most KEYS_PER_PIPELINE."""
        for pattern in KEY_PATTERNS:
            names: list[bytes] = []
            for name in self._redis.scan_iter(pattern, count=KEYS_PER_PIPELINE):
                names.append(name)
                if len(names) >= KEYS_PER_PIPELINE:
                    yield names
                    names = []
            if names:
                yield names

    def _repair(self) -> None:
        for names in self._key_batches():
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
