"""Server of the page's files without a farm, which sends a fixed picture over the job's live channel."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import uvicorn
from fastapi import FastAPI, WebSocket, WebSocketDisconnect
from fastapi.responses import HTMLResponse
from fastapi.staticfiles import StaticFiles
from playwright.sync_api import Page

from protocol.pictures import encode_tile
from rayfarm.local.farm import free_port
from renderer.image import rgbe9995

__all__ = ["HEIGHT", "WIDTH", "Site", "call", "film_message", "sample_radiance"]

WEB = Path(__file__).resolve().parents[2] / "web"
WIDTH, HEIGHT = 64, 48


def sample_radiance() -> np.ndarray:
    """Returns colours from black to far above white, (HEIGHT, WIDTH, 3) float32."""
    random = np.random.default_rng(7)
    film = np.exp2(random.uniform(-12, 9, (HEIGHT, WIDTH, 1))) * random.uniform(0, 1, (HEIGHT, WIDTH, 3))
    film[0, 0] = 0
    return film.astype(np.float32)


def film_message(seq: int, film: np.ndarray, spp: int) -> bytes:
    """Returns the binary message of the live channel that has the whole film as one tile. seq: the message's sequence number."""
    return encode_tile(0, seq, (0, 0, WIDTH, HEIGHT), spp, rgbe9995.pack(film).astype("<u4").tobytes())


class Site:
    """Serves the page's files, and a live picture over a WebSocket.

    The first client is disconnected after its first acknowledgement. `acks` has the sequence numbers that clients acknowledged.
    """

    def __init__(self) -> None:
        self.watchers = 0
        self.acks: list[int] = []
        app = FastAPI()
        app.add_api_websocket_route("/api/jobs/{id}/live", self.live)
        app.add_api_route("/blank", lambda: HTMLResponse("<!doctype html><title>Blank</title>"))
        app.mount("/", StaticFiles(directory=WEB))
        self.port = free_port("127.0.0.1")
        self.server = uvicorn.Server(uvicorn.Config(app, port=self.port, log_level="error"))
        self.thread = threading.Thread(target=self.server.run, daemon=True)
        self.thread.start()
        while not self.server.started:
            time.sleep(0.01)
        self.url = f"http://127.0.0.1:{self.port}"

    async def live(self, socket: WebSocket, id: str) -> None:
        await socket.accept()
        self.watchers += 1
        first = self.watchers == 1
        await socket.send_text(json.dumps({"type": "state", "job": {"id": id}}))
        await socket.send_bytes(film_message(self.watchers, sample_radiance(), 10 * self.watchers))
        try:
            self.acks.append(json.loads(await asyncio.wait_for(socket.receive_text(), 10))["ack"])
            if first:
                await socket.close(1012)
            else:
                await socket.receive_text()
        except WebSocketDisconnect:
            return


def call(page: Page, module: str, body: str, argument: Any = None) -> Any:
    """Runs JavaScript in the browser page, and returns its result.

    body: of an async function, in which `m` is the page's module `module`, and `a` is `argument`.
    """
    return page.evaluate(f"async (a) => {{ const m = await import('/js/{module}.js'); {body} }}", argument)
