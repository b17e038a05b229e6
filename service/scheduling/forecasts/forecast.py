"""Expected completion time of a job, from its remaining work, the jobs served before it, and the available slots.

The model follows the order of service (shares.py): all work of higher priorities comes first; jobs of one priority share the
slots by the weights of their shares; jobs within a share get equal parts, except that late ones go first. As slots are never
idle while there is work, the time follows in closed form, as for generalized processor sharing (Parekh and Gallager 1993). When
a share has received d slot-seconds, its virtual time is v = d / weight, and every other share has received min(its work, v *
its weight). When a job has received its work w, each other job of its share has received min(w, its own work).

The forecast is pessimistic: slots left over by the limits of other jobs are not counted. It ignores machines that connect and
disconnect, future jobs, jobs that wait for others, and jobs of unknown cost per sample. While there is a job of unknown cost,
the forecast is at least the time that follows from the current speed.
"""

from __future__ import annotations

import time
from bisect import bisect_right
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Protocol

from renderer.sentences import Sentence
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.shares import Shares

__all__ = ["Forecast", "Forecaster", "QueuedJobs", "RemainingWork"]

UPDATE_EVERY_S = 1.0
VALIDITY_FACTOR = 20  # validity of a computation, as a multiple of its duration

NO_SLOTS = Sentence("forecast-without-worker", "No worker is available to render it.")
SPEED_UNKNOWN = Sentence("forecast-speed-unknown", "Its rendering speed is not known yet.")


@dataclass(frozen=True)
class Forecast:
    """Forecast of a job. at: Unix time of completion; None without a forecast. reason: why there is none, as a sentence."""

    at: float | None
    reason: str | None = None


class QueuedJobs(Protocol):
    """Interface of the job queue, as far as forecasts need it. Implemented by service/scheduling/dispatching/job_queue.py."""

    def kind_for(self, job: ActiveJob) -> str | None:
        """Returns the worker kind that renders a job; None if there is none."""

    def by_priority(self, kind: str) -> Mapping[int, list[ActiveJob]]:
        """Returns the jobs that workers of this kind may render, by priority."""

    def slots_for(self, job: ActiveJob) -> int:
        """Returns the number of slots that accept batches of a job."""


@dataclass
class _Share:
    """Remaining work of the jobs of one share (user or project) at one priority.

    works: remaining slot-seconds of each job that is not late, sorted. sums: prefix sums of `works`.
    """

    works: list[float] = field(default_factory=list)
    sums: list[float] = field(default_factory=lambda: [0.0])
    urgent: dict[str, tuple[float, float]] = field(default_factory=dict)  # late jobs: deadline and work, by id

    def close(self) -> None:
        """Sorts the work of the jobs and computes the prefix sums. Call it once all jobs were added."""
        self.works.sort()
        self.sums = [0.0, *accumulate(self.works)]

    @property
    def total_work(self) -> float:
        """Remaining slot-seconds of all jobs of the share together."""
        return self.sums[-1] + sum(work for _, work in self.urgent.values())

    def served_until(self, job: ActiveJob, work: float) -> float:
        """Returns how many slot-seconds the share has received when one of its jobs has received `work` slot-seconds.

        A late job is treated like the others. Otherwise its precedence would make its forecast timely, so that it is no longer
        late, loses its precedence, and becomes late again.
        """
        first = sum(done for id, (urgency, done) in self.urgent.items() if id != job.id and urgency <= job.urgency)
        later = [done for id, (urgency, done) in self.urgent.items() if id != job.id and urgency > job.urgency]
        at = bisect_right(self.works, work)
        others = self.sums[at] + work * (len(self.works) - at) + sum(min(each, work) for each in later)
        return first + others + (work if job.id in self.urgent else 0.0)


