"""WS /api/farm/channel: a worker's connection to Redis, for workers that reach only the service (protocol/channel.py)."""

from __future__ import annotations

import asyncio
import contextlib

from fastapi import WebSocket, WebSocketDisconnect

from protocol.channel import CHANNEL_PATH, ChannelOpen, ChannelRefused
from protocol.redis_commands import CommandError
from renderer.sentences import Sentence
from service.access.worker_channels import WorkerChannel
from service.errors import Unavailable
from service.http.farm import FarmDependency
from service.http.routers import api_router
from service.http.visit import VisitDependency

__all__ = ["router"]

router = api_router()

CLOSE_POLICY, CLOSE_TRY_LATER = 1008, 1013  # close codes of a WebSocket
_DISCONNECTED = (WebSocketDisconnect, RuntimeError, OSError)
NOT_OFFERED = Sentence(
    "channel-not-offered",
    "This farm takes no workers over HTTPS. Its administrator can allow them with RAYFARM_HTTPS_WORKERS=true.",
)


@router.websocket(CHANNEL_PATH)
async def channel(socket: WebSocket, farm: FarmDependency, visit: VisitDependency) -> None:
    """Passes the commands of a worker on to Redis, and the replies back, until either side closes the connection."""
    await socket.accept()
    if not farm.settings.https_workers:
        await _refuse(socket, ChannelRefused(NOT_OFFERED))
        return
    try:
        async with farm.channels.open(visit.caller.key if visit.caller is not None else None) as opened:
            await socket.send_text(ChannelOpen().to_text())
            await _pass_on(socket, opened)
    except Unavailable as error:
        await _refuse(socket, ChannelRefused(str(error), passing=True))


async def _pass_on(socket: WebSocket, opened: WorkerChannel) -> None:
    tasks = asyncio.create_task(_send_commands(socket, opened)), asyncio.create_task(_send_replies(socket, opened))
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        ends = await asyncio.gather(*tasks, return_exceptions=True)
    for error in ends:
        if isinstance(error, CommandError):
            await _refuse(socket, ChannelRefused(str(error)))
            return
        if isinstance(error, Exception) and not isinstance(error, _DISCONNECTED):
            raise error
    with contextlib.suppress(*_DISCONNECTED):
        await socket.close(CLOSE_TRY_LATER)


async def _send_commands(socket: WebSocket, opened: WorkerChannel) -> None:
    while (message := await socket.receive())["type"] == "websocket.receive":
        if data := message.get("bytes"):
            await opened.send(data)


async def _send_replies(socket: WebSocket, opened: WorkerChannel) -> None:
    while data := await opened.receive():
        await socket.send_bytes(data)


async def _refuse(socket: WebSocket, refusal: ChannelRefused) -> None:
    with contextlib.suppress(*_DISCONNECTED):
        await socket.send_text(refusal.to_text())
        await socket.close(CLOSE_TRY_LATER if refusal.passing else CLOSE_POLICY)
