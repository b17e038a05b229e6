"""Lingering close: reads on for a while after a response that precedes the end of the request's body.

A connection that is closed while data of the client is unread is reset, and a reset may reach the client before the response
does (RFC 9112, 9.6). A client whose upload is rejected would then see a broken connection instead of the reason.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from contextlib import suppress

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

__all__ = ["LingeringClose"]

LINGER_S = 10.0  # longest time for which the rest of a body is read and discarded


class LingeringClose:
    """ASGI middleware that ends a response only when the request's body has been read, or after `LINGER_S` seconds."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Calls the application. If it responds early, reads the rest of the body before the response ends."""
        headers: Mapping[str, str] = Headers(scope=scope) if scope["type"] == "http" else {}
        if headers.get("content-length", "0") == "0" and "transfer-encoding" not in headers:
            await self._app(scope, receive, send)
            return
        is_read = False

        async def receive_and_note() -> Message:
            nonlocal is_read
            message = await receive()
            is_read = is_read or message["type"] != "http.request" or not message.get("more_body", False)
            return message

        async def discard_rest() -> None:
            while not is_read:
                await receive_and_note()

        async def send_lingering(message: Message) -> None:
            if message["type"] != "http.response.body" or message.get("more_body", False) or is_read:
                await send(message)
                return
            await send({**message, "more_body": True})
            with suppress(TimeoutError):
                await asyncio.wait_for(discard_rest(), LINGER_S)
            await send({"type": "http.response.body"})

        await self._app(scope, receive_and_note, send_lingering)
