"""Redis errors as user messages: the fact and the remedy."""

from __future__ import annotations

import re
from collections.abc import Callable

import redis

from renderer.sentences import Sentence
from service.errors import Unavailable

__all__ = ["RedisTrouble", "away", "causes", "redis_fault"]

RedisTrouble = tuple[str, str]  # fact and remedy

# By error code, or by text where Redis sends no code; the first match counts.
ANSWERS: tuple[tuple[str, Callable[[str], Sentence], Sentence], ...] = (
    (
        r"\bBUSY\b|running a script",
        lambda error: Sentence("redis-busy-with-script", "Redis is busy with a script that does not end ({error}).", error=error),
        Sentence("redis-busy-with-script-remedy", "End it: redis-cli SCRIPT KILL."),
    ),
    (
        r"\bREADONLY\b|read only (replica|slave)",
        lambda error: Sentence("redis-is-replica", "Redis takes no writes: it is a replica of another ({error}).", error=error),
        Sentence(
            "redis-is-replica-remedy",
            "Point RAYFARM_REDIS_URL at the primary, or make this one the primary: redis-cli REPLICAOF NO ONE.",
        ),
    ),
    (
        r"\bNOREPLICAS\b",
        lambda error: Sentence("redis-without-replicas", "Redis takes no writes without replicas ({error}).", error=error),
        Sentence("redis-without-replicas-remedy", "Start them, or set min-replicas-to-write to 0."),
    ),
    (
        r"\bOOM\b|used memory > 'maxmemory'",
        lambda error: Sentence("redis-full", "Redis is full ({error}).", error=error),
        Sentence("redis-full-remedy", "Give it more memory (maxmemory)."),
    ),
    (
        r"\bMISCONF\b",
        lambda error: Sentence(
            "redis-cannot-save", "Redis cannot save to its disk, and takes no writes for that ({error}).", error=error
        ),
        Sentence("redis-cannot-save-remedy", 'Make room on its disk, or turn saving off (save "").'),
    ),
    (
        r"\bLOADING\b|loading the dataset",
        lambda error: Sentence("redis-loading", "Redis is reading its memory from disk ({error}).", error=error),
        Sentence("redis-loading-remedy", "It goes on by itself."),
    ),
    (
        r"\bNOAUTH\b|\bWRONGPASS\b|[Aa]uthentication required|invalid password|invalid username",
        lambda error: Sentence("redis-refuses-password", "Redis refuses the service's password ({error}).", error=error),
        Sentence("redis-refuses-password-remedy", "Correct RAYFARM_REDIS_URL: redis://:PASSWORD@HOST:PORT/0."),
    ),
    (
        r"\bNOPERM\b|no permissions",
        lambda error: Sentence(
            "redis-refuses-user", "The service's user of Redis may not do what the farm needs ({error}).", error=error
        ),
        Sentence("redis-refuses-user-remedy", "Give it all commands and keys: ACL SETUSER NAME on ~* &* +@all."),
    ),
    (
        r"\bNOSCRIPT\b|No matching script",
        lambda error: Sentence("redis-forgot-script", "Redis has forgotten a script ({error}).", error=error),
        Sentence("redis-forgot-script-remedy", "It is sent again by itself."),
    ),
    (
        r"\bWRONGTYPE\b",
        lambda error: Sentence(
            "redis-key-of-other-type", "A key in Redis is of another type than the farm's ({error}).", error=error
        ),
        Sentence("redis-key-of-other-type-remedy", "It is deleted by itself."),
    ),
    (
        r"\bCLUSTERDOWN\b|\bMOVED\b|\bCROSSSLOT\b|cluster support",
        lambda error: Sentence(
            "redis-is-cluster", "Redis is a cluster, which the farm's queue cannot use ({error}).", error=error
        ),
        Sentence("redis-is-cluster-remedy", "Point RAYFARM_REDIS_URL at a single Redis."),
    ),
    (
        r"max number of clients",
        lambda error: Sentence("redis-connections-used-up", "Redis has as many connections as it takes ({error}).", error=error),
        Sentence("redis-connections-used-up-remedy", "Raise maxclients, or end programs that do not belong here."),
    ),
    (
        r"unknown command",
        lambda error: Sentence(
            "redis-unknown-command", "Redis does not know a command that the farm needs ({error}).", error=error
        ),
        Sentence("redis-unknown-command-remedy", "Run Redis 6.2 or newer, or Valkey, with no commands renamed."),
    ),
)


def redis_fault(error: BaseException) -> RedisTrouble:
    """Returns the (fact, remedy) for an error of the Redis client, or of the queue caused by one."""
    found = causes(error)
    for cause in found:
        text = str(cause)
        for pattern, fact, remedy in ANSWERS:
            # The client removes the code of errors that it has classes for
            if re.search(pattern, text) or re.search(pattern, _CODES.get(type(cause), "")):
                return fact(text), remedy
    for cause in found:
        if isinstance(cause, redis.ResponseError):
            return (
                Sentence("redis-refuses-command", "Redis refuses a command ({error}).", error=cause),
                Sentence("redis-refuses-command-remedy", "Look at how it is set up."),
            )
    return (
        Sentence("redis-does-not-answer", "Redis does not answer ({error}).", error=error),
        Sentence("redis-does-not-answer-remedy", "Start it, or look at RAYFARM_REDIS_URL."),
    )


def away(error: BaseException) -> Unavailable:
    """Returns the Unavailable error for a request that needs Redis."""
    return Unavailable(redis_fault(error)[0], advice=Sentence("try-again-when-over", "Try again when that is over."))


_CODES: dict[type[BaseException], str] = {
    redis.ReadOnlyError: "READONLY",
    redis.OutOfMemoryError: "OOM",
    redis.BusyLoadingError: "LOADING",
    redis.AuthenticationError: "NOAUTH",
    redis.exceptions.NoPermissionError: "NOPERM",
    redis.exceptions.NoScriptError: "NOSCRIPT",
    redis.exceptions.ClusterDownError: "CLUSTERDOWN",
}


def causes(error: BaseException | None) -> list[BaseException]:
    """Returns an exception and the chain of its causes and contexts, the exception itself first."""
    found: list[BaseException] = []
    while error is not None and error not in found:
        found.append(error)
        error = error.__cause__ or error.__context__
    return found
