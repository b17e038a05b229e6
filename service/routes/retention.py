"""/api/retention: lists or deletes data that retention rules allow to delete: the farm's rules or those in the request."""

from __future__ import annotations

from dataclasses import asdict
from typing import Literal

from fastapi import Response
from pydantic import Field

from renderer.sentences import Sentence
from service.errors import NotFound
from service.http.farm import FarmDependency
from service.http.routers import api_router
from service.maintenance.retention import Rules, Run
from service.models.coded import Coded
from service.models.strict import Strict

__all__ = ["router"]

router = api_router(prefix="/api/retention", tags=["farm"])
MAX_DAYS = 36500.0


class RetentionIn(Strict):
    """Retention rules. If none is given, the farm's own rules apply (RAYFARM_KEEP_*)."""

    films_days: float | None = Field(
        None, ge=0, le=MAX_DAYS, description="delete films of jobs that ended more than this many days ago"
    )
    films_bytes: int | None = Field(
        None, ge=0, le=1 << 60, description="delete the oldest films until all films together need at most this many bytes"
    )
    compiled_days: float | None = Field(
        None,
        ge=0,
        le=MAX_DAYS,
        description="delete compiled scenes that were not used for this many days; they can be compiled again",
    )
    uploads_days: float | None = Field(None, ge=0, le=MAX_DAYS, description="delete scenes that were not used for this many days")
    dry_run: bool = Field(True, description="list what would be deleted, without deleting it")


class ItemOut(Coded):
    """A film, compiled scene or upload that can be deleted, or was deleted."""

    what: Literal["film", "compiled", "upload"] = Field(description="kind of the data")
    id: str = Field(description="id of the job or scene")
    name: str = Field(description="name of the job or scene")
    bytes: int = Field(description="bytes on disk; files that scenes share are counted for each of them")
    age_s: float = Field(description="seconds since its last use")
    why: str = Field(description="rule by which it can be deleted")


class RetentionOut(Coded):
    """Data that can be deleted, or was deleted. Films can be rendered and scenes compiled again; uploads cannot be restored."""

    state: Literal["planned", "running", "finished", "failed", "stopped"] = Field(
        description="`planned`: nothing is deleted; `stopped`: the service ended before the cleanup did"
    )
    items: list[ItemOut] = Field(description="what can be deleted (`planned`), or what was deleted so far")
    bytes: int = Field(description="size of these items on disk")
    planned: int | None = Field(description="number of items to delete; null while they are searched")
    done: int = Field(description="number of items checked so far; items in use again are kept")
    error: str | None = Field(None, description="why the cleanup failed; null: it did not")


@router.post("", response_model=RetentionOut, responses={202: {"model": RetentionOut, "description": "It has begun."}})
def let_go(request: RetentionIn, farm: FarmDependency, response: Response) -> RetentionOut:
    """Lists what these rules allow to delete. With dry_run false, starts the deletion and responds 202; `GET` shows its progress.

    Data of unfinished and pinned jobs is never deleted.
    """
    rules = Rules(**request.model_dump(exclude={"dry_run"}))
    rules = farm.rules if rules.is_empty else rules
    if request.dry_run:
        items = farm.retention.deletable_items(rules)
        return _retention_out(Run("running", len(items), 0, items), "planned")
    response.status_code, response.headers["Location"] = 202, router.prefix
    return _retention_out(farm.retention.begin(rules))


@router.get("", response_model=RetentionOut)
def retention_run(farm: FarmDependency) -> RetentionOut:
    """Returns the progress of the latest requested deletion."""
    run = farm.retention.latest
    if run is None:
        raise NotFound(
            Sentence("retention-never-run", "No cleanup was started since the service started. POST /api/retention starts one.")
        )
    return _retention_out(run)


def _retention_out(run: Run, state: Literal["planned"] | None = None) -> RetentionOut:
    now, items = state or run.state, list(run.gone)  # in this order, so that a finished state has all items
    shown = [ItemOut(**asdict(item)) for item in items]
    return RetentionOut(
        state=now, items=shown, bytes=sum(item.bytes for item in items), planned=run.planned, done=run.done, error=run.error
    )
