"""Distinguishes a dead worker from a slow one by the Redis connection of its heartbeat, which closes when the process ends.

The connection has a name, so that Redis's list of connections shows the worker. A worker on an overloaded machine may send no
report for longer than a report's TTL, but its leases stay valid as long as it is connected.
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
