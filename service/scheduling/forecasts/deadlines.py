"""Whether jobs are expected to be ready by their deadlines.

A job's forecast (forecast.py) covers what it still lacks, what a sample costs, and the jobs that are served before it.

A job is late once the forecast has said so for some seconds, or its deadline has passed; it is no longer late once the forecast
has said so for as long. A late job goes before the others of its priority and share (shares.py).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Protocol

from service.scheduling.forecasts.forecast import Forecast
from service.scheduling.jobs.active_job import ActiveJob

__all__ = ["Deadlines", "Recorded"]

SURE_AFTER_S = 5.0  # the first figures of a job that begins are those of kernels being compiled
RECORDS_EVERY_S = 5.0
RESTS = 20  # times as long as a review takes, until the next: ten thousand deadlines must not hold the engine


Run = Callable[[str, Callable[[], object]], bool]


class Recorded(Protocol):
    """What is needed of the database: service/scheduling/records.py."""

    def late(self, id: str, since: float | None) -> bool:
        """Write down since when a job is late; None: it is not."""

    def overdue(self, now: float) -> list[str]:
        """The jobs whose deadline has passed and that are not known to be late."""


class Deadlines:
    """Lives in the engine's thread."""

    def __init__(
        self, records: Recorded, run: Callable[[str, Callable[[], object]], bool], tell: Callable[[str, str], None]
    ) -> None:
        """run: takes a step of a job that needs the database; False where that has to wait."""
        self._records = records
        self._run = run
        self._tell = tell
        self._since: dict[str, float] = {}  # since when the forecast says the other of what is known of a job
        self._looked = -math.inf
        self._rests_until = -math.inf
        self._now = -math.inf

    def review(self, jobs: list[ActiveJob], forecast: Callable[[ActiveJob, float], Forecast], now: float) -> None:
        """Once a second. forecast: of a job, at a moment. now: unix time."""
        if now < self._now:  # the clock was put back
            self._since.clear()
            self._looked = self._rests_until = -math.inf
        self._now = now
        if now < self._rests_until:
            return
        begins = time.perf_counter()
        self._review(jobs, forecast, now)
        self._rests_until = now + RESTS * (time.perf_counter() - begins) if len(jobs) > 1 else -math.inf

    def _review(self, jobs: list[ActiveJob], forecast: Callable[[ActiveJob, float], Forecast], now: float) -> None:
        for job in jobs:
            if job.deadline is None:
                job.expected, job.unforeseen, job.urgency = None, None, math.inf
                continue
            found = forecast(job, now)
            job.expected, job.unforeseen = found.at, found.why
            if (changed := self._turned(job, now)) is not None:
                self._run(job.id, lambda job=job, late=changed: self._note(job, late, now))  # type: ignore[misc]
        if now - self._looked >= RECORDS_EVERY_S:
            self._looked = now
            known = {job.id: job for job in jobs}
            self._run("deadlines", lambda: self._note_overdue(known, now))
        for id in self._since.keys() - {job.id for job in jobs}:
            del self._since[id]

    def _turned(self, job: ActiveJob, now: float) -> bool | None:
        """Whether a job is late now, where that is news."""
        assert job.deadline is not None
        if now > job.deadline:
            return None if job.is_late else True
        says_late = job.expected is not None and job.expected > job.deadline
        if says_late == job.is_late:
            self._since.pop(job.id, None)
            return None
        return says_late if now - self._since.setdefault(job.id, now) >= SURE_AFTER_S else None

    def _note(self, job: ActiveJob, is_late: bool, now: float) -> None:
        if not self._records.late(job.id, now if is_late else None):
            return
        self._since.pop(job.id, None)
        job.urgency = job.deadline if is_late and job.deadline is not None else math.inf
        job.history.happened("late" if is_late else "in-time")
        job.history.log.say("is expected after its deadline" if is_late else "is expected by its deadline again")
        self._tell("job", job.id)

    def _note_overdue(self, known: dict[str, ActiveJob], now: float) -> None:
        """Those that wait, for a scene or for others, are nobody's to look at."""
        for id in self._records.overdue(now):
            if id not in known and self._records.late(id, now):
                self._tell("job", id)
