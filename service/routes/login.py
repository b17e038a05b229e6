"""/api/login, /api/logout, /api/session: login of a browser by name and password or by a one-time link, and logout.

A session is identified by a secret in a cookie that scripts cannot read and that is not sent with cross-site requests. Each
login creates a new session, and revokes the one whose cookie the browser sent.

Passwords are verified in a separate thread pool, so that many attempts do not block other requests.
"""

from __future__ import annotations

import math
from typing import Annotated

from anyio.to_thread import run_sync
from fastapi import Request, Response
from pydantic import BaseModel, ConfigDict, Field
from starlette.requests import cookie_parser
from starlette.responses import JSONResponse

from renderer.printable import printable
from renderer.sentences import Sentence
from service.access.access import SESSION_S
from service.access.passwords import MAX_LENGTH
from service.access.roles import OWNER, Caller, Role
from service.access.visit import Visit
from service.errors import Conflict, FarmError
from service.farm import Farm
from service.http.cookies import set_cookie
from service.http.farm import FarmDependency
from service.http.gate import cookie_name
from service.http.problems import Problem
from service.http.routers import api_router
from service.http.sessions import forget_login, logout_url
from service.http.visit import VisitDependency

__all__ = ["router"]

router = api_router(tags=["access"])

Password = Annotated[str, Field(min_length=1, max_length=MAX_LENGTH)]


class LoginIn(BaseModel):
    """A login: a name and password, or the code of a login link."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field("", max_length=64, description="name of the user")
    password: str = Field("", max_length=MAX_LENGTH, description="password of the user")
    link: str = Field("", max_length=MAX_LENGTH, description="code of a login link, in place of name and password")


class PasswordIn(BaseModel):
    """A password change. old: the present password, required if there is one."""

    model_config = ConfigDict(extra="forbid")

    old: str = Field("", max_length=MAX_LENGTH, description="present password; required if there is one")
    new: Password = Field(description="new password")


class LogoutOut(BaseModel):
    """Result of a logout.

    provider: URL that ends the browser's session at the OpenID provider and then returns to this page; empty without such a
    login.
    """

    provider: str = Field(description="URL that ends the session at the OpenID provider; empty: no such session")


class SessionOut(BaseModel):
    """The current session. login: whether the farm requires a login. name: the user's name; null without a login."""

    login: bool = Field(description="whether the farm requires a login")
    name: str | None = Field(description="name of the user; null: not logged in")
    role: str | None = Field(description="role of the user; null: not logged in")
    kind: str | None = Field(description="`session`, `token` or `owner`; `open`: this machine needs no login")
    provider: str | None = Field(description="name of the OpenID provider for logging in; null: none")


@router.get("/api/session", response_model=SessionOut)
def get_session(visit: VisitDependency, farm: FarmDependency) -> SessionOut:
    """Returns the user who is logged in, and whether a login is required."""
    return _session_out(visit.caller, visit.needs_login, farm)


@router.post("/api/login", response_model=SessionOut)
async def log_in(body: LoginIn, request: Request, response: Response, visit: VisitDependency, farm: FarmDependency) -> SessionOut:
    """Logs in. The response sets the session cookie."""
    return await run_sync(_log_in, body, request, response, visit, farm, limiter=farm.logins)


def _log_in(body: LoginIn, request: Request, response: Response, visit: Visit, farm: Farm) -> SessionOut:
    access = farm.access
    if body.link:
        name = access.keys.use_link(body.link)
        if name is None:
            access.audit.add("", "login refused", kind="link", address=visit.address, status=401)
            raise Problem(
                401,
                Sentence(
                    "login-link-invalid",
                    "This link was already used, is older than a day, or was withdrawn. Ask for a new one: `rayfarm user link`.",
                ),
            )
        role = Role.ADMIN if name == OWNER else Role.from_name(access.users.find(name).role)
        kind = "link"
    else:
        name, role, kind = *_verify_password(body.name, body.password, farm, visit.address), "password"
    _end_session(request, farm)
    secret, row = access.keys.create("session", name, Role.ADMIN, name=_user_agent(request), lasts_s=SESSION_S)
    _set_cookie(request, response, farm, secret, SESSION_S)
    forget_login(request, response, farm)
    access.audit.add(name, "login", kind=kind, address=visit.address, status=200)
    return _session_out(Caller(name, role, "session", row.id), visit.needs_login, farm)


