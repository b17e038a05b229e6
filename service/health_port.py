"""Serves /healthz on a separate port and thread, so that a busy service is not considered dead.

On the main port the event loop answers /healthz, possibly late. On this port the time since the loop's last iteration decides:
a loop that hangs needs a restart, one that is busy does not.
"""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from service.errors import StartupError

__all__ = ["HealthPort"]

TICK_S = 0.25
HANG_TIMEOUT_S = 20.0  # seconds without a turn after which the loop counts as hanging
CLIENT_TIMEOUT_S = 5.0  # seconds; timeout of a client's connection


class HealthPort:
    """Health server. Start and stop it in the event loop's thread."""

    def __init__(self, host: str, port: int, is_engine_alive: Callable[[], bool]) -> None:
        """Binds the port. Raises StartupError if that fails.

        is_engine_alive: returns True while the engine's thread runs.
        """
        self._is_engine_alive = is_engine_alive
        self._ticked = time.monotonic()
        self._handle: asyncio.TimerHandle | None = None
        handler = type("Handler", (_Handler,), {"health": self})
        try:
            self._server = _Server((host, port), handler)
        except OSError as error:
            raise StartupError(
                f"Cannot listen at {host}:{port} ({error}). Set RAYFARM_HEALTH_PORT to a port that is free."
            ) from None
        self.port = self._server.server_port

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Starts the server, and begins to measure how late the iterations of the event loop are."""
        self._record_tick(loop)
        threading.Thread(target=self._server.serve_forever, name="health", daemon=True).start()

    def stop(self) -> None:
        """Stops serving."""
        if self._handle is not None:
            self._handle.cancel()
        self._server.shutdown()
        self._server.server_close()

    def failure_reason(self) -> str | None:
        """Returns a sentence on why the process should be restarted; None if it is healthy."""
        if not self._is_engine_alive():
            return "The scheduler has stopped. Restart the service."
        if self.waited_s > HANG_TIMEOUT_S:
            return f"The event loop has not had a turn for {self.waited_s:.0f} s. Restart the service."
        return None

    @property
    def waited_s(self) -> float:
        """Seconds by which the event loop's next iteration is overdue; 0 if it is on time."""
        return max(0.0, time.monotonic() - self._ticked - TICK_S)

    def _record_tick(self, loop: asyncio.AbstractEventLoop) -> None:
        self._ticked = time.monotonic()
        self._handle = loop.call_later(TICK_S, self._record_tick, loop)


class _Server(ThreadingHTTPServer):
    daemon_threads = True


class _Handler(BaseHTTPRequestHandler):
    health: HealthPort
    timeout = CLIENT_TIMEOUT_S

    def do_GET(self) -> None:
        if self.path != "/healthz":
            return self._send_json(HTTPStatus.NOT_FOUND, {"detail": "Only /healthz is served here."})
        why = self.health.failure_reason()
        if why is not None:
            return self._send_json(HTTPStatus.SERVICE_UNAVAILABLE, {"detail": why})
        return self._send_json(HTTPStatus.OK, {"status": "ok", "loop_waited_s": round(self.health.waited_s, 3)})

    def _send_json(self, status: HTTPStatus, body: dict[str, Any]) -> None:
        data = json.dumps(body).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, format: str, *arguments: Any) -> None:
        """Does nothing: probes come every second and are not logged."""
