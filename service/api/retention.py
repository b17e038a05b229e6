"""/api/retention: what a farm would delete by its rules or by others, and deleting it."""

from __future__ import annotations

from dataclasses import asdict
from typing import Literal

from fastapi import APIRouter
from pydantic import BaseModel, Field

from service.api.strict import Strict
from service.farm import FarmDependency
from service.keeping.retention import Rules

__all__ = ["router"]

router = APIRouter(prefix="/api/retention", tags=["farm"])
MOST_DAYS = 36500.0


class RetentionIn(Strict):
    """By which rules; where none is given, by the farm's own (RAYFARM_KEEP_*)."""

    films_days: float | None = Field(None, ge=0, le=MOST_DAYS, description="films of jobs that were over for longer go")
    films_bytes: int | None = Field(None, ge=0, le=1 << 60, description="films beyond that go, the oldest first")
    compiled_days: float | None = Field(None, ge=0, le=MOST_DAYS, description="what unused scenes were compiled to goes")
    uploads_days: float | None = Field(None, ge=0, le=MOST_DAYS, description="scenes that were not used for longer go")
    dry_run: bool = Field(True, description="only tell")


class ItemOut(BaseModel):
    """Something that may go, or went."""

    what: Literal["film", "compiled", "upload"]
    id: str
    name: str
    bytes: int = Field(description="of disk; what scenes share is counted with each")
    age_s: float
    why: str


class RetentionOut(BaseModel):
    """What may go, or went. A film is rendered again and a scene compiled again when somebody asks; an upload is gone."""

    items: list[ItemOut]
    bytes: int


@router.post("", response_model=RetentionOut)
def let_go(wish: RetentionIn, farm: FarmDependency) -> RetentionOut:
    """What the farm would let go by these rules; with dry_run false it does. What unfinished and pinned jobs need stays."""
    rules = Rules(**wish.model_dump(exclude={"dry_run"}))
    items = farm.retention.plan(farm.rules if rules.is_empty else rules)
    if not wish.dry_run:
        items = farm.retention.carry_out(items)
    return RetentionOut(items=[ItemOut(**asdict(item)) for item in items], bytes=sum(item.bytes for item in items))