class RemainingWork:
    """Remaining work of all jobs that workers of one kind render, by priority and share."""

    def __init__(self, jobs_by_priority: Mapping[int, Iterable[ActiveJob]], shares: Shares, slots: int) -> None:
        """Sums up the remaining work of jobs, given by priority, for each priority and share (user or project).

        slots: number of slots available to these jobs.
        """
        self._shares = shares
        self._of: dict[int, dict[str, _Share]] = {}
        self.is_known = True  # whether the work of all jobs is known
        self.jobs = 0
        for priority, jobs in jobs_by_priority.items():
            found = self._of.setdefault(priority, {})
            for job in jobs:
                if job.is_done:
                    continue
                self.jobs += 1
                share = found.setdefault(job.share, _Share())
                work = remaining_work_s(job, slots)
                self.is_known &= work is not None
                if job.is_late:
                    share.urgent[job.id] = job.urgency, work or 0.0
                else:
                    share.works.append(work or 0.0)
            for share in found.values():
                share.close()
        self._totals = {p: sum(share.total_work for share in found.values()) for p, found in self._of.items()}

    def seconds(self, job: ActiveJob, work: float, slots: int) -> float:
        """Returns the time, in seconds, until a job has received `work` slot-seconds.

        slots: number of slots available to all jobs.
        """
        before = sum(total for priority, total in self._totals.items() if priority > job.priority)
        equals = self._of.get(job.priority, {})
        if (own := equals.get(job.share)) is None:
            return (before + work) / slots
        had = own.served_until(job, work)
        terms = self._shares.terms_of(job.share)
        clock = had / terms.weight
        others = sum(
            min(share.total_work, clock * self._shares.terms_of(name).weight)
            for name, share in equals.items()
            if name != job.share
        )
        return max((before + others + had) / slots, had / min(terms.max_slots or slots, slots))


class Forecaster:
    """Computes forecasts of jobs. Used only by the engine's thread."""

    def __init__(self, queued_jobs: QueuedJobs, shares: Shares) -> None:
        self._queued_jobs = queued_jobs
        self._shares = shares
        self._crowds: dict[str, tuple[float, RemainingWork]] = {}  # by kind: end of validity, crowd

    def forecast(self, job: ActiveJob, now: float) -> Forecast:
        """Returns the forecast of a job. now: Unix time. For a paused job, assumes that it resumes now and runs alone."""
        if job.is_done:
            return Forecast(now)
        slots = self._queued_jobs.slots_for(job)
        if slots <= 0:
            return Forecast(None, NO_SLOTS)
        work = remaining_work_s(job, slots)
        most = [each for each in (job.max_slots, self._shares.terms_of(job.share).max_slots) if each is not None]
        alone = None if work is None else work / min([slots, *most])
        measured = job.eta_s if job.state == "running" and job.samples_per_s > 0.0 else alone
        if measured is None:
            return Forecast(None, SPEED_UNKNOWN)
        if work is None or alone is None or job.state == "paused":
            return Forecast(now + measured)
        crowd = self._remaining_work(self._queued_jobs.kind_for(job) or "", slots)
        if crowd.jobs <= 1:
            return Forecast(now + measured)
        left = max(crowd.seconds(job, work, slots), alone)
        return Forecast(now + (left if crowd.is_known else max(left, measured)))

    def _remaining_work(self, kind: str, slots: int) -> RemainingWork:
        until, crowd = self._crowds.get(kind, (0.0, None))
        begins = time.monotonic()
        if crowd is None or begins > until:
            crowd = RemainingWork(self._queued_jobs.by_priority(kind), self._shares, slots)
            ends = time.monotonic()
            self._crowds[kind] = ends + max(UPDATE_EVERY_S, VALIDITY_FACTOR * (ends - begins)), crowd
        return crowd


def remaining_work_s(job: ActiveJob, slots: int) -> float | None:
    """Returns the remaining work of a job in slot-seconds; None if its cost per sample is unknown.

    slots: number of slots that render it.
    """
    cost = job.sample_s
    if cost <= 0.0:
        return None
    work = max(job.target_samples - job.samples, 0) * cost
    return work if job.seconds is None else min(work, max(job.seconds - job.active_s, 0.0) * slots)
