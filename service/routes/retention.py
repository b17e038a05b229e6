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

    films_days: float | None = Field(None, ge=0, le=MAX_DAYS, description="films of jobs that were over for longer go")
    films_bytes: int | None = Field(None, ge=0, le=1 << 60, description="films beyond that go, the oldest first")
    compiled_days: float | None = Field(None, ge=0, le=MAX_DAYS, description="what unused scenes were compiled to goes")
    uploads_days: float | None = Field(None, ge=0, le=MAX_DAYS, description="scenes that were not used for longer go")
    dry_run: bool = Field(True, description="only tell")


class ItemOut(Coded):
    """A film, compiled scene or upload that can be deleted, or was deleted."""

    what: Literal["film", "compiled", "upload"]
    id: str
    name: str
    bytes: int = Field(description="of disk; what scenes share is counted with each")
    age_s: float
    why: str


class RetentionOut(Coded):
    """Data that can be deleted, or was deleted. Films can be rendered and scenes compiled again; uploads cannot be restored."""

    state: Literal["planned", "running", "finished", "failed", "stopped"] = Field(
        description="planned: nothing is deleted; stopped: the service has ended before all was done"
    )
    items: list[ItemOut] = Field(description="that may go (planned), or that went so far")
    bytes: int = Field(description="of these")
    planned: int | None = Field(description="how many may go; null while they are looked for")
    done: int = Field(description="of these, looked at so far; some may be needed again by then, and stay")
    error: str | None = None


@router.post("", response_model=RetentionOut, responses={202: {"model": RetentionOut, "description": "It has begun."}})
def let_go(wish: RetentionIn, farm: FarmDependency, response: Response) -> RetentionOut:
    """Lists what these rules allow to delete. With dry_run false, starts the deletion and responds 202; `GET` shows its progress.

    Data of unfinished and pinned jobs is never deleted.
    """
    rules = Rules(**wish.model_dump(exclude={"dry_run"}))
    rules = farm.rules if rules.is_empty else rules
    if wish.dry_run:
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
            Sentence(
                "retention-never-run",
                "No cleanup was started since the service started. POST /api/retention starts one.",
            )
        )
    return _retention_out(run)


def _retention_out(run: Run, state: Literal["planned"] | None = None) -> RetentionOut:
    now, items = state or run.state, list(run.gone)  # in this order, so that a finished state has all items
    shown = [ItemOut(**asdict(item)) for item in items]
    return RetentionOut(
        state=now, items=shown, bytes=sum(item.bytes for item in items), planned=run.planned, done=run.done, error=run.error
    )
