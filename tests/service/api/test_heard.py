"""Tests that a client that sends a flood of messages over one WebSocket leaves processor time for other tasks."""

from __future__ import annotations

import asyncio
import time
from typing import Any

from service.http.websocket_messages import BURST, CHARACTERS, RATE, throttled_messages

MOST = 200_000


class Flood:
    """A substitute for a WebSocket whose next message never has to be waited for."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.read = 0

    async def receive(self) -> dict[str, Any]:
        self.read += 1
        if self.read > MOST:
            raise AssertionError("nobody else had a turn")
        return {"type": "websocket.receive", "text": self.text}


def heard_while_others_work(text: str) -> float:
    """Returns the number of messages read from a flood in 0.2 s, relative to the number that the rate limit allows.

    text: the message that the flood repeats.
    """

    async def both() -> float:
        flood = Flood(text)

        async def listen() -> None:
            async for _ in throttled_messages(flood):  # type: ignore[arg-type]  # a socket as far as is asked of it
                pass

        begun = time.monotonic()
        listening = asyncio.create_task(listen())
        await asyncio.sleep(0.2)
        cost = 1.0 + len(text) / CHARACTERS
        allowed = (BURST + (time.monotonic() - begun) * RATE) / cost + 2
        assert not listening.done()
        listening.cancel()
        return flood.read / allowed

    return asyncio.run(both())


def test_message_flood_is_rate_limited() -> None:
    assert heard_while_others_work("{}") <= 1.0
    assert heard_while_others_work("x" * 100_000) <= 1.0
