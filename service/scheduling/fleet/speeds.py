"""Speeds of the workers during the last hour, held in memory only."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Mapping

from protocol.contract import WorkerReport

__all__ = ["INTERVALS_KEPT", "Speeds"]

INTERVAL_S = 60.0
INTERVALS_KEPT = 60
FORGET_AFTER_S = 3600.0


class Speeds:
    """Samples per second of each worker's slots, averaged per minute over the reports in which a slot renders; 0 without one.

    So a minute with short work has the worker's speed, not its load. The last value belongs to the current minute.
    """

    def __init__(self, now: float | None = None) -> None:
        self._begun = time.monotonic() if now is None else now
        self._running: dict[str, list[float]] = {}
        self._past: dict[str, deque[float]] = {}
        self._seen: dict[str, float] = {}

    def add_reports(self, reports: Iterable[WorkerReport], now: float | None = None) -> None:
        """Adds the speeds of the workers' current reports. now: Unix time; None: the current time."""
        now = time.monotonic() if now is None else now
        if now - self._begun >= INTERVAL_S:
            self._begun = now
            self._close_interval(now)
        for report in reports:
            busy = sum(1 for doing in report.current if "batch" in doing and not doing.get("compiling"))
            self._running.setdefault(report.name, []).append(busy * report.samples_per_s)
            self._seen[report.name] = now

    @property
    def speeds_by_worker(self) -> Mapping[str, tuple[float, ...]]:
        """Returns the speeds of each worker: one value per minute since it connected, oldest first, at most `KEPT` values."""
        return {name: (*self._past.get(name, ()), *_rounded_mean(self._running.get(name))) for name in self._seen}

    def _close_interval(self, now: float) -> None:
        for name, seen in list(self._seen.items()):
            if now - seen > FORGET_AFTER_S:
                del self._seen[name]
                self._past.pop(name, None)
            else:
                self._past.setdefault(name, deque(maxlen=INTERVALS_KEPT - 1)).extend(
                    _rounded_mean(self._running.get(name)) or (0.0,)
                )
        self._running = {}


def _rounded_mean(speeds: list[float] | None) -> tuple[float, ...]:
    if not speeds:
        return ()
    of_work = [speed for speed in speeds if speed > 0.0]
    return (float(round(sum(of_work) / len(of_work))) if of_work else 0.0,)
