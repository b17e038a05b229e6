"""Counts how often a piece of work (a batch, a scene, a message) has killed the process that did it."""

from __future__ import annotations

import contextlib
from typing import Any

import redis

from worker.process.context import WorkerContext

__all__ = ["DEATHS_ALLOWED", "count_deaths", "is_redelivered", "reset_deaths"]

DEATHS_ALLOWED = 3


def is_redelivered(task: Any) -> bool:
    """Returns True if the broker delivered this message before, to a process that did not finish."""
    return bool((task.request.delivery_info or {}).get("redelivered"))


def count_deaths(task: Any, worker: WorkerContext, work: str) -> int:
    """Returns how often this work has killed its process, including just before this redelivery; 0 for a first delivery.

    The broker redelivers messages of killed processes without a limit. work: id of the work. The counter is in Redis; returns 0
    if Redis is unreachable.
    """
    if not is_redelivered(task):
        return 0
    key = _key(work)
    try:
        deaths = int(worker.results.redis.incr(key))
        worker.results.redis.expire(key, 3600)
    except redis.RedisError:
        return 0
    return deaths


def reset_deaths(task: Any, worker: WorkerContext, work: str) -> None:
    """Resets the counter of work that succeeded after a redelivery: another batch of its message may have been the cause."""
    if is_redelivered(task):
        with contextlib.suppress(redis.RedisError):
            worker.results.redis.delete(_key(work))


def _key(work: str) -> str:
    return f"rayfarm:deaths:{work}"
