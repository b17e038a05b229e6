"""Tests of the forecast completion times of jobs.

For concurrent jobs, the closed-form forecast is compared with a simulation of fair sharing.
"""

from __future__ import annotations

import math
import random
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, cast

import pytest

from service.scheduling.forecasts.forecast import NO_SLOTS, SPEED_UNKNOWN, Forecast, Forecaster
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.shares import EVERYBODY, Shares, Terms

NOW = 1000.0


@dataclass
class Job:
    """A simulated job. work: remaining slot-seconds."""

    id: str = "job"
    work: float = 100.0
    priority: int = 0
    share: str = EVERYBODY
    urgency: float = math.inf
    state: str = "queued"
    samples_per_s: float = 0.0
    eta_s: float | None = None
    max_slots: int | None = None
    sample_s: float = 0.01
    samples: int = 0
    is_done: bool = False
    seconds: float | None = None
    active_s: float = 0.0
    served: int = 0
    created: float = 0.0

    @property
    def target_samples(self) -> float:
        return self.work / (self.sample_s or 0.01)

    @property
    def is_late(self) -> bool:
        return self.urgency < math.inf


@dataclass
class Lines:
    jobs: list[Job]
    slots: int = 4
    found: dict[int, list[Job]] = field(default_factory=dict)

    def kind_for(self, job: Any) -> str | None:
        return "kind"

    def slots_for(self, job: Any) -> int:
        return self.slots

    def by_priority(self, kind: str) -> Mapping[int, list[Any]]:
        found: dict[int, list[Any]] = {}
        for job in self.jobs:
            found.setdefault(job.priority, []).append(job)
        return found


def expected(job: Job, *others: Job, slots: int = 4, terms: Mapping[str, Terms] | None = None) -> float | None:
    shares = Shares()
    shares.terms = terms or {}
    found = Forecaster(cast(Any, Lines([job, *others], slots)), shares).forecast(cast(ActiveJob, job), NOW)
    return None if found.at is None else found.at - NOW


@pytest.mark.parametrize(
    ("job", "left"),
    [
        (Job(), 25.0),
        (Job(max_slots=1), 100.0),
        (Job(state="running", samples_per_s=1.0, eta_s=33.0), 33.0),
        (Job(state="running", samples_per_s=1.0, eta_s=33.0, sample_s=0.0), 33.0),
        (Job(state="paused"), 25.0),
        (Job(is_done=True), 0.0),
        (Job(seconds=15.0, active_s=5.0), 10.0),
    ],
)
def test_single_job_forecast_uses_current_speed(job: Job, left: float) -> None:
    assert expected(job) == pytest.approx(left)


def test_missing_forecast_has_reason() -> None:
    forecaster = Forecaster(cast(Any, Lines([], 0)), Shares())
    resting = Job(state="running", samples_per_s=1e-9, eta_s=1e10)
    assert forecaster.forecast(cast(ActiveJob, resting), NOW) == Forecast(None, NO_SLOTS)
    assert Forecaster(cast(Any, Lines([])), Shares()).forecast(cast(ActiveJob, Job(sample_s=0.0)), NOW) == Forecast(
        None, SPEED_UNKNOWN
    )


@pytest.mark.parametrize(
    ("others", "left"),
    [
        ([Job("urgent", 400, priority=1)], 125.0),
        ([Job("idle", 4000, priority=-1)], 25.0),
        ([Job("equal", 100)], 50.0),
        ([Job("short", 40), Job("long", 1000)], 60.0),
        ([Job("late", 400, urgency=5.0)], 125.0),
        ([Job("anna", 1000, share="user:anna")], 50.0),
        ([Job("anna", 30, share="user:anna")], 32.5),
        ([Job("unknown", 1000, sample_s=0.0)], 50.0),
        ([Job("over", 1000, is_done=True)], 25.0),
        ([Job("timed", 1000, priority=1, seconds=10.0)], 35.0),
    ],
)
def test_earlier_jobs_delay_forecast(others: list[Job], left: float) -> None:
    if others[0].sample_s == 0.0:  # the minimum, at the current speed
        assert expected(Job(state="running", samples_per_s=1.0, eta_s=50.0), *others) == pytest.approx(left)
        return
    assert expected(Job(), *others) == pytest.approx(left)


def test_forecast_respects_share_weights_and_limits() -> None:
    job = Job(share="user:ben")
    anna = Job("anna", 1000, share="user:anna")
    assert expected(job, anna, terms={"user:ben": Terms(3.0)}) == pytest.approx(100 / 3)
    assert expected(job, anna, terms={"user:anna": Terms(3.0)}) == pytest.approx(100.0)
    assert expected(job, terms={"user:ben": Terms(1.0, 2)}) == pytest.approx(50.0)
    assert expected(job, anna, terms={"user:ben": Terms(1.0, 1)}) == pytest.approx(100.0)


def test_late_job_forecast_ignores_its_precedence() -> None:
    """Checks that the forecast of a late job ignores the precedence that the job gets for being late.

    Otherwise the job would alternate between late and not late.
    """
    other = Job("other", 1000)
    assert expected(Job(), other) == expected(Job(urgency=5.0), other)


@pytest.mark.parametrize("seed", range(4))
def test_forecast_equals_simulated_sharing(seed: int) -> None:
    rng = random.Random(seed)
    shares = [f"user:{name}" for name in "abc"]
    jobs = [Job(str(i), rng.uniform(20, 200), rng.choice((0, 0, 1)), rng.choice(shares), created=i) for i in range(12)]
    terms = {share: Terms(rng.choice((1.0, 2.0, 4.0))) for share in shares}
    told = {job.id: expected(job, *(each for each in jobs if each is not job), slots=3, terms=terms) for job in jobs}
    ended = simulated_completion(jobs, 3, terms)
    for job in jobs:
        assert told[job.id] == pytest.approx(ended[job.id], rel=0.1, abs=6.0), (job, ended)


def simulated_completion(jobs: list[Job], slots: int, terms: Mapping[str, Terms]) -> dict[str, float]:
    """Returns the completion time of each job by id, simulated with the scheduler's sharing rule and batches of 0.5 s.

    terms: weight and limit of each share, by name.
    """
    step, left, ended = 0.5, {job.id: job.work for job in jobs}, dict[str, float]()
    shares, now, turn = Shares(), 0.0, 0
    shares.terms = terms
    at_work: set[str] = set()  # shares that got something; others return from a pause
    while left:
        line = [job for job in jobs if job.id in left]
        top = [job for job in line if job.priority == max(each.priority for each in line)]
        queue = shares.queue_of("kind", top, Counter[str](), Counter({job.share: 1 for job in top if job.share in at_work}))
        at_work = {job.share for job in top}
        for _ in range(slots):
            if (job := queue.next_job()) is None:
                break
            turn += 1
            job.served = turn
            queue.record_served(job, 1, step)
            left[job.id] -= step
        now += step
        for id in [id for id, work in left.items() if work <= 0]:
            ended[id] = now
            del left[id]
    return ended
