"""Models of changes to many jobs at once."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, Field, model_validator

from renderer.sentences import Sentence
from service.models.coded import Coded
from service.models.jobs import JobState
from service.models.strict import Strict

__all__ = ["ChangesIn", "ChangesOut", "RefusedOut", "WasOut"]

MAX_JOBS = 1000  # per request


class ChangesIn(Strict):
    """A change to apply to many jobs."""

    jobs: list[Annotated[str, Field(max_length=100)]] = Field(min_length=1, max_length=MAX_JOBS, description="ids of the jobs")
    state: Literal["running", "paused", "cancelled", "deleted"] | None = Field(
        None, description="new state; `deleted` deletes the jobs"
    )
    priority: int | None = Field(None, ge=-100, le=100, description="new priority; higher is rendered first")
    of: list[JobState] | None = Field(None, description="only jobs in one of these states")

    @model_validator(mode="after")
    def _has_a_change(self) -> ChangesIn:
        if self.state is None and self.priority is None:
            raise ValueError(Sentence("job-changes-empty", "nothing to change; give state or priority"))
        return self


class WasOut(BaseModel):
    """A job that was changed, with its previous state and priority."""

    id: str = Field(description="id of the job")
    state: str = Field(description="state before the change")
    priority: int = Field(description="priority before the change")


class RefusedOut(Coded):
    """A job that the change could not be applied to, with the reason."""

    id: str = Field(description="id of the job")
    why: str = Field(description="reason in one sentence")


class ChangesOut(BaseModel):
    """Result of changing many jobs: those that were changed, and those that refused the change."""

    changed: list[WasOut] = Field(description="changed jobs, with their previous values")
    refused: list[RefusedOut] = Field(description="unchanged jobs, with the reason")
