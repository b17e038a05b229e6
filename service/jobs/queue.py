"""Stores and describes the dependencies, deadlines and worker requirements of jobs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from renderer.sentences import Sentence
from service.errors import Conflict, NotFound
from service.intake.projects import may_be_used_in
from service.models.queue import WaitOut
from service.scheduling.fleet.needs import Needs
from service.store.models import ACTIVE_STATES, Job, Wait

__all__ = ["add_dependencies", "needs_of", "reduce_dependencies", "waits_of", "waits_sentence", "warning_of"]

MAX_IDS_PER_QUERY = 500  # jobs in one query
MAX_LISTED = 3
DAY_S, HOUR_S, MINUTE_S = 86400.0, 3600.0, 60.0


def needs_of(texts: Sequence[str]) -> dict[str, Any] | None:
    """Parses worker requirements to the form stored in a job's row; None if there are none."""
    needs = Needs.parse(texts)
    return None if needs is None else needs.to_json()


def warning_of(job: Job, expected: float | None, now: float) -> str | None:
    """Returns a warning that an unfinished job is late, and by how much; None if it is on time.

    expected: Unix time at which it is expected to finish.
    """
    if job.deadline is None or job.late is None or job.state not in ACTIVE_STATES:
        return None
    if now > job.deadline:
        return Sentence("deadline-passed", "Its deadline passed {time} ago.", time=_rounded_duration(now - job.deadline))
    if expected is None or expected <= job.deadline:
        return Sentence("deadline-at-risk", "It is expected to finish after its deadline.")
    return Sentence(
        "deadline-at-risk-by",
        "It is expected to finish {time} after its deadline.",
        time=_rounded_duration(expected - job.deadline),
    )


def add_dependencies(job: Job, after: Sequence[str], session: Session) -> None:
    """Makes a new job wait for the jobs in `after`, except finished ones. Raises NotFound and Conflict.

    A dependency must be in the same project or in none, so that everyone who sees the job also sees its dependencies.
    """
    for id in dict.fromkeys(after):
        other = session.get(Job, id)
        if other is None or not may_be_used_in(other.project, job.project):
            raise NotFound(
                Sentence("after-job-not-found", "after: there is no job {id}. Choose an existing job.", id=repr(id[:60]))
            )
        if other.state in ACTIVE_STATES:
            session.add(Wait(job=job.id, other=id))
        elif other.state != "finished":
            raise Conflict(
                Sentence(
                    "after-job-ended",
                    "after: the job {id} ({name}) has {state}. Choose an unfinished job.",
                    id=id,
                    name=other.name,
                    state=_ended_phrase(other.state),
                )
            )


def reduce_dependencies(id: str, after: Sequence[str], session: Session) -> None:
    """Removes all dependencies of a job except those in `after`. Raises Conflict if `after` contains others."""
    waits = {wait.other: wait for wait in session.scalars(select(Wait).where(Wait.job == id))}
    unknown = [other for other in after if other not in waits]
    if unknown:  # a new dependency on an existing job could create a cycle
        raise Conflict(
            Sentence(
                "after-job-not-removable",
                "after: the job does not wait for {jobs}. Dependencies of an existing job can only be removed.",
                jobs=repr(unknown[0][:60]),
            )
        )
    for other, wait in waits.items():
        if other not in after:
            session.delete(wait)


def waits_of(jobs: Iterable[Job], session: Session) -> dict[str, list[WaitOut]]:
    """Returns for each job the jobs that it waits for, by job id."""
    ids = [job.id for job in jobs if job.state in ACTIVE_STATES and job.request.get("after")]
    found: dict[str, list[WaitOut]] = {}
    for at in range(0, len(ids), MAX_IDS_PER_QUERY):
        query = select(Wait.job, Wait.other, Job.name, Job.state).join(Job, Job.id == Wait.other, isouter=True)
        query = query.where(Wait.job.in_(ids[at : at + MAX_IDS_PER_QUERY])).order_by(Wait.job, Job.created)
        for job, other, name, state in session.execute(query):
            found.setdefault(job, []).append(WaitOut(id=other, name=name, state=state))
    return found


def waits_sentence(waits: Sequence[WaitOut]) -> str | None:
    """Returns a sentence about the unfinished jobs that a job waits for; None if there are none."""
    if not waits:
        return None
    named = [f'"{wait.name}"' if wait.name else wait.id for wait in waits[:MAX_LISTED]]
    if len(waits) == 1:
        return Sentence("job-waits-for-job", "Waits until {job} is finished.", job=named[0])
    if len(waits) <= MAX_LISTED:
        return Sentence("job-waits-for-jobs", "Waits until {jobs} are finished.", jobs=named)
    return Sentence(
        "job-waits-for-many-jobs", "Waits until {jobs} and {more} more are finished.", jobs=named, more=len(waits) - MAX_LISTED
    )


def _rounded_duration(seconds: float) -> str:
    if seconds >= 1.5 * DAY_S:
        return Sentence("duration-days", "{count} days", count=round(seconds / DAY_S))
    if seconds >= 1.5 * HOUR_S:
        return Sentence("duration-hours", "{count} hours", count=round(seconds / HOUR_S))
    if seconds >= 1.5 * MINUTE_S:
        return Sentence("duration-minutes", "{count} minutes", count=round(seconds / MINUTE_S))
    if seconds >= 45:
        return Sentence("duration-one-minute", "a minute")
    return Sentence("duration-seconds", "{count} s", count=round(max(seconds, 1.0)))


def _ended_phrase(state: str) -> str:
    if state == "cancelled":
        return Sentence("job-state-cancelled", "been cancelled")
    return Sentence("job-state-failed", "failed")
