"""Tests of the container's health check, run as a separate program as in a container."""

from __future__ import annotations

import subprocess
import sys
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from service.http import gate
from tests.helpers import ROOT
from tests.service.conftest import Service, until


class Answers(BaseHTTPRequestHandler):
    status = 200

    def do_GET(self) -> None:
        self.send_response(self.status if self.path == "/readyz" else 404)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        pass


def is_healthy(port: int) -> bool:
    asked = subprocess.run([sys.executable, "-IS", str(ROOT / "service" / "healthy.py"), str(port)], check=False)
    return asked.returncode == 0


@pytest.mark.parametrize("status", [200, 503])
def test_ready_service_is_healthy(status: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Answers, "status", status)
    with HTTPServer(("127.0.0.1", 0), Answers) as server:
        threading.Thread(target=server.handle_request, daemon=True).start()
        assert is_healthy(server.server_port) == (status == 200)


def test_unreachable_service_is_unhealthy() -> None:
    with HTTPServer(("127.0.0.1", 0), Answers, bind_and_activate=False) as server:
        server.server_bind()
        assert not is_healthy(server.server_port)


def test_health_check_does_not_look_like_proxy(service: Service, caplog: pytest.LogCaptureFixture) -> None:
    gate._warn_of_proxy.cache_clear()
    until(lambda: is_healthy(service.port), "it is ready")
    assert [record for record in caplog.records if "proxy" in record.getMessage()] == []
