"""Distinguishes a dead worker from a slow one: its heartbeat's Redis connection has a name, and closes when the process ends.

A worker on an overloaded machine may miss reports for longer than a report's TTL, but its leases stay valid.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterable
from typing import Any

import redis

__all__ = ["connected", "lifeline"]


def lifeline(worker: str) -> str:
    """Returns the name of the Redis connection on which a worker sends its heartbeat.

    The name contains a hash of the worker's name, since Redis allows no spaces in it.
    """
    return f"rayfarm-worker-{hashlib.sha256(worker.encode()).hexdigest()[:24]}"


def connected(store: redis.Redis, workers: Iterable[str]) -> set[str]:
    """Returns the names of those workers whose heartbeat connection to Redis is open.

    Empty if Redis cannot list its connections. Raises redis.RedisError.
    """
    names = {lifeline(worker): worker for worker in workers}
    clients: Any = []
    with contextlib.suppress(redis.ResponseError):
        clients = store.client_list() if names else []
    return {names[client["name"]] for client in clients if client.get("name") in names}
