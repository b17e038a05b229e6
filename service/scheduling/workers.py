"""Who renders: the workers' own reports, under keys that expire when nobody renews them."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import redis

from worker.contract import WORKER_KEYS, WorkerReport, order_key

__all__ = ["Workers"]

LOOK_EVERY_S = 1.0
ORDER_TTL_S = 7 * 86400  # a worker of that name may come back; some day nobody remembers why it was paused
LOOK_WHILE_IDLE_S = 0.2  # while nobody is ready: the first work should not wait for the next look


class Workers:
    """The latest look at the workers. Read by all threads, renewed by the engine's; every look makes a new dict."""

    def __init__(self, connection: redis.Redis, on_change: Callable[[str], None]) -> None:
        self._redis = connection
        self._on_change = on_change
        self._looked = 0.0
        self.reports: dict[str, WorkerReport] = {}
        self.orders: dict[str, str] = {}  # why a worker is paused, by its name

    def look(self) -> None:
        """Renew the reports where they are older than a second. Raises redis.RedisError."""
        now = time.monotonic()
        if now - self._looked < (LOOK_EVERY_S if self.ready() else LOOK_WHILE_IDLE_S):
            return
        self._looked = now
        reports = {}
        keys = sorted(self._redis.scan_iter(WORKER_KEYS, count=1000))
        values: Any = self._redis.mget(keys) if keys else []
        for value in values:
            try:
                report = WorkerReport.from_bytes(value)
            except (TypeError, ValueError):
                continue  # expired between the two calls, or of another version
            reports[report.name] = report
        names = sorted(reports)
        found: Any = self._redis.mget([order_key(name) for name in names]) if names else []
        orders = {name: order.decode(errors="replace") for name, order in zip(names, found, strict=True) if order is not None}
        before = {name: (self.reports.get(name), self.orders.get(name)) for name in self.reports.keys() | reports.keys()}
        self.reports, self.orders = reports, orders
        for name, known in before.items():
            if known != (reports.get(name), orders.get(name)):
                self._on_change(name)

    def pause(self, name: str, why: str) -> None:
        """Let a worker take no more tasks, until `resume`. Raises redis.RedisError."""
        self._redis.set(order_key(name), why, ex=ORDER_TTL_S)
        self.orders = {**self.orders, name: why}
        self._on_change(name)

    def resume(self, name: str) -> None:
        """Let a worker take tasks again. Raises redis.RedisError."""
        self._redis.delete(order_key(name))
        self.orders = {other: why for other, why in self.orders.items() if other != name}
        self._on_change(name)

    def ready(self) -> list[WorkerReport]:
        """The workers that take work."""
        return [report for report in self.reports.values() if report.state == "ready" and report.name not in self.orders]

    def slots(self, kind: str) -> int:
        """The slots of the ready workers of a kind."""
        return sum(report.slots for report in self.ready() if report.kind == kind)

    def best_kind(self) -> str | None:
        """The kind with most slots; None where no worker is ready."""
        kinds = {report.kind for report in self.ready()}
        return max(sorted(kinds), key=self.slots, default=None)

    def current(self) -> list[dict[str, Any]]:
        """What all slots do now."""
        return [doing for report in self.reports.values() for doing in report.current if doing]
