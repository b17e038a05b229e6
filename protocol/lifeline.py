"""Distinguishes a dead worker from a slow one: its heartbeat's connection to Redis has a name, and closes with the process.

A worker on an overloaded machine may miss reports for longer than a report's TTL. It keeps the leases of its work.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterable
from typing import Any

import redis

__all__ = ["connected", "lifeline"]


def lifeline(worker: str) -> str:
    """The name of a worker's Redis connection. Redis allows no spaces in it."""
    return f"rayfarm-worker-{hashlib.sha256(worker.encode()).hexdigest()[:24]}"


def connected(store: redis.Redis, workers: Iterable[str]) -> set[str]:
    """Those of these workers whose connection is open; empty if Redis does not list connections. Raises redis.RedisError."""
    names = {lifeline(worker): worker for worker in workers}
    clients: Any = []
    with contextlib.suppress(redis.ResponseError):
        clients = store.client_list() if names else []
    return {names[client["name"]] for client in clients if client.get("name") in names}
