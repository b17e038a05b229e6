"""/api/users, /api/links, /api/audit: users, login links and the audit log, for administrators."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Query
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy import select

from renderer.sentences import Sentence
from service.access.access import LINK_S
from service.access.passwords import MAX_LENGTH
from service.access.roles import OWNER, Role, RoleName
from service.errors import Conflict
from service.http.farm import FarmDependency
from service.http.pagination import PageDependency
from service.http.routers import api_router
from service.http.visit import VisitDependency
from service.store.models import User

__all__ = ["router"]

router = api_router(tags=["access"])

MAX_LINES = 1000
Name = Annotated[str, Field(min_length=1, max_length=64)]
Password = Annotated[str | None, Field(max_length=MAX_LENGTH)]


class UserIn(BaseModel):
    """A new user. A user without a password can log in only by a login link, and may then set a password."""

    model_config = ConfigDict(extra="forbid")

    name: Name = Field(description="name of the user")
    role: RoleName = Field("submit", description="what the user may do")
    password: Password = Field(None, description="null: the user logs in by a login link")


class UserChange(BaseModel):
    """Changes of a user: role or password."""

    model_config = ConfigDict(extra="forbid")

    role: RoleName | None = Field(None, description="new role; null: unchanged")
    password: Password = Field(None, description="new password; null: unchanged")


class UserOut(BaseModel):
    """A user. sessions: number of open browser sessions."""

    name: str = Field(description="name of the user")
    role: str = Field(description="what the user may do")
    has_password: bool = Field(description="whether the user has a password")
    created: float = Field(description="Unix time in seconds")
    sessions: int = Field(description="open browser sessions")


class LinkIn(BaseModel):
    """A login link to create. user: name of the user whom the link logs in; empty: the farm's owner."""

    model_config = ConfigDict(extra="forbid")

    user: Name = Field(OWNER, description="user whom the link logs in; empty: the farm's owner")


class LinkOut(BaseModel):
    """A new login link. The URL of the page followed by #/login?code=CODE logs the user in, once.

    code: the link's secret, returned only this once.
    """

    user: str = Field(description="user whom the link logs in")
    code: str = Field(description="code of the link; no later request returns it")
    expires: float | None = Field(description="Unix time of its end; null: never")


class AuditLine(BaseModel):
    """An entry of the audit log."""

    model_config = ConfigDict(extra="allow")

    at: float = Field(description="Unix time in seconds")
    who: str = Field(description="user or token that sent the request")
    what: str = Field(description="the request")


@router.get("/api/users", response_model=list[UserOut])
def list_users(farm: FarmDependency, page: PageDependency) -> list[UserOut]:
    """Lists the users by name. The header X-Total-Count contains their number."""
    with farm.sessions() as session:
        _, rows = page.rows(select(User).order_by(User.name), session)
    sessions = farm.access.keys.count("session", [user.name for user in rows])
    return [_user_out(user, sessions[user.name]) for user in rows]


@router.post("/api/users", status_code=201, response_model=UserOut)
def add_user(body: UserIn, farm: FarmDependency) -> UserOut:
    """Creates a user."""
    return _user_out(farm.access.users.add(body.name, Role.from_name(body.role), body.password), 0)


@router.patch("/api/users/{name}", response_model=UserOut)
def change_user(name: str, body: UserChange, farm: FarmDependency) -> UserOut:
    """Changes a user's role, which takes effect at once, or the password, which ends all sessions of the user."""
    users = farm.access.users
    user = users.find(name)
    if body.password is not None:
        user = users.set_password(name, body.password)
    if body.role is not None:
        user = users.set_role(name, Role.from_name(body.role))
    return _user_out(user, farm.access.keys.count("session", [name])[name])


@router.delete("/api/users/{name}", status_code=204)
def remove_user(name: str, visit: VisitDependency, farm: FarmDependency) -> None:
    """Deletes a user with all credentials. The user's scenes and jobs stay."""
    if visit.caller is not None and visit.caller.name == name:
        raise Conflict(
            Sentence("user-remove-self", "You cannot remove yourself. Another administrator can, or `rayfarm user remove`.")
        )
    farm.access.users.remove(name)


@router.post("/api/links", status_code=201, response_model=LinkOut)
def make_link(body: LinkIn, farm: FarmDependency) -> LinkOut:
    """Creates a link that logs a user in once, within a day."""
    if body.user != OWNER:
        farm.access.users.find(body.user)
    code, row = farm.access.keys.create("link", body.user, Role.ADMIN, lasts_s=LINK_S)
    return LinkOut(user=body.user, code=code, expires=row.expires)


@router.get("/api/audit", response_model=list[AuditLine])
def get_audit(
    farm: FarmDependency, limit: Annotated[int, Query(ge=1, le=MAX_LINES, description="maximum number of entries")] = 100
) -> list[dict[str, Any]]:
    """Returns the audit log, newest entries first: who did what, and from where."""
    return farm.access.audit.latest(limit)


def _user_out(user: User, sessions: int) -> UserOut:
    has_password = user.password is not None
    return UserOut(name=user.name, role=user.role, has_password=has_password, created=user.created, sessions=sessions)