@router.post("/api/logout", status_code=204, response_model=None, responses={200: {"model": LogoutOut}})
def log_out(request: Request, visit: VisitDependency, farm: FarmDependency) -> Response:
    """Ends the present session. After a login through OpenID, the response contains the provider's logout URL."""
    provider = None
    if _end_session(request, farm) and visit.caller is not None:
        farm.access.audit.add(visit.caller.name, "logout", kind="session", address=visit.address, status=204)
        provider = logout_url(request, farm)
    response = Response(status_code=204) if provider is None else JSONResponse(LogoutOut(provider=provider).model_dump())
    _set_cookie(request, response, farm, "", 0)
    forget_login(request, response, farm)
    return response


@router.put("/api/session/password", status_code=204)
async def change_password(body: PasswordIn, visit: VisitDependency, farm: FarmDependency) -> None:
    """Changes your own password. All your other sessions are ended."""
    await run_sync(_change_password, body, visit, farm, limiter=farm.logins)


def _change_password(body: PasswordIn, visit: Visit, farm: Farm) -> None:
    access, caller = farm.access, visit.caller
    assert caller is not None
    if caller.kind != "session" or caller.name == OWNER:
        raise Conflict(
            Sentence(
                "password-change-not-possible",
                "Only a user who is logged in on the page can change a password. `rayfarm user` changes those of others.",
            )
        )
    if access.users.find(caller.name).password is not None:
        _verify_password(caller.name, body.old, farm, visit.address)
    access.users.set_password(caller.name, body.new, stays=caller.key)


def _verify_password(name: str, password: str, farm: Farm, address: str) -> tuple[str, Role]:
    """Verifies a name and password; returns the user's name and role.

    address: the client's IP address. Raises Problem if they are wrong or there were too many attempts.
    """
    access = farm.access
    wait = access.attempts.begin(address, name)
    if wait is not None:
        minutes = math.ceil(wait / 60)
        raise Problem(
            429,
            Sentence(
                "login-too-many-failures",
                "Too many logins have failed. Try again in {minutes} min, or ask the administrator of this farm for a link.",
                minutes=minutes,
            ),
            {"Retry-After": str(math.ceil(wait))},
        )
    user = access.users.log_in(name, password)
    if user is None:
        access.audit.add(name, "login refused", kind="password", address=address, status=401)
        raise Problem(401, Sentence("login-password-wrong", "The name or the password is wrong. Check both and try again."))
    access.attempts.succeeded(address, name)
    return user.name, Role.from_name(user.role)


def _end_session(request: Request, farm: Farm) -> bool:
    """Ends the session in the request's cookie. Returns whether there was one."""
    access = farm.access
    shown = cookie_parser(request.headers.get("cookie", "")).get(cookie_name(access, request.scope), "")
    caller = access.keys.find(shown) if shown else None
    if caller is None or caller.key is None or caller.kind != "session":
        return False
    try:
        access.keys.withdraw("session", caller.key)
    except FarmError:
        return False
    return True


def _set_cookie(request: Request, response: Response, farm: Farm, secret: str, lasts_s: float) -> None:
    set_cookie(request, response, cookie_name(farm.access, request.scope), secret, lasts_s)


def _user_agent(request: Request) -> str:
    return printable(request.headers.get("user-agent", ""))[:255]


def _session_out(caller: Caller | None, needs_login: bool, farm: Farm) -> SessionOut:
    provider = farm.access.oidc.name if farm.access.oidc is not None else None
    if caller is None or caller.is_worker:
        return SessionOut(login=needs_login, name=None, role=None, kind=None, provider=provider)
    return SessionOut(login=needs_login, name=caller.name, role=caller.role.api_name, kind=caller.kind, provider=provider)
