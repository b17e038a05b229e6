"""Detects late jobs: those that are not expected to finish by their deadline.

A job's forecast (forecast.py) takes into account its remaining work, its cost per sample, and the jobs served before it.

A job becomes late if its forecast has exceeded the deadline for some seconds, or if the deadline has passed. It stops being
late once the forecast has been before the deadline for as long. A late job is served before others of its priority and share
(shares.py).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Protocol

from service.events import ItemKind
from service.scheduling.forecasts.forecast import Forecast
from service.scheduling.jobs.active_job import ActiveJob

__all__ = ["DeadlineRecords", "Deadlines"]

RELIABLE_AFTER_S = 5.0  # the first forecasts of a job are distorted by kernel compilation
RECORDS_EVERY_S = 5.0
PAUSE_FACTOR = 20  # minimum interval of reviews, as a multiple of their duration


RunStep = Callable[[str, Callable[[], object]], bool]


class DeadlineRecords(Protocol):
    """Interface of the required database operations, which service/scheduling/records.py implements."""

    def store_lateness(self, id: str, since: float | None) -> bool:
        """Stores the Unix time since which a job is late; None if it is not late.

        Returns False if the job has ended or is deleted.
        """

    def find_overdue(self, now: float) -> list[str]:
        """Returns the ids of the jobs whose deadline has passed and that are not stored as late. now: Unix time."""


class Deadlines:
    """Detects late jobs. Used only by the engine's thread."""

    def __init__(
        self,
        records: DeadlineRecords,
        run: Callable[[str, Callable[[], object]], bool],
        record_change: Callable[[ItemKind, str], None],
    ) -> None:
        """Stores the parameters.

        run: runs a step that needs the database; returns False if the step has to wait. record_change: records a job's change,
        to be published with the next snapshot.
        """
        self._records = records
        self._run = run
        self._record_change = record_change
        self._since: dict[str, float] = {}  # by job: since when its forecast contradicts its known state
        self._last_recorded = -math.inf
        self._next_update = -math.inf
        self._now = -math.inf

    def update(self, jobs: list[ActiveJob], forecast: Callable[[ActiveJob, float], Forecast], now: float) -> None:
        """Updates the expected completion time of each job, and whether it is late. Called once a second.

        forecast: returns the forecast of a job at a Unix time. now: Unix time.
        """
        if now < self._now:  # the clock was set back
            self._since.clear()
            self._last_recorded = self._next_update = -math.inf
        self._now = now
        if now < self._next_update:
            return
        begins = time.perf_counter()
        self._update_jobs(jobs, forecast, now)
        self._next_update = now + PAUSE_FACTOR * (time.perf_counter() - begins) if len(jobs) > 1 else -math.inf

    def _update_jobs(self, jobs: list[ActiveJob], forecast: Callable[[ActiveJob, float], Forecast], now: float) -> None:
        for job in jobs:
            if job.deadline is None:
                job.expected, job.unforeseen, job.urgency = None, None, math.inf
                continue
            found = forecast(job, now)
            job.expected, job.unforeseen = found.at, found.reason
            if (changed := self._changed_lateness(job, now)) is not None:
                self._run(job.id, lambda job=job, late=changed: self._log_change(job, late, now))  # type: ignore[misc]
        if now - self._last_recorded >= RECORDS_EVERY_S:
            self._last_recorded = now
            known = {job.id: job for job in jobs}
            self._run("deadlines", lambda: self._record_overdue(known, now))
        for id in self._since.keys() - {job.id for job in jobs}:
            del self._since[id]

    def _changed_lateness(self, job: ActiveJob, now: float) -> bool | None:
        """Returns True if a job has just become late, False if it has just stopped being late; None without a change."""
        assert job.deadline is not None
        if now > job.deadline:
            return None if job.is_late else True
        says_late = job.expected is not None and job.expected > job.deadline
        if says_late == job.is_late:
            self._since.pop(job.id, None)
            return None
        return says_late if now - self._since.setdefault(job.id, now) >= RELIABLE_AFTER_S else None

    def _log_change(self, job: ActiveJob, is_late: bool, now: float) -> None:
        if not self._records.store_lateness(job.id, now if is_late else None):
            return
        self._since.pop(job.id, None)
        job.urgency = job.deadline if is_late and job.deadline is not None else math.inf
        job.history.add_event("late" if is_late else "in-time")
        job.history.log.add_line("is expected after its deadline" if is_late else "is expected by its deadline again")
        self._record_change("job", job.id)

    def _record_overdue(self, active: dict[str, ActiveJob], now: float) -> None:
        """Marks overdue jobs as late that are not in `active`, such as those waiting for a scene or for other jobs."""
        for id in self._records.find_overdue(now):
            if id not in active and self._records.store_lateness(id, now):
                self._record_change("job", id)
