"""Tests of when a job becomes late for its deadline, and when it stops being late."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, cast
from unittest.mock import MagicMock

from service.scheduling.forecasts.deadlines import RELIABLE_AFTER_S, Deadlines
from service.scheduling.forecasts.forecast import Forecast
from service.scheduling.jobs.active_job import ActiveJob


@dataclass
class Job:
    id: str = "job"
    deadline: float | None = 100.0
    expected: float | None = None
    unforeseen: str | None = None
    urgency: float = math.inf
    eta_s: float | None = 10.0
    history: Any = field(default_factory=MagicMock)

    @property
    def is_late(self) -> bool:
        return self.urgency < math.inf


@dataclass
class Records:
    lates: list[tuple[str, float | None]] = field(default_factory=list)
    past: list[str] = field(default_factory=list)
    is_there: bool = True

    def store_lateness(self, id: str, since: float | None) -> bool:
        self.lates.append((id, since))
        return self.is_there

    def find_overdue(self, now: float) -> list[str]:
        return self.past


def run(id: str, action: Callable[[], object]) -> bool:
    action()
    return True


def update_deadlines(deadlines: Deadlines, job: Job, *times: float) -> None:
    for now in times:
        deadlines.update([cast(ActiveJob, job)], forecast, now)


def forecast(job: ActiveJob, now: float) -> Forecast:
    return Forecast(None, "Nobody knows.") if job.eta_s is None else Forecast(now + job.eta_s)


def test_lateness_changes_only_after_some_seconds() -> None:
    told: list[tuple[str, str]] = []
    records, job = Records(), Job(eta_s=200.0)
    deadlines = Deadlines(records, run, lambda what, id: told.append((what, id)))
    update_deadlines(deadlines, job, 0, 1, 2)
    job.eta_s = 50.0
    update_deadlines(deadlines, job, 3)
    job.eta_s = 200.0
    update_deadlines(deadlines, job, 4, 5, 6, 7, 8)
    assert (records.lates, job.is_late, job.expected) == ([], False, 208.0)
    update_deadlines(deadlines, job, 4 + RELIABLE_AFTER_S)
    assert (records.lates, job.urgency, told) == ([("job", 9.0)], 100.0, [("job", "job")])
    job.eta_s = 1.0
    update_deadlines(deadlines, job, 10, 11, 12, 13, 14)
    assert job.is_late
    update_deadlines(deadlines, job, 15)
    assert (records.lates[1:], job.urgency) == ([("job", None)], math.inf)
    assert [call.args[0] for call in job.history.add_event.call_args_list] == ["late", "in-time"]
    update_deadlines(deadlines, job, 101)
    assert job.is_late, "its deadline has passed, whatever the forecast says"


def test_waiting_job_is_late_after_deadline() -> None:
    records = Records(past=["waits"])
    told: list[str] = []
    Deadlines(records, run, lambda _, id: told.append(id)).update([], forecast, 1000.0)
    assert (records.lates, told) == ([("waits", 1000.0)], ["waits"])


def test_jobs_without_deadline_or_deleted_are_ignored() -> None:
    records, job = Records(), Job(deadline=None)
    update_deadlines(Deadlines(records, run, lambda *_: None), job, 0, 10)
    assert (records.lates, job.expected) == ([], None)
    gone = Job(deadline=5.0)
    records.is_there = False
    update_deadlines(Deadlines(records, run, lambda *_: None), gone, 10)
    assert not gone.is_late


def test_job_without_forecast_has_reason_and_is_not_late() -> None:
    records, job = Records(), Job(eta_s=None, deadline=1000.0)
    update_deadlines(Deadlines(records, run, lambda *_: None), job, 0, 10, 20)
    assert (records.lates, job.expected, job.unforeseen) == ([], None, "Nobody knows.")


def test_clock_set_back_takes_effect_at_once() -> None:
    records, job, other = Records(past=["waiting"]), Job(deadline=5000.0), Job(id="other", deadline=5000.0)
    deadlines = Deadlines(records, run, lambda what, id: None)
    for now in (9000.0, 4000.0):
        deadlines.update([cast(ActiveJob, job), cast(ActiveJob, other)], forecast, now)
    assert job.expected == 4010.0
    assert [each for each in records.lates if each[0] == "waiting"] == [("waiting", 9000.0), ("waiting", 4000.0)]
