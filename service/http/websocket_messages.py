"""Receives WebSocket messages without blocking the event loop.

Receiving a message that is already buffered does not suspend, so a flood of messages could otherwise occupy the event loop.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator

from fastapi import WebSocket, WebSocketDisconnect

__all__ = ["throttled_messages"]

RATE = 500.0  # messages a second accepted from one client continuously
BURST = 200.0  # messages accepted at once after a pause
CHARACTERS = 8192  # per additional message in the count


async def throttled_messages(socket: WebSocket) -> AsyncIterator[str]:
    """Yields each message as text, with pauses for other tasks. A binary message becomes "".

    Raises WebSocketDisconnect at the end.
    """
    left, at = BURST, time.monotonic()
    while True:
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            raise WebSocketDisconnect(message["code"])
        text = message.get("text") or ""
        yield text
        now = time.monotonic()
        left, at = min(left + (now - at) * RATE, BURST) - 1.0 - len(text) / CHARACTERS, now
        await asyncio.sleep(max(0.0, -left / RATE))
