"""How often a piece of work has killed the process that did it."""

from __future__ import annotations

import contextlib
from typing import Any

import redis

from worker.process.context import WorkerContext

__all__ = ["DEATHS_ALLOWED", "deaths_of", "is_redelivered", "survived"]

DEATHS_ALLOWED = 3


def is_redelivered(task: Any) -> bool:
    """Whether a process that had this message did not come to its end."""
    return bool((task.request.delivery_info or {}).get("redelivered"))


def deaths_of(task: Any, worker: WorkerContext, work: str) -> int:
    """How often the process that did this work was killed: the broker hands such work out again, for ever if nobody counts."""
    if not is_redelivered(task):
        return 0
    key = _key(work)
    try:
        deaths = int(worker.results.redis.incr(key))
        worker.results.redis.expire(key, 3600)
    except redis.RedisError:
        return 0
    return deaths


def survived(task: Any, worker: WorkerContext, work: str) -> None:
    """The process did this work, and so did not die of it: of others in the same message one may be to blame."""
    if is_redelivered(task):
        with contextlib.suppress(redis.RedisError):
            worker.results.redis.delete(_key(work))


def _key(work: str) -> str:
    return f"rayfarm:deaths:{work}"
