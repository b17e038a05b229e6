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


MaxSlots = Annotated[int | None, Field(ge=1, le=1_000_000, description="slots that render it at a time, at most; null: no limit")]


def _checked_deadline(text: str | None) -> str | None:
    if text is not None:
        deadline_of(text)
    return text


Deadline = Annotated[
    str | None,
    Field(
        max_length=60,
        description="by when it is wanted: an ISO time, or the next 08:00; of the service's zone where it names none",
    ),
    AfterValidator(_checked_deadline),
]


def _parse_needs(texts: list[str]) -> list[str]:
    Needs.parse(texts)
    return texts


Requirements = Annotated[
    list[Annotated[str, Field(max_length=100)]],
    Field(max_length=50, description="of the workers that render it: tags, as gpu, and memory_gb=32; [] for any worker"),
    AfterValidator(_parse_needs),
]


class QueueOptionsIn(Strict):
    """Queue options in a request for a picture."""

    after: JobIds = Field(
        [],
        description="ids of jobs: it begins when they are finished; where one fails, is cancelled or deleted, so does it fail",
    )

    max_slots: MaxSlots = None
    deadline: Deadline = None
    needs: Requirements = Field([])


class QueuePatch(Strict):
    """Queue options in a change of a job."""

    max_slots: MaxSlots = None
    deadline: Deadline = None
    needs: Requirements | None = None
    after: JobIds | None = Field(None, description="which of the jobs that it waits for it is to wait for on; []: none of them")


class WaitOut(BaseModel):
    """A job that another job waits for."""

    id: str
    name: str | None = Field(description="null: it was deleted")
    state: str | None


class QueueOut(Coded):
    """Queue options of a job, and its forecast."""

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
