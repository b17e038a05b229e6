"""Forwards a standby's requests to the service that owns the farm."""

from __future__ import annotations

from starlette.datastructures import Headers
from starlette.responses import JSONResponse, PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from renderer.sentences import Sentence, joined_sentences
from service.errors import NotOwner, Unavailable
from service.http.client_address import PASSED_ON
from service.http.forward import OwnerClient
from service.http.problems import Problem
from service.http.security import SAFE_METHODS, send_error
from service.process_lifecycle import ServiceLifecycle
from service.settings import Settings

__all__ = ["StandbyMiddleware"]

RETRY_HEADERS = {"Retry-After": "1"}


class StandbyMiddleware:
    """ASGI middleware that forwards requests while this service is a standby.

    Placed between `SecurityMiddleware` and `AuthorizationMiddleware`.
    """

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self._app = app
        self._forward = OwnerClient(settings)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles a request in this process if this service owns the farm; otherwise forwards it to the owner."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            await self._forward.close()
            return
        life: ServiceLifecycle = scope["app"].state.life
        if not life.is_standby:
            try:
                await life.confirm()
            except NotOwner:
                pass  # ownership was lost while this process was suspended
            except Unavailable as error:
                await send_error(Problem(503, str(error), RETRY_HEADERS), scope, receive, send)
                return
            else:
                await self._app(scope, receive, send)
                return
        try:
            await self._send_standby_response(life, scope, receive, send)
        except Unavailable as error:
            if not life.is_standby and scope["type"] == "http" and scope["method"] in SAFE_METHODS:
                await self._app(scope, receive, send)  # this service has become the owner meanwhile
            else:
                await send_error(
                    Problem(503, joined_sentences(life.standby_reason, str(error)), RETRY_HEADERS), scope, receive, send
                )

    async def _send_standby_response(self, life: ServiceLifecycle, scope: Scope, receive: Receive, send: Send) -> None:
        path = scope["path"] if scope["type"] == "http" else ""
        owner = life.owner_url if PASSED_ON not in Headers(scope=scope) else ""
        if path == "/healthz" and life.is_alive:
            await JSONResponse({"status": "stands by"})(scope, receive, send)
        elif path == "/metrics":
            await PlainTextResponse("rayfarm_owner 0\n")(scope, receive, send)
        elif not owner:
            await send_error(Problem(503, life.standby_reason, RETRY_HEADERS), scope, receive, send)
        elif path == "/readyz":
            if not await self._forward.is_ready(owner, life.taken):
                raise Unavailable(Sentence("standby-not-ready", "The service that owns the farm is not ready."))
            await JSONResponse({"status": "stands by"})(scope, receive, send)
        elif scope["type"] == "http":
            await self._forward.request(owner, life.taken, scope, receive, send)
        else:
            await self._forward.socket(owner, life.taken, scope, receive, send)
