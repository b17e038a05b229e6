"""/api/quota, /api/quotas: the caller's limits and usage, and, for administrators, those of others."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from service.access.quotas import MAX_LIMIT, Allowance, Limits
from service.http.farm import FarmDependency
from service.http.pagination import PageDependency
from service.http.routers import api_router
from service.http.visit import VisitDependency

__all__ = ["router"]

router = api_router(tags=["access"])

Amount = Annotated[int | None, Field(ge=0, le=MAX_LIMIT)]
Of = Literal["users", "tokens"]


class LimitsIn(BaseModel):
    """Limits of a user or token; null: unlimited.

    bytes: size of uploads and films. jobs: number of unfinished jobs. samples_day: samples rendered in 24 hours.
    """

    model_config = ConfigDict(extra="forbid")

    bytes: Amount = Field(None, description="bytes of stored scenes and films")
    jobs: Annotated[int | None, Field(ge=0, le=1 << 30)] = Field(None, description="unfinished jobs at a time")
    samples_day: Amount = Field(None, description="samples per day")


class AllowanceOut(BaseModel):
    """Limits and usage of a user or token. whose: user:NAME or token:ID. used: the present usage."""

    whose: str = Field(description="`user:NAME` or `token:ID`")
    limits: LimitsIn = Field(description="the limits")
    used: LimitsIn = Field(description="present usage")


class SetAllowanceOut(AllowanceOut):
    """Limits and usage. is_own: whether an administrator has set the limits; otherwise they are the defaults."""

    is_own: bool = Field(description="true: set by an administrator; false: the defaults")


@router.get("/api/quota", response_model=list[AllowanceOut])
def get_quota(farm: FarmDependency, visit: VisitDependency) -> list[AllowanceOut]:
    """Returns your limits and usage; also those of your token, if it has limits of its own."""
    return [_allowance_out(found) for found in farm.quotas.allowances_of(visit.caller)]


@router.get("/api/quotas", response_model=list[SetAllowanceOut])
def list_quotas(farm: FarmDependency, page: PageDependency) -> list[SetAllowanceOut]:
    """Lists the limits of all users and of tokens with limits of their own. The header X-Total-Count contains their number."""
    described = farm.quotas.existing_allowances(page.slice_of(farm.quotas.resource_names()))
    return [SetAllowanceOut(**_allowance_out(found).model_dump(), is_own=found.is_own) for found in described]


@router.put("/api/quotas/{of}/{name}", status_code=204)
def set_quota(of: Of, name: str, body: LimitsIn, farm: FarmDependency) -> None:
    """Sets the limits of a user or token. of: user or token. name: the user's name or the token's id."""
    farm.quotas.set(f"{of.removesuffix('s')}:{name}", Limits(**body.model_dump()))


@router.delete("/api/quotas/{of}/{name}", status_code=204)
def forget_quota(of: Of, name: str, farm: FarmDependency) -> None:
    """Restores the default limits of a user; for a token, removes its own limits."""
    farm.quotas.set(f"{of.removesuffix('s')}:{name}", None)


def _allowance_out(found: Allowance) -> AllowanceOut:
    return AllowanceOut(whose=found.whose, limits=LimitsIn(**asdict(found.limits)), used=LimitsIn(**asdict(found.used)))
