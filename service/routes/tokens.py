"""/api/tokens: access tokens of programs and workers. A token's secret is returned only once, when it is created."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import Query
from pydantic import BaseModel, ConfigDict, Field

from renderer.sentences import Sentence
from service.access.roles import Caller, Role
from service.errors import Conflict
from service.http.farm import FarmDependency
from service.http.pagination import PageDependency
from service.http.problems import Problem
from service.http.routers import api_router
from service.http.visit import VisitDependency
from service.intake.names import plain_title
from service.store.models import Key

__all__ = ["router"]

router = api_router(prefix="/api/tokens", tags=["access"])

DAY_S = 86400.0
MAX_DAYS = 3650

Scope = Literal["view", "submit", "admin", "worker"]


class TokenIn(BaseModel):
    """A token to create. name: its purpose. days: lifetime; null: until it is revoked.

    role: the highest role that requests with the token can have, limited by its creator's role; worker: only for workers.
    """

    model_config = ConfigDict(extra="forbid")

    name: str = Field(min_length=1, max_length=100, description="purpose of the token")
    role: Scope = Field("submit", description="what the token permits")
    days: float | None = Field(
        90.0, gt=0, le=MAX_DAYS, allow_inf_nan=False, description="lifetime in days; null: until the token is revoked"
    )


class TokenOut(BaseModel):
    """A token without its secret. seen: time of its last use, accurate to some minutes."""

    id: str = Field(description="id of the token, without its secret")
    name: str = Field(description="purpose of the token")
    role: str = Field(description="what the token permits")
    user: str = Field(description="user to whom the token belongs")
    created: float = Field(description="Unix time in seconds")
    expires: float | None = Field(description="Unix time of its end; null: never")
    seen: float | None = Field(description="Unix time of its last use, accurate to some minutes; null: not used yet")


class NewToken(TokenOut):
    """A new token. secret: the token's secret, returned only this once."""

    secret: str = Field(description="the token itself; no later request returns it")


@router.get("", response_model=list[TokenOut])
def list_tokens(
    visit: VisitDependency,
    farm: FarmDependency,
    page: PageDependency,
    everybody: Annotated[bool, Query(alias="all", description="administrators: list the tokens of all users")] = False,
) -> list[TokenOut]:
    """Lists your tokens, newest first; for administrators also worker tokens. The header X-Total-Count contains their number."""
    caller = _require_caller(visit.caller)
    is_admin = caller.role >= Role.ADMIN
    if everybody and not is_admin:
        raise Problem(
            403,
            Sentence("tokens-of-others-hidden", "Only administrators see others' tokens. Leave `all` out to see your own."),
        )
    query = farm.access.keys.select_valid(("token", "worker") if is_admin else ("token",), None if everybody else caller.name)
    with farm.sessions() as session:
        _, rows = page.rows(query, session)
    return [_token_out(row) for row in rows]


@router.post("", status_code=201, response_model=NewToken)
def make_token(body: TokenIn, visit: VisitDependency, farm: FarmDependency) -> NewToken:
    """Creates a token. Only a user who is logged in can do this, not a token, so revoking a leaked token is enough."""
    caller = _require_caller(visit.caller)
    if caller.kind == "token":
        raise Conflict(
            Sentence(
                "token-cannot-create-tokens",
                "A token cannot create tokens. Log in on the page, or use `rayfarm token` on the farm's machine.",
            )
        )
    name = plain_title(body.name)
    lasts_s = None if body.days is None else body.days * DAY_S
    if body.role == "worker":
        if caller.role < Role.ADMIN:
            raise Problem(
                403,
                Sentence(
                    "worker-token-needs-admin", "Only administrators may add workers. Ask one of them for a worker's token."
                ),
            )
        secret, row = farm.access.keys.create("worker", caller.name, Role.NOBODY, name, lasts_s)
    else:
        role = Role.from_name(body.role)
        if role > caller.role:
            raise Problem(
                403,
                Sentence(
                    "token-role-too-high",
                    "Your role is {own_role}: you cannot create a token with the role {role}.",
                    own_role=caller.role.api_name,
                    role=body.role,
                ),
            )
        secret, row = farm.access.keys.create("token", caller.name, role, name, lasts_s)
    return NewToken(**_token_out(row).model_dump(), secret=secret)


@router.delete("/{id}", status_code=204)
def withdraw_token(id: str, visit: VisitDependency, farm: FarmDependency) -> None:
    """Revokes a token at once. Administrators may revoke any; a token with role `view` only itself."""
    caller = _require_caller(visit.caller)
    if caller.kind == "token" and caller.role < Role.SUBMIT and id != caller.key:
        raise Problem(
            403,
            Sentence("token-read-only", "This token is read-only: it can withdraw itself, but no other."),
        )
    is_admin = caller.role >= Role.ADMIN
    if is_admin and farm.access.keys.exists("worker", id):
        farm.access.keys.withdraw("worker", id)
        farm.redis_users.refresh_now()
    else:
        farm.access.keys.withdraw("token", id, None if is_admin else caller.name)


def _require_caller(caller: Caller | None) -> Caller:
    assert caller is not None  # service.http.access_requirements
    return caller


def _token_out(row: Key) -> TokenOut:
    role = "worker" if row.kind == "worker" else row.role
    return TokenOut(id=row.id, name=row.name, role=role, user=row.user, created=row.created, expires=row.expires, seen=row.seen)
