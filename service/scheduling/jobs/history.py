"""A job's noise over time, and its events. Limited to a few kilobytes, however long the job is."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, Self

from service.scheduling.jobs.job_log import JobLog

__all__ = ["History"]

MAX_POINTS = 128
MAX_EVENTS = 100  # the latest are kept, and the first
POINT_SPACING = 1.04  # factor of samples between points
SENTENCES = {
    "begun": "rendering begins on workers of {}",
    "taken": "starts from the samples of job {}",
    "picture": "every tile has a sample",
    "worker": "{} renders it",
    "left": "{} has left",
    "paused": "paused",
    "resumed": "goes on",
    "lost": "a batch of {} was lost, and is dispatched again",
    "distrusted": "{} is excluded: its results are rendered again",
    "failed": "a batch failed, and is dispatched again: {}",
}


class History:
    """History of a job: points (seconds of rendering, samples, noise or None) and events (Unix time, kind, text).

    Written by the engine's thread.
    """

    def __init__(self, points: list[list[float | None]] | None = None, events: list[list[Any]] | None = None) -> None:
        self.points = points or []
        self.events = events or []
        self.has_changed = False
        self.log = JobLog()
        self._workers: set[str] = set()
        for _, kind, detail in self.events:
            if kind == "worker":
                self._workers.add(detail)
            elif kind == "left":
                self._workers.discard(detail)

    @classmethod
    def parse(cls, data: Mapping[str, Any] | None) -> Self:
        """Parses the stored JSON of a job's row. Returns an empty history if it is invalid."""
        try:
            points = [[float(s), float(n), None if e is None else float(e)] for s, n, e in (data or {}).get("points", [])]
            events = [[float(at), str(kind), str(detail)] for at, kind, detail in (data or {}).get("events", [])]
        except (TypeError, ValueError, AttributeError):
            return cls()
        return cls(points, events)

    def to_json(self) -> dict[str, Any]:
        """Returns the history as JSON for the job's row."""
        return {"points": self.points, "events": self.events}

    def add_point(self, seconds: float, samples: int, noise: float | None, is_end: bool = False) -> None:
        """Adds a point if the samples have grown by the factor `POINT_SPACING` since the latest point.

        seconds: rendering time. is_end: whether to add the point even if the samples have grown by less.
        """
        last = self.points[-1] if self.points else None
        has = (last[1] or 0) if last is not None else 0
        if samples <= has or (samples < POINT_SPACING * has and not is_end):
            return
        if len(self.points) >= MAX_POINTS:
            del self.points[1::2]  # the axes are logarithmic, so early points stay dense enough
        self.points.append([round(seconds, 3), float(samples), noise])
        self.has_changed = True

    def add_event(self, kind: str, detail: str = "") -> None:
        """Adds an event with the current time, and logs it. An event equal to the latest one is only logged.

        kind: a key of `SENTENCES`. detail: text inserted into the sentence, such as a worker's name.
        """
        self.log.add_line(SENTENCES.get(kind, kind).format(detail or "an unknown user"))
        if self.events and self.events[-1][1:] == [kind, detail]:
            return
        if len(self.events) >= MAX_EVENTS:
            del self.events[1]
        self.events.append([round(time.time(), 2), kind, detail])
        self.has_changed = True

    def rendered_by(self, worker: str) -> None:
        """Adds an event if this is the first batch that the worker has rendered for the job."""
        if worker not in self._workers:
            self._workers.add(worker)
            self.add_event("worker", worker)

    def record_departures(self, workers: set[str]) -> None:
        """Adds an event for each worker that rendered for the job and is not in `workers`, the names of the connected ones."""
        for gone in sorted(self._workers - workers):
            self._workers.discard(gone)
            self.add_event("left", gone)
