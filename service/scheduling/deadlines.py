"""Whether jobs are expected to be ready when they are wanted.

The forecast is what the job's page shows as left (ActiveJob.eta_s): what is missing at the speed of now. Of a job that is not
being rendered it is what all slots would take for it alone, by what a sample cost there or in the scene's latest picture: less
than that it cannot take. It knows nothing of what will come before the job, nor of machines that come and go.

A job is late once the forecast has said so for some seconds, or its deadline has passed; and it is not any more once the forecast
has said so for as long. One that is late goes before the others of its priority and share (shares.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

from service.scheduling.active_job import ActiveJob

__all__ = ["Deadlines", "Recorded", "least_s", "outlook"]

SURE_AFTER_S = 5.0  # the first figures of a job that begins are those of kernels being compiled
RECORDS_EVERY_S = 5.0


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

    def review(self, jobs: list[ActiveJob], slots: int, now: float) -> None:
        """Once a second. slots: that there are. now: unix time."""
        for job in jobs:
            if job.deadline is None:
                job.expected, job.urgency = None, math.inf
                continue
            job.expected = outlook(job, slots, now)
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


def outlook(job: ActiveJob, slots: int, now: float) -> float | None:
    """When a job is expected to be ready, in unix time; None where that is not known."""
    if job.done:
        return now
    least = least_s(job, slots)
    left = job.eta_s if job.state == "running" and job.samples_per_s > 0.0 else least
    return None if left is None else now + left


def least_s(job: ActiveJob, slots: int) -> float | None:
    """What so many slots take for what is missing, if they do nothing else; None where it is not known what a sample costs."""
    cost = job.sample_s
    usable = min(slots, job.max_slots or slots)
    if cost <= 0.0 or usable <= 0:
        return None
    return max(job.target_samples - job.samples, 0) * cost / usable
