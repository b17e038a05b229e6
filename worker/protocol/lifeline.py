"""How the service tells a dead worker from a slow one: the connection of its heartbeat to Redis has a name, and ends with its
process.

A worker on an overloaded machine may go without reporting for longer than a report lives. What it has in hand is not lost.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterable
from typing import Any

import redis

__all__ = ["connected", "lifeline"]


def lifeline(worker: str) -> str:
    """The name of its connection: Redis takes no spaces there."""
    return f"rayfarm-worker-{hashlib.sha256(worker.encode()).hexdigest()[:24]}"


def connected(store: redis.Redis, workers: Iterable[str]) -> set[str]:
    """Those of these workers whose connection stands; nobody where Redis does not tell. Raises redis.RedisError."""
    names = {lifeline(worker): worker for worker in workers}
    clients: Any = []
    with contextlib.suppress(redis.ResponseError):
        clients = store.client_list() if names else []
    return {names[client["name"]] for client in clients if client.get("name") in names}
