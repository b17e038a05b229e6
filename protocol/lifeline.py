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
    """Returns the name of a worker's Redis connection. Redis does not allow spaces in it."""
    return f"rayfarm-worker-{hashlib.sha256(worker.encode()).hexdigest()[:24]}"


def connected(store: redis.Redis, workers: Iterable[str]) -> set[str]:
    """Returns those of the workers whose connection is open; empty if Redis cannot list connections. Raises redis.RedisError."""
    names = {lifeline(worker): worker for worker in workers}
    clients: Any = []
    with contextlib.suppress(redis.ResponseError):
        clients = store.client_list() if names else []
    return {names[client["name"]] for client in clients if client.get("name") in names}
