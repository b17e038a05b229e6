"""Sets HttpOnly cookies, which scripts cannot read."""

from __future__ import annotations

from typing import Literal

from starlette.requests import Request
from starlette.responses import Response

__all__ = ["set_cookie"]


def set_cookie(
    request: Request, response: Response, name: str, value: str, lasts_s: float, same_site: Literal["strict", "lax"] = "strict"
) -> None:
    """Sets a cookie that expires after `lasts_s` seconds; 0 deletes it."""
    response.set_cookie(
        name,
        value,
        max_age=int(lasts_s),
        path="/",
        secure=request.scope["scheme"] == "https",
        httponly=True,
        samesite=same_site,  # strict suffices: the page's files need no cookie, and its requests are same-site
    )
