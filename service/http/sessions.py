"""Logout at the OpenID provider when a user logs out of the farm.

The provider requires the ID token of the login for this, so the token is stored in a cookie.
"""

from __future__ import annotations

from starlette.requests import Request, cookie_parser
from starlette.responses import Response

from service.access.access import SESSION_S
from service.farm import Farm
from service.http.cookies import set_cookie
from service.http.gate import cookie_name

__all__ = ["base_url", "forget_login", "keep_login", "logout_url"]

MAX_TOKEN_LENGTH = 3500  # characters; browsers limit cookies to 4 kB
UNKNOWN = "-"  # a provider's session whose ID token is too long to store


def keep_login(request: Request, response: Response, farm: Farm, token: str) -> None:
    """Stores the ID token of an OpenID login in a cookie."""
    set_cookie(request, response, _cookie_name(farm, request), token if len(token) <= MAX_TOKEN_LENGTH else UNKNOWN, SESSION_S)


def forget_login(request: Request, response: Response, farm: Farm) -> None:
    """Deletes the cookie with the ID token, when the session ends or is replaced by another one."""
    if (name := _cookie_name(farm, request)) in request.cookies:
        set_cookie(request, response, name, "", 0)


def logout_url(request: Request, farm: Farm) -> str | None:
    """Returns the URL that logs the browser out at the provider; None if the login did not use one."""
    shown = cookie_parser(request.headers.get("cookie", "")).get(_cookie_name(farm, request), "")
    if not shown or farm.access.oidc is None:
        return None
    return farm.access.oidc.logout_url("" if shown == UNKNOWN else shown, f"{base_url(request, farm)}/")


def base_url(request: Request, farm: Farm) -> str:
    """Returns the base URL of the page, without a trailing slash."""
    return farm.settings.public_url.rstrip("/") or str(request.base_url).rstrip("/")


def _cookie_name(farm: Farm, request: Request) -> str:
    return f"{cookie_name(farm.access, request.scope)}-openid-hint"
