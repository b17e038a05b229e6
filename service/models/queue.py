"""Queue fields of a job: its dependencies, deadline and requirements, and their state."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, Field
from sqlalchemy import select
from sqlalchemy.orm import Session

from service.clock import deadline_of
from service.errors import Conflict, NotFound
from service.intake.projects import serves
from service.models.strict import Strict
from service.scheduling.fleet.needs import Needs
from service.store.models import ACTIVE, Job, Wait

__all__ = [
    "QueueIn",
    "QueueOut",
    "QueuePatch",
    "WaitOut",
    "needs_of",
    "wait_for",
    "wait_for_fewer",
    "waits_of",
    "waits_sentence",
    "warning_of",
]

MOST_BEFORE = 1000
MOST_NAMED = 500  # jobs in one query
SHOWN = 3

JobIds = Annotated[list[Annotated[str, Field(max_length=100)]], Field(max_length=MOST_BEFORE)]


MaxSlots = Annotated[int | None, Field(ge=1, le=1_000_000, description="slots that render it at a time, at most; null: no limit")]


def _checked(text: str | None) -> str | None:
    if text is not None:
        deadline_of(text)
    return text


Deadline = Annotated[
    str | None,
    Field(
        max_length=60,
        description="by when it is wanted: an ISO time, or the next 08:00; of the service's zone where it names none",
    ),
    AfterValidator(_checked),
]


def _possible(texts: list[str]) -> list[str]:
    Needs.parse(texts)
    return texts


Wants = Annotated[
    list[Annotated[str, Field(max_length=100)]],
    Field(max_length=50, description="of the workers that render it: tags, as gpu, and memory_gb=32; [] for any worker"),
    AfterValidator(_possible),
]


class QueueIn(Strict):
    """Of a request for a picture."""

    after: JobIds = Field(
        [],
        description="ids of jobs: it begins when they are finished; where one fails, is cancelled or deleted, so does it fail",
    )

    max_slots: MaxSlots = None
    deadline: Deadline = None
    needs: Wants = Field([])


class QueuePatch(Strict):
    """Of what can change in a job."""

    max_slots: MaxSlots = None
    deadline: Deadline = None
    needs: Wants | None = None
    after: JobIds | None = Field(None, description="which of the jobs that it waits for it is to wait for on; []: none of them")


class WaitOut(BaseModel):
    """A job that another waits for."""

    id: str
    name: str | None = Field(description="null: it was deleted")
    state: str | None


class QueueOut(BaseModel):
    """Of a job."""

    after: list[str] = Field(description="ids of the jobs that it was to come after, as it was asked for")
    user: str | None = Field(description="who asked for it; null where the farm asks nobody who they are")
    max_slots: int | None = Field(description="that render it at a time, at most")
    needs: list[str] = Field(description="of the workers that render it")
    deadline: float | None = Field(description="by when it is wanted, in unix time")
    expected: float | None = Field(description="when it is to be ready by the forecast, where it has a deadline and is not over")
    unforeseen: str | None = Field(description="why there is no forecast, where it has a deadline and is not over, in a sentence")
    late: float | None = Field(description="since when it is expected to miss its deadline, or has missed it; null: it is not")
    warning: str | None = Field(description="what somebody may want to do something about, in a sentence")
    waits_for: list[WaitOut] = Field(description="those of them that are not finished")


def needs_of(texts: Sequence[str]) -> dict[str, Any] | None:
    """The requirements as stored in the job's row; None if there are none."""
    needs = Needs.parse(texts)
    return None if needs is None else needs.to_json()


def warning_of(job: Job, expected: float | None, now: float) -> str | None:
    """A warning that an unfinished job is late, and by how much; None if it is not."""
    if job.deadline is None or job.late is None or job.state not in ACTIVE:
        return None
    if now > job.deadline:
        return f"Its deadline passed {_roughly(now - job.deadline)} ago."
    by = f"{_roughly(expected - job.deadline)} " if expected is not None and expected > job.deadline else ""
    return f"By the forecast it is ready {by}after its deadline."


def wait_for(job: Job, after: Sequence[str], session: Session) -> None:
    """Makes a new job depend on these, except finished ones. Raises NotFound and Conflict.

    A dependency belongs to the same project or to none, so that those who see the job may see it too.
    """
    for id in dict.fromkeys(after):
        other = session.get(Job, id)
        if other is None or not serves(other.project, job.project):
            raise NotFound(f"after: there is no job {id[:60]!r}. A job can come after those that are there.")
        if other.state in ACTIVE:
            session.add(Wait(job=job.id, other=id))
        elif other.state != "finished":
            raise Conflict(f"after: the job {id} ({other.name}) has {_ended(other.state)}. Nothing can come after it.")


def wait_for_fewer(id: str, after: Sequence[str], session: Session) -> None:
    """Reduces a job's dependencies to these. Raises Conflict."""
    waits = {wait.other: wait for wait in session.scalars(select(Wait).where(Wait.job == id))}
    unknown = [other for other in after if other not in waits]
    if unknown:  # a new dependency on an existing job could create a cycle
        raise Conflict(f"after: the job does not wait for {unknown[0][:60]!r}. One that is there can only wait for fewer.")
    for other, wait in waits.items():
        if other not in after:
            session.delete(wait)


def waits_of(jobs: Iterable[Job], session: Session) -> dict[str, list[WaitOut]]:
    """The dependencies of jobs, by job id."""
    ids = [job.id for job in jobs if job.state in ACTIVE and job.request.get("after")]
    found: dict[str, list[WaitOut]] = {}
    for at in range(0, len(ids), MOST_NAMED):
        query = select(Wait.job, Wait.other, Job.name, Job.state).join(Job, Job.id == Wait.other, isouter=True)
        query = query.where(Wait.job.in_(ids[at : at + MOST_NAMED])).order_by(Wait.job, Job.created)
        for job, other, name, state in session.execute(query):
            found.setdefault(job, []).append(WaitOut(id=other, name=name, state=state))
    return found


def waits_sentence(waits: Sequence[WaitOut]) -> str | None:
    """A sentence about a job's unfinished dependencies; None if there are none."""
    if not waits:
        return None
    named = ", ".join(f'"{wait.name}"' if wait.name else wait.id for wait in waits[:SHOWN])
    more = f" and {len(waits) - SHOWN} more" if len(waits) > SHOWN else ""
    return f"Waits until {named}{more} {'is' if len(waits) == 1 else 'are'} finished."


def _roughly(seconds: float) -> str:
    for size, unit in ((86400.0, "day"), (3600.0, "hour"), (60.0, "minute")):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.0f} {unit}s"
    return "a minute" if seconds >= 45 else f"{max(seconds, 1.0):.0f} s"


def _ended(state: str) -> str:
    return "been cancelled" if state == "cancelled" else "failed"
