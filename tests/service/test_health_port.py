"""Tests of /healthz on a separate port: it responds at once while the event loop is busy, and reports a loop that hangs."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Iterator
from http.client import HTTPConnection
from typing import Any

import pytest

from service import health_port
from service.errors import StartupError
from service.health_port import HealthPort
from tests.helpers import wait_until


class Served:
    """A running health port, and the event loop that it watches, which tests can block."""

    def __init__(self) -> None:
        self.is_engine_alive = True
        self.health = HealthPort("127.0.0.1", 0, lambda: self.is_engine_alive)
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.loop.run_forever)
        self.thread.start()
        self.loop.call_soon_threadsafe(self.health.start, self.loop)

    def get(self, path: str = "/healthz") -> tuple[int, dict[str, Any]]:
        connection = HTTPConnection("127.0.0.1", self.health.port, timeout=20)
        connection.request("GET", path)
        answer = connection.getresponse()
        found = answer.status, json.loads(answer.read())
        connection.close()
        return found


@pytest.fixture
def served() -> Iterator[Served]:
    made = Served()
    yield made
    made.health.stop()
    made.loop.call_soon_threadsafe(made.loop.stop)
    made.thread.join()
    made.loop.close()


def test_busy_loop_is_healthy_and_hanging_loop_is_not(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    assert served.get()[0] == 200
    goes_on = threading.Event()
    served.loop.call_soon_threadsafe(goes_on.wait)
    wait_until(lambda: served.get()[1]["loop_waited_s"] > 0.5, 20, "it says how long the loop has waited")
    assert served.get()[0] == 200
    monkeypatch.setattr(health_port, "HANG_TIMEOUT_S", 0.1)
    status, body = served.get()
    assert status == 503
    assert body["detail"].startswith("The event loop has not had a turn")
    goes_on.set()
    wait_until(lambda: served.get()[0] == 200, 20, "the loop goes on")


def test_ended_engine_is_unhealthy(served: Served) -> None:
    served.is_engine_alive = False
    assert served.get() == (503, {"detail": "The scheduler has stopped. Restart the service."})
    assert served.get("/")[0] == 404


def test_port_in_use_gives_error(served: Served) -> None:
    with pytest.raises(StartupError, match="RAYFARM_HEALTH_PORT"):
        HealthPort("127.0.0.1", served.health.port, lambda: True)
