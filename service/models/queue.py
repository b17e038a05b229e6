"""Queue fields of a job: its dependencies, deadline and requirements, and their state."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, Field

from service.clock import deadline_of
from service.models.coded import Coded
from service.models.strict import Strict
from service.scheduling.fleet.needs import Needs

__all__ = [
    "QueueOptionsIn",
    "QueueOut",
    "QueuePatch",
    "WaitOut",
]

MAX_DEPENDENCIES = 1000

JobIds = Annotated[list[Annotated[str, Field(max_length=100)]], Field(max_length=MAX_DEPENDENCIES)]


MaxSlots = Annotated[
    int | None, Field(ge=1, le=1_000_000, description="maximum number of slots that render the job at a time; null: no limit")
]


def _checked_deadline(text: str | None) -> str | None:
    if text is not None:
        deadline_of(text)
    return text


Deadline = Annotated[
    str | None,
    Field(
        max_length=60,
        description="ISO time, or a time of day such as 08:00 for its next occurrence; by default in the service's time zone",
    ),
    AfterValidator(_checked_deadline),
]


def _parse_needs(texts: list[str]) -> list[str]:
    Needs.parse(texts)
    return texts


Requirements = Annotated[
    list[Annotated[str, Field(max_length=100)]],
    Field(max_length=50, description="requirements on workers: tags such as gpu, and memory_gb=32; []: any worker"),
    AfterValidator(_parse_needs),
]


class QueueOptionsIn(Strict):
    """Queue options in a request for a picture."""

    after: JobIds = Field(
        [],
        description="ids of jobs that must finish first; the job fails if one of them fails or is cancelled or deleted",
    )

    max_slots: MaxSlots = None
    deadline: Deadline = None
    needs: Requirements = Field([])


class QueuePatch(Strict):
    """Queue options in a change of a job."""

    max_slots: MaxSlots = None
    deadline: Deadline = None
    needs: Requirements | None = Field(
        None, description="requirements on workers: tags such as gpu, and memory_gb=32; []: any worker"
    )
    after: JobIds | None = Field(None, description="the jobs to continue waiting for; []: none")


class WaitOut(BaseModel):
    """A job that another job waits for."""

    id: str = Field(description="id of the job")
    name: str | None = Field(description="name of the job; null: the job was deleted")
    state: str | None = Field(description="state of the job; null: the job was deleted")


class QueueOut(Coded):
    """Queue options of a job, and its forecast."""

    after: list[str] = Field(description="ids of the jobs that must finish first, as requested")
    user: str | None = Field(description="user who submitted the job; null on a farm without logins")
    max_slots: int | None = Field(description="maximum number of slots at a time")
    needs: list[str] = Field(description="requirements on workers")
    deadline: float | None = Field(description="Unix time until which the job should finish; null: none")
    expected: float | None = Field(description="forecast of the end, as Unix time; only for unfinished jobs with a deadline")
    unforeseen: str | None = Field(description="why an unfinished job with a deadline has no forecast")
    late: float | None = Field(
        description="Unix time since when the deadline is expected to be missed, or is missed; null: neither"
    )
    warning: str | None = Field(description="a problem that may need attention")
    waits_for: list[WaitOut] = Field(description="those of `after` that are not finished")
