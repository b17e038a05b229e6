"""Redis errors as user messages: the fact and the remedy."""

from __future__ import annotations

import re

import redis

from service.errors import Unavailable

__all__ = ["RedisTrouble", "away", "causes", "trouble_of"]

RedisTrouble = tuple[str, str]  # fact and remedy

# By error code, or by text where Redis sends no code; the first match counts.
ANSWERS: tuple[tuple[str, str, str], ...] = (
    (r"\bBUSY\b|running a script", "Redis is busy with a script that does not end ({error}).", "End it: redis-cli SCRIPT KILL."),
    (
        r"\bREADONLY\b|read only (replica|slave)",
        "Redis takes no writes: it is a replica of another ({error}).",
        "Point RAYFARM_REDIS_URL at the primary, or make this one the primary: redis-cli REPLICAOF NO ONE.",
    ),
    (
        r"\bNOREPLICAS\b",
        "Redis takes no writes without replicas ({error}).",
        "Start them, or set min-replicas-to-write to 0.",
    ),
    (r"\bOOM\b|used memory > 'maxmemory'", "Redis is full ({error}).", "Give it more memory (maxmemory)."),
    (
        r"\bMISCONF\b",
        "Redis cannot save to its disk, and takes no writes for that ({error}).",
        'Make room on its disk, or turn saving off (save "").',
    ),
    (r"\bLOADING\b|loading the dataset", "Redis is reading its memory from disk ({error}).", "It goes on by itself."),
    (
        r"\bNOAUTH\b|\bWRONGPASS\b|[Aa]uthentication required|invalid password|invalid username",
        "Redis refuses the service's password ({error}).",
        "Correct RAYFARM_REDIS_URL: redis://:PASSWORD@HOST:PORT/0.",
    ),
    (
        r"\bNOPERM\b|no permissions",
        "The service's user of Redis may not do what the farm needs ({error}).",
        "Give it all commands and keys: ACL SETUSER NAME on ~* &* +@all.",
    ),
    (r"\bNOSCRIPT\b|No matching script", "Redis has forgotten a script ({error}).", "It is sent again by itself."),
    (r"\bWRONGTYPE\b", "A key in Redis is of another type than the farm's ({error}).", "It is deleted by itself."),
    (
        r"\bCLUSTERDOWN\b|\bMOVED\b|\bCROSSSLOT\b|cluster support",
        "Redis is a cluster, which the farm's queue cannot use ({error}).",
        "Point RAYFARM_REDIS_URL at a single Redis.",
    ),
    (
        r"max number of clients",
        "Redis has as many connections as it takes ({error}).",
        "Raise maxclients, or end programs that do not belong here.",
    ),
    (
        r"unknown command",
        "Redis does not know a command that the farm needs ({error}).",
        "Run Redis 6.2 or newer, or Valkey, with no commands renamed.",
    ),
)


def trouble_of(error: BaseException) -> RedisTrouble:
    """Returns the (fact, remedy) for an error of the Redis client, or of the queue caused by one."""
    found = causes(error)
    for cause in found:
        text = str(cause)
        for pattern, fact, remedy in ANSWERS:
            # The client removes the code of errors that it has classes for
            if re.search(pattern, text) or re.search(pattern, _CODES.get(type(cause), "")):
                return fact.format(error=text), remedy
    for cause in found:
        if isinstance(cause, redis.ResponseError):
            return f"Redis refuses a command ({cause}).", "Look at how it is set up."
    return f"Redis does not answer ({error}).", "Start it, or look at RAYFARM_REDIS_URL."


def away(error: BaseException) -> Unavailable:
    """Returns the Unavailable error for a request that needs Redis."""
    return Unavailable(trouble_of(error)[0], advice="Try again when that is over.")


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
