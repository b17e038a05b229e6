"""/api/shares: division of the farm's slots between users and projects. A share has a weight and a maximum number of slots."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from typing import Annotated

from fastapi import Path
from pydantic import BaseModel, Field
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from renderer.sentences import Sentence
from service.access.users import NAME
from service.access.visit import Visit
from service.errors import Invalid
from service.farm import Farm
from service.http.farm import FarmDependency
from service.http.pagination import PageDependency
from service.http.routers import api_router
from service.http.visit import VisitDependency
from service.models.strict import Strict
from service.scheduling.jobs.shares import EVERYBODY, Terms, share_of
from service.store.models import ACTIVE_STATES, Job, ShareTerms, User

__all__ = ["router"]

router = api_router(prefix="/api/shares", tags=["shares"])

SHARE = re.compile(rf"{EVERYBODY}|(?:user|project):{NAME.pattern}")

Share = Annotated[str, Path(max_length=80, description=f"`{EVERYBODY}` (jobs without an owner), `user:NAME` or `project:NAME`")]


class ShareIn(Strict):
    """New weight and maximum number of slots of a share."""

    weight: float = Field(1.0, ge=1e-3, le=1e6, allow_inf_nan=False, description="slots are shared in proportion to it")
    max_slots: int | None = Field(
        None, ge=1, le=1_000_000, description="maximum number of slots for all its jobs at a time; null: no limit"
    )


class ShareOut(BaseModel):
    """A share of the farm's slots, which belongs to a user, to a project, or to all jobs without an owner."""

    share: str = Field(description="`everybody` (jobs without an owner), `user:NAME` or `project:NAME`")
    weight: float = Field(description="slots are shared in proportion to it")
    max_slots: int | None = Field(description="maximum number of slots at a time; null: no limit")
    slots: int = Field(description="slots that work on its jobs at present")
    jobs: int = Field(description="unfinished jobs")


@router.get("", response_model=list[ShareOut])
def list_shares(farm: FarmDependency, visit: VisitDependency, page: PageDependency) -> list[ShareOut]:
    """Lists the shares of all users, of others with unfinished jobs, and those that an administrator has set, by name.

    The header X-Total-Count contains their number. Users who are not administrators see only their own share and those of their
    projects.
    """
    with farm.sessions() as session:
        terms = _terms(session)
        jobs = _jobs(session, terms)
        names = {share_of(user) for user in session.scalars(select(User.name))}
    shown = page.slice_of([share for share in sorted(names | terms.keys() | jobs.keys()) if _may_see_share(share, visit)])
    slots = _slots(farm, terms)
    return [_share_out(share, terms.get(share, Terms()), slots, jobs) for share in shown]


def _may_see_share(share: str, visit: Visit) -> bool:
    kind, _, name = share.partition(":")
    if visit.sight.everything or kind == EVERYBODY:
        return True
    return name == visit.user if kind == "user" else visit.sight.is_visible(name)


def _terms(session: Session) -> dict[str, Terms]:
    return {row.name: Terms(row.weight, row.max_slots) for row in session.scalars(select(ShareTerms))}


def _jobs(session: Session, terms: Mapping[str, Terms]) -> Counter[str]:
    """Returns the number of unfinished jobs by share. terms: weights and limits that administrators have set, by share."""
    found = Counter[str]()
    by_owner = select(Job.user, Job.project, func.count()).where(Job.state.in_(ACTIVE_STATES)).group_by(Job.user, Job.project)
    for user, project, number in session.execute(by_owner):
        found[share_of(user, project or "", terms)] += number
    return found


@router.put("/{share}", response_model=ShareOut)
def set_share(share: Share, body: ShareIn, farm: FarmDependency) -> ShareOut:
    """Sets a share's weight and limit, which apply from the next batch on. Batches already dispatched are not withdrawn."""
    if not SHARE.fullmatch(share):
        raise Invalid(
            Sentence(
                "share-invalid",
                "share: there is no {share}. Shares are {everybody}, user:NAME and project:NAME.",
                share=repr(share[:60]),
                everybody=EVERYBODY,
            )
        )
    with farm.sessions.begin() as session:
        session.merge(ShareTerms(name=share, weight=body.weight, max_slots=body.max_slots))
    return _updated_share(share, farm)


@router.delete("/{share}", response_model=ShareOut)
def reset_share(share: Share, farm: FarmDependency) -> ShareOut:
    """Resets a share to weight 1 and no limit. A project's jobs then count towards the shares of their users."""
    with farm.sessions.begin() as session:
        if (row := session.get(ShareTerms, share)) is not None:
            session.delete(row)
    return _updated_share(share, farm)


def _updated_share(share: str, farm: Farm) -> ShareOut:
    farm.engine.record_change("terms", "")
    with farm.sessions() as session:
        terms = _terms(session)
        jobs = _jobs(session, terms)
    return _share_out(share, terms.get(share, Terms()), _slots(farm, terms), jobs)


def _slots(farm: Farm, terms: Mapping[str, Terms]) -> Counter[str]:
    """Returns by share the number of slots that render its jobs. terms: as for `_jobs`."""
    busy = Counter(str(slot["job"]) for slot in farm.engine.snapshot.roster.current() if slot.get("job"))
    with farm.sessions() as session:
        rows = session.execute(select(Job.id, Job.user, Job.project).where(Job.id.in_(list(busy)))).all()
    found: Counter[str] = Counter()
    for id, user, project in rows:
        found[share_of(user, project or "", terms)] += busy[id]
    return found


def _share_out(share: str, terms: Terms, slots: Counter[str], jobs: Counter[str]) -> ShareOut:
    now = {"slots": slots[share], "jobs": jobs[share]}
    return ShareOut(share=share, weight=terms.weight, max_slots=terms.max_slots, **now)
