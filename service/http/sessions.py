"""Logout at the OpenID provider together with the farm: the browser keeps the ID token of its login for the provider."""

from __future__ import annotations

from starlette.requests import Request, cookie_parser
from starlette.responses import Response

from service.access.access import SESSION_S
from service.farm import Farm
from service.http.cookies import set_cookie
from service.http.gate import cookie_name

__all__ = ["base_url", "forget_login", "keep_login", "logout_url"]

LONGEST = 3500  # characters; browsers limit cookies to 4 kB
UNKNOWN = "-"  # a provider's session whose ID token is too long to store


def keep_login(request: Request, response: Response, farm: Farm, token: str) -> None:
    """Stores the ID token after a login through a provider. token: the ID token."""
    set_cookie(request, response, _cookie(farm, request), token if len(token) <= LONGEST else UNKNOWN, SESSION_S)


def forget_login(request: Request, response: Response, farm: Farm) -> None:
    """Deletes the stored ID token, when the browser's session ends or another one replaces it."""
    if (name := _cookie(farm, request)) in request.cookies:
        set_cookie(request, response, name, "", 0)


def logout_url(request: Request, farm: Farm) -> str | None:
    """Returns the URL that logs the browser out at the provider; None if there is none."""
    shown = cookie_parser(request.headers.get("cookie", "")).get(_cookie(farm, request), "")
    if not shown or farm.access.oidc is None:
        return None
    return farm.access.oidc.logout_url("" if shown == UNKNOWN else shown, f"{base_url(request, farm)}/")


def base_url(request: Request, farm: Farm) -> str:
    """Returns the address of the page, without the trailing slash."""
    return farm.settings.public_url.rstrip("/") or str(request.base_url).rstrip("/")


def _cookie(farm: Farm, request: Request) -> str:
    return f"{cookie_name(farm.access, request.scope)}-openid-hint"
