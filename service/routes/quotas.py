"""/api/quota, /api/quotas: the caller's limits and their use, and for administrators those of others."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from service.access.quotas import MOST, Allowance, Limits
from service.http.farm import FarmDependency
from service.http.pagination import PageDependency
from service.http.routers import api_router
from service.http.visit import VisitDependency

__all__ = ["router"]

router = api_router(tags=["access"])

Amount = Annotated[int | None, Field(ge=0, le=MOST)]
Of = Literal["users", "tokens"]


class LimitsIn(BaseModel):
    """What somebody may; null: no limit. bytes: of uploads and films. jobs: unfinished at a time. samples_day: in 24 hours."""

    model_config = ConfigDict(extra="forbid")

    bytes: Amount = None
    jobs: Annotated[int | None, Field(ge=0, le=1 << 30)] = None
    samples_day: Amount = None


class AllowanceOut(BaseModel):
    """whose: user:NAME or token:ID. limits: null where there is none. used: as it is now."""

    whose: str
    limits: LimitsIn
    used: LimitsIn


class SetAllowanceOut(AllowanceOut):
    """is_own: an administrator has said so; else they are everybody's."""

    is_own: bool


@router.get("/api/quota", response_model=list[AllowanceOut])
def get_quota(farm: FarmDependency, visit: VisitDependency) -> list[AllowanceOut]:
    """What you may have and do, and what of it is used; of your token too, where that has limits of its own."""
    return [_out(found) for found in farm.quotas.allowances_of(visit.caller)]


@router.get("/api/quotas", response_model=list[SetAllowanceOut])
def list_quotas(farm: FarmDependency, page: PageDependency) -> list[SetAllowanceOut]:
    """Of all users, and of tokens that have limits of their own: a page. The header X-Total-Count has their number."""
    described = farm.quotas.described(page.slice_of(farm.quotas.named()))
    return [SetAllowanceOut(**_out(found).model_dump(), is_own=found.is_own) for found in described]


@router.put("/api/quotas/{of}/{name}", status_code=204)
def set_quota(of: Of, name: str, asked: LimitsIn, farm: FarmDependency) -> None:
    """Say what a user, or a token, may."""
    farm.quotas.set(f"{of.removesuffix('s')}:{name}", Limits(**asked.model_dump()))


@router.delete("/api/quotas/{of}/{name}", status_code=204)
def forget_quota(of: Of, name: str, farm: FarmDependency) -> None:
    """A user may what every user may; a token what its user may."""
    farm.quotas.set(f"{of.removesuffix('s')}:{name}", None)


def _out(found: Allowance) -> AllowanceOut:
    return AllowanceOut(whose=found.whose, limits=LimitsIn(**asdict(found.limits)), used=LimitsIn(**asdict(found.used)))
