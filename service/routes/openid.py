"""/api/login/openid: login through an OpenID provider. It redirects the browser back to the service with a one-time code."""

from __future__ import annotations

import logging
from typing import Annotated

from fastapi import Query, Request
from starlette.requests import cookie_parser
from starlette.responses import RedirectResponse

from renderer.printable import printable
from renderer.sentences import Sentence
from service.access.access import SESSION_S
from service.access.oidc import LOGIN_TIMEOUT_S, Oidc, Refused
from service.access.roles import Role
from service.access.secrets import fingerprint
from service.errors import NotFound
from service.farm import Farm
from service.http.cookies import set_cookie
from service.http.farm import FarmDependency
from service.http.gate import cookie_name
from service.http.routers import api_router
from service.http.sessions import base_url, keep_login
from service.http.visit import VisitDependency

__all__ = ["router"]

router = api_router(prefix="/api/login/openid", tags=["access"])
log = logging.getLogger(__name__)

MAX_PARAMETER_LENGTH = 2048
MAX_PENDING_LOGINS = 8  # logins of one browser; their cookies, of 410 characters each, fit a proxy's 8 kB for a header


@router.get("", status_code=302, response_class=RedirectResponse)
def begin(request: Request, farm: FarmDependency) -> RedirectResponse:
    """Redirects the browser to the OpenID provider."""
    oidc = _oidc(farm)
    try:
        begun = oidc.begin(f"{base_url(request, farm)}/api/login/openid/answer")
    except Refused as refusal:
        return _refusal_redirect(request, refusal)
    answer = RedirectResponse(begun.url, 302, {"Cache-Control": "no-store"})
    for name in _pending(farm, request)[: 1 - MAX_PENDING_LOGINS]:  # browsers send the oldest first (RFC 6265, 5.4)
        set_cookie(request, answer, name, "", 0, same_site="lax")
    # Not SameSite=Strict: the cookie must be sent when the provider redirects back.
    set_cookie(request, answer, _cookie(farm, request, begun.state), begun.sealed, LOGIN_TIMEOUT_S, same_site="lax")
    return answer


@router.get("/answer", status_code=302, response_class=RedirectResponse)
def finish(
    request: Request,
    farm: FarmDependency,
    visit: VisitDependency,
    state: Annotated[
        str, Query(max_length=MAX_PARAMETER_LENGTH, description="state of the login that the provider returns")
    ] = "",
    code: Annotated[str, Query(max_length=MAX_PARAMETER_LENGTH, description="authorization code from the provider")] = "",
    error: Annotated[str, Query(max_length=MAX_PARAMETER_LENGTH, description="error code from the provider")] = "",
) -> RedirectResponse:
    """Completes the login when the provider redirects the browser here: sets the session cookie and redirects to the page."""
    access, oidc = farm.access, _oidc(farm)
    cookie = _cookie(farm, request, state)
    try:
        found = oidc.finish(state, code, error, _cookies(request).get(cookie, ""))
    except Refused as refusal:
        access.audit.add("", "login refused", kind="openid", address=visit.address, status=401)
        answer = _refusal_redirect(request, refusal)
    else:
        user = found.user
        access.keys.clear_cache()  # the role may have changed
        browser = printable(request.headers.get("user-agent", ""))[:255]
        secret, _ = access.keys.create("session", user.name, Role.ADMIN, name=browser, lasts_s=SESSION_S)
        access.audit.add(user.name, "login", kind="openid", address=visit.address, status=200)
        answer = RedirectResponse(f"{request.base_url.path}#/", 302, {"Cache-Control": "no-store"})
        set_cookie(request, answer, cookie_name(access, request.scope), secret, SESSION_S)
        keep_login(request, answer, farm, found.token)
    set_cookie(request, answer, cookie, "", 0, same_site="lax")
    return answer


def _refusal_redirect(request: Request, refusal: Refused) -> RedirectResponse:
    log.warning("a login by the OpenID provider is refused: %s", refusal)
    return RedirectResponse(f"{request.base_url.path}#/login?refused={refusal.why}", 302, {"Cache-Control": "no-store"})


def _cookie(farm: Farm, request: Request, state: str) -> str:
    """Returns the name of the cookie for one login attempt. Each attempt has another, so that several tabs can log in at once.

    state: the attempt's random value, which the provider returns.
    """
    return f"{_prefix(farm, request)}{fingerprint(state)[:16]}"


def _pending(farm: Farm, request: Request) -> list[str]:
    """Returns the cookie names of all login attempts that this browser has not completed."""
    return [name for name in _cookies(request) if name.startswith(_prefix(farm, request))]


def _prefix(farm: Farm, request: Request) -> str:
    return f"{cookie_name(farm.access, request.scope)}-login-"


def _cookies(request: Request) -> dict[str, str]:
    return cookie_parser(request.headers.get("cookie", ""))


def _oidc(farm: Farm) -> Oidc:
    if farm.access.oidc is None:
        raise NotFound(
            Sentence("openid-not-configured", "This farm has no OpenID provider. Log in with name and password, or with a link.")
        )
    return farm.access.oidc
