"""Redis errors as sentences for users: what is wrong, and what to do."""

from __future__ import annotations

import re
from collections.abc import Callable

import redis

from renderer.library_messages import library_message
from renderer.sentences import Sentence
from service.errors import Unavailable

__all__ = ["FactAndRemedy", "exception_chain", "redis_fault", "redis_unavailable"]

FactAndRemedy = tuple[str, str]  # fact and remedy

# By error code, or by text where Redis sends no code; the first match counts.
ERROR_SENTENCES: tuple[tuple[str, Callable[[str], Sentence], Sentence], ...] = (
    (
        r"\bBUSY\b|running a script",
        lambda _: Sentence("redis-script-hanging", "Redis is blocked by a script that does not end."),
        Sentence("redis-script-hanging-advice", "End it: redis-cli SCRIPT KILL."),
    ),
    (
        r"\bREADONLY\b|read only (replica|slave)",
        lambda _: Sentence("redis-replica", "Redis accepts no writes: it is a replica."),
        Sentence(
            "redis-replica-advice",
            "Point RAYFARM_REDIS_URL at the primary, or make this one the primary: redis-cli REPLICAOF NO ONE.",
        ),
    ),
    (
        r"\bNOREPLICAS\b",
        lambda _: Sentence("redis-replicas-missing", "Redis accepts no writes without replicas."),
        Sentence("redis-replicas-missing-advice", "Start them, or set min-replicas-to-write to 0."),
    ),
    (
        r"\bOOM\b|used memory > 'maxmemory'",
        lambda _: Sentence("redis-memory-full", "Redis is full."),
        Sentence("redis-memory-full-advice", "Give it more memory (maxmemory)."),
    ),
    (
        r"\bMISCONF\b",
        lambda error: Sentence(
            "redis-save-failed", "Redis cannot save to its disk and so accepts no writes ({error}).", error=error
        ),
        Sentence("redis-save-failed-advice", 'Free space on its disk, or turn saving off (save "").'),
    ),
    (
        r"\bLOADING\b|loading the dataset",
        lambda _: Sentence("redis-loading", "Redis is loading its data from disk."),
        Sentence("redis-loading-advice", "The farm continues when it is done."),
    ),
    (
        r"\bNOAUTH\b|\bWRONGPASS\b|[Aa]uthentication required|invalid password|invalid username",
        lambda _: Sentence("redis-password-refused", "Redis rejects the service's password."),
        Sentence("redis-password-refused-advice", "Correct RAYFARM_REDIS_URL: redis://:PASSWORD@HOST:PORT/0."),
    ),
    (
        r"\bNOPERM\b|no permissions",
        lambda error: Sentence(
            "redis-permission-denied", "The service's Redis user lacks permissions that the farm needs ({error}).", error=error
        ),
        Sentence("redis-permission-denied-advice", "Give it all commands and keys: ACL SETUSER NAME on ~* &* +@all."),
    ),
    (
        r"\bNOSCRIPT\b|No matching script",
        lambda _: Sentence("redis-script-missing", "A script is missing in Redis."),
        Sentence("redis-script-missing-advice", "It is sent again automatically."),
    ),
    (
        r"\bWRONGTYPE\b",
        lambda error: Sentence(
            "redis-key-type-wrong", "A key in Redis has another type than the farm expects ({error}).", error=error
        ),
        Sentence("redis-key-type-wrong-advice", "It is deleted automatically."),
    ),
    (
        r"\bCLUSTERDOWN\b|\bMOVED\b|\bCROSSSLOT\b|cluster support",
        lambda error: Sentence("redis-cluster", "Redis is a cluster, which the farm's queue cannot use ({error}).", error=error),
        Sentence("redis-cluster-advice", "Point RAYFARM_REDIS_URL at a single Redis."),
    ),
    (
        r"max number of clients",
        lambda _: Sentence("redis-connections-exhausted", "Redis has reached its limit of connections."),
        Sentence("redis-connections-exhausted-advice", "Raise maxclients, or close other programs' connections."),
    ),
    (
        r"unknown command",
        lambda error: Sentence(
            "redis-command-unknown", "Redis does not support a command that the farm needs ({error}).", error=error
        ),
        Sentence("redis-command-unknown-advice", "Run Redis 6.2 or newer, or Valkey, with no commands renamed."),
    ),
)


def redis_fault(error: BaseException) -> FactAndRemedy:
    """Returns the fault and its remedy, as sentences, for an error of the Redis client or a queue error caused by one."""
    found = exception_chain(error)
    for cause in found:
        text = str(cause)
        for pattern, fact, remedy in ERROR_SENTENCES:
            # The client removes the code of errors that it has classes for
            if re.search(pattern, text) or re.search(pattern, _CODES.get(type(cause), "")):
                return fact(text), remedy
    for cause in found:
        if isinstance(cause, redis.ResponseError):
            return (
                Sentence("redis-command-refused", "Redis refuses a command ({error}).", error=library_message(cause)),
                Sentence("redis-command-refused-advice", "Check its configuration."),
            )
    return (
        Sentence("redis-not-reachable", "Redis does not answer ({error}).", error=library_message(error)),
        Sentence("redis-not-reachable-advice", "Start it, or check RAYFARM_REDIS_URL."),
    )


def redis_unavailable(error: BaseException) -> Unavailable:
    """Returns the error for an HTTP request that needs Redis while Redis is unavailable."""
    return Unavailable(redis_fault(error)[0], advice=Sentence("advice-retry-later", "Try again when that is done."))


_CODES: dict[type[BaseException], str] = {
    redis.ReadOnlyError: "READONLY",
    redis.OutOfMemoryError: "OOM",
    redis.BusyLoadingError: "LOADING",
    redis.AuthenticationError: "NOAUTH",
    redis.exceptions.NoPermissionError: "NOPERM",
    redis.exceptions.NoScriptError: "NOSCRIPT",
    redis.exceptions.ClusterDownError: "CLUSTERDOWN",
}


def exception_chain(error: BaseException | None) -> list[BaseException]:
    """Returns an exception followed by the chain of its causes and contexts."""
    found: list[BaseException] = []
    while error is not None and error not in found:
        found.append(error)
        error = error.__cause__ or error.__context__
    return found
