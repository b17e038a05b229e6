"""When a job is expected to be ready, from what it lacks, the jobs that come before it, and the available slots.

Other jobs count as they will be served (shares.py): all work of higher priorities comes first; jobs of one priority share the
slots by the weights of their shares, and jobs within a share equally, except that late ones go first. As slots never stand idle
while there is work, the time follows in closed form, as for generalized processor sharing (Parekh and Gallager 1993): when a
share has had `d` seconds of slots, its virtual time is d / weight, and every other share has had all of its work or as much as
its own weight gives it by then. A job has had its `w` when each other job of its share has had min(w, its own work).

The forecast is pessimistic: slots left over by the limits of others are not counted. It does not know about machines that come
and go, about future jobs or those waiting for others, nor about jobs whose cost per sample is unknown: while there is one of
these, the forecast is at least what the current speed says.
"""

from __future__ import annotations

import time
from bisect import bisect_right
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Protocol

from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.shares import Shares

__all__ = ["Crowd", "Forecast", "Forecaster", "Lines"]

RENEWED_EVERY_S = 1.0
RESTS = 20  # times as long as it takes to look at all jobs, that look holds

NO_SLOTS = "No worker that could render it takes work now."
NO_COST = "Nobody knows yet how long a sample of it takes."


@dataclass(frozen=True)
class Forecast:
    """at: in unix time; None: there is none, and why, as a sentence."""

    at: float | None
    why: str | None = None


class Lines(Protocol):
    """What is needed of service/scheduling/handing_out/line_up.py."""

    def kind_for(self, job: ActiveJob) -> str | None:
        """The kind of the workers that are to render a job."""

    def by_priority(self, kind: str) -> Mapping[int, list[ActiveJob]]:
        """The jobs that workers of a kind may render."""

    def slots_for(self, job: ActiveJob) -> int:
        """How many slots take batches of it."""


@dataclass
class _Share:
    """Of one priority. works: seconds of a slot that its jobs are still to have, sorted; sums: of the first n of them."""

    works: list[float] = field(default_factory=list)
    sums: list[float] = field(default_factory=lambda: [0.0])
    urgent: dict[str, tuple[float, float]] = field(default_factory=dict)  # urgency and work of those that are late, by id

    def close(self) -> None:
        """All are in."""
        self.works.sort()
        self.sums = [0.0, *accumulate(self.works)]

    @property
    def total(self) -> float:
        """Of all its jobs."""
        return self.sums[-1] + sum(work for _, work in self.urgent.values())

    def until(self, job: ActiveJob, work: float) -> float:
        """What the share has had when one of its jobs has had all of its own.

        Of a job that is late itself as of one that is not: else it would be in time for being late, and late for being in time.
        """
        first = sum(done for id, (urgency, done) in self.urgent.items() if id != job.id and urgency <= job.urgency)
        later = [done for id, (urgency, done) in self.urgent.items() if id != job.id and urgency > job.urgency]
        at = bisect_right(self.works, work)
        others = self.sums[at] + work * (len(self.works) - at) + sum(min(each, work) for each in later)
        return first + others + (work if job.id in self.urgent else 0.0)


class Crowd:
    """The jobs that workers of one kind render, by what they still take."""

    def __init__(self, lines: Mapping[int, Iterable[ActiveJob]], shares: Shares, slots: int) -> None:
        """slots: that there are for them."""
        self._shares = shares
        self._of: dict[int, dict[str, _Share]] = {}
        self.is_known = True  # what each of them takes
        self.jobs = 0
        for priority, jobs in lines.items():
            found = self._of.setdefault(priority, {})
            for job in jobs:
                if job.done:
                    continue
                self.jobs += 1
                share = found.setdefault(job.share, _Share())
                work = work_s(job, slots)
                self.is_known &= work is not None
                if job.is_late:
                    share.urgent[job.id] = job.urgency, work or 0.0
                else:
                    share.works.append(work or 0.0)
            for share in found.values():
                share.close()
        self._totals = {p: sum(share.total for share in found.values()) for p, found in self._of.items()}

    def seconds(self, job: ActiveJob, work: float, slots: int) -> float:
        """How long it takes so many slots until a job that is among these has had its work."""
        before = sum(total for priority, total in self._totals.items() if priority > job.priority)
        equals = self._of.get(job.priority, {})
        if (own := equals.get(job.share)) is None:
            return (before + work) / slots
        had = own.until(job, work)
        terms = self._shares.of(job.share)
        clock = had / terms.weight
        others = sum(
            min(share.total, clock * self._shares.of(name).weight) for name, share in equals.items() if name != job.share
        )
        return max((before + others + had) / slots, had / min(terms.max_slots or slots, slots))


class Forecaster:
    """Lives in the engine's thread."""

    def __init__(self, lines: Lines, shares: Shares) -> None:
        self._lines = lines
        self._shares = shares
        self._crowds: dict[str, tuple[float, Crowd]] = {}  # of a kind, and until when it holds

    def of(self, job: ActiveJob, now: float) -> Forecast:
        """now: unix time. Of a paused job: as if it went on alone."""
        if job.done:
            return Forecast(now)
        slots = self._lines.slots_for(job)
        if slots <= 0:
            return Forecast(None, NO_SLOTS)
        work = work_s(job, slots)
        most = [each for each in (job.max_slots, self._shares.of(job.share).max_slots) if each is not None]
        alone = None if work is None else work / min([slots, *most])
        measured = job.eta_s if job.state == "running" and job.samples_per_s > 0.0 else alone
        if measured is None:
            return Forecast(None, NO_COST)
        if work is None or alone is None or job.state == "paused":
            return Forecast(now + measured)
        crowd = self._crowd(self._lines.kind_for(job) or "", slots)
        if crowd.jobs <= 1:
            return Forecast(now + measured)
        left = max(crowd.seconds(job, work, slots), alone)
        return Forecast(now + (left if crowd.is_known else max(left, measured)))

    def _crowd(self, kind: str, slots: int) -> Crowd:
        until, crowd = self._crowds.get(kind, (0.0, None))
        begins = time.monotonic()
        if crowd is None or begins > until:
            crowd = Crowd(self._lines.by_priority(kind), self._shares, slots)
            ends = time.monotonic()
            self._crowds[kind] = ends + max(RENEWED_EVERY_S, RESTS * (ends - begins)), crowd
        return crowd


def work_s(job: ActiveJob, slots: int) -> float | None:
    """Seconds of a slot that a job still takes of so many; None where it is not known what a sample costs."""
    cost = job.sample_s
    if cost <= 0.0:
        return None
    work = max(job.target_samples - job.samples, 0) * cost
    return work if job.seconds is None else min(work, max(job.seconds - job.active_s, 0.0) * slots)
