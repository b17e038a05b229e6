"""Tests of `python -m service`: its listening address decides, through the settings, whether a login is required."""

from __future__ import annotations

import asyncio
import logging
import os
import shlex
import socket
from pathlib import Path

import httpx
import pytest
import uvicorn
from starlette.types import Receive, Scope, Send
from uvicorn.config import HTTP_PROTOCOLS
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from service.__main__ import serve
from service.connections import Connection
from service.settings import Settings
from tests.helpers import ROOT, running_redis
from tests.service.conftest import Service


def image_command() -> list[str]:
    """Returns the command of the service's container image, without `python3 -m service`."""
    lines = (ROOT / "Dockerfile").read_text().partition("AS service")[2].splitlines()
    (line,) = [line for line in lines if line.startswith("CMD") and '"service"' in line]
    words = [word.strip(",") for word in shlex.split(line.removeprefix("CMD").strip(" []"))]
    assert words[:3] == ["python3", "-m", "service"]
    return words[3:]


@pytest.mark.parametrize(
    ("arguments", "variables", "host", "port", "asks"),
    [
        ([], {}, "127.0.0.1", 8000, False),
        (["--port", "8001"], {}, "127.0.0.1", 8001, False),
        (["--log-level", "info", "--host=0.0.0.0"], {}, "0.0.0.0", 8000, True),
        (["--host", "0.0.0.0"], {"RAYFARM_HOST": "127.0.0.1"}, "0.0.0.0", 8000, True),
        ([], {"RAYFARM_HOST": "192.0.2.7", "RAYFARM_PORT": "8002"}, "192.0.2.7", 8002, True),
        (image_command(), {}, "0.0.0.0", 8000, True),
        (image_command(), {"RAYFARM_PUBLISHED": "127.0.0.1"}, "0.0.0.0", 8000, False),
    ],
)
def test_listening_address_follows_settings(
    arguments: list[str],
    variables: dict[str, str],
    host: str,
    port: int,
    asks: bool,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    told: list[list[str]] = []
    without = {name: value for name, value in os.environ.items() if not name.startswith("RAYFARM_")}
    monkeypatch.setattr(os, "environ", {**without, **variables})
    monkeypatch.setitem(HTTP_PROTOCOLS, "auto", HTTP_PROTOCOLS["auto"])
    monkeypatch.setattr(Connection, "most", Connection.most)
    monkeypatch.setattr(uvicorn, "main", lambda args, prog_name: told.append(args))
    serve(arguments)
    settings = Settings.read(data=tmp_path)
    assert (settings.host, settings.port, settings.needs_login) == (host, port, asks)
    kept_s = float(told[0][told[0].index("--timeout-keep-alive") + 1])
    assert kept_s > 2 * (httpx.Limits().keepalive_expiry or 0.0), "a client that asks again must not meet a server that hangs up"
    (all_told,) = told
    assert all_told[all_told.index("--host") + 1] == host
    assert all_told[all_told.index("--port") + 1] == str(port)
    assert all_told.count("--host") == 1


def test_remote_client_is_not_local(tmp_path: Path, redis_server: running_redis) -> None:
    """A client on another machine is not treated as local.

    This holds even if the settings do not name the address on which the server listens.
    """
    service = Service(tmp_path / "data", redis_server)

    async def status(address: str) -> int:
        way = httpx.ASGITransport(service.app, client=(address, 5000))
        async with httpx.AsyncClient(transport=way, base_url="http://localhost:8000") as client:
            return (await client.get("/api/jobs")).status_code

    try:
        for address, expected in (("127.0.0.1", 200), ("::ffff:127.0.0.1", 200), ("10.0.0.7", 401), ("2001:db8::7", 401)):
            assert asyncio.run(status(address)) == expected, address
    finally:
        service.stop()


def add_filters(monkeypatch: pytest.MonkeyPatch) -> None:
    """Adds the service's filters to uvicorn's loggers until the test ends."""
    for name in ("uvicorn.access", "uvicorn.error"):
        monkeypatch.setattr(logging.getLogger(name), "filters", [])
    monkeypatch.setattr(uvicorn, "main", lambda args, prog_name: None)
    monkeypatch.setitem(HTTP_PROTOCOLS, "auto", HTTP_PROTOCOLS["auto"])
    monkeypatch.setattr(Connection, "most", Connection.most)
    monkeypatch.setattr(os, "environ", dict(os.environ))
    serve([])


@pytest.mark.parametrize(
    ("path", "status", "kept"),
    [("/readyz", 200, False), ("/healthz", 200, False), ("/readyz", 503, True), ("/api/jobs", 200, True)],
)
def test_successful_probes_are_not_logged(path: str, status: int, kept: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Successful probes are not logged. The filter is added before uvicorn configures its loggers, and stays in effect."""
    access = logging.getLogger("uvicorn.access")
    add_filters(monkeypatch)
    uvicorn.Config("service.main:create_app", factory=True)
    line = logging.LogRecord(
        access.name, logging.INFO, "", 0, '%s - "%s %s HTTP/%s" %d', ("127.0.0.1:5", "GET", path, "1.1", status), None
    )
    assert bool(access.filter(line)) is kept


def test_accepted_websockets_are_not_logged(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """Lines about accepted and closed WebSockets, several for each page, would hide the others. Refused ones are logged."""

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await receive()
        await send({"type": "websocket.close"} if scope["path"] == "/refused" else {"type": "websocket.accept"})
        while (await receive())["type"] != "websocket.disconnect":
            pass

    async def visit() -> None:
        listening = socket.create_server(("127.0.0.1", 0))  # connections wait until the server accepts them
        server = uvicorn.Server(uvicorn.Config(app, lifespan="off", log_config=None))
        running = asyncio.create_task(server.serve([listening]))
        address = f"ws://127.0.0.1:{listening.getsockname()[1]}"
        async with connect(f"{address}/accepted"):
            pass
        with pytest.raises(InvalidStatus):
            await connect(f"{address}/refused")
        server.should_exit = True
        await running

    add_filters(monkeypatch)
    with caplog.at_level(logging.INFO, "uvicorn.error"):
        asyncio.run(visit())
    lines = [record.getMessage() for record in caplog.records if record.name == "uvicorn.error"]
    assert not [line for line in lines if "accepted" in line or line in ("connection open", "connection closed")], lines
    assert [line for line in lines if "/refused" in line and line.endswith("403")], lines
