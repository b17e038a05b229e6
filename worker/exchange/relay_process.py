"""Starts and ends the relay by which a worker without access to Redis reaches the farm's queue (relay.py)."""

from __future__ import annotations

import contextlib
import secrets
import subprocess
import sys

from renderer.sentences import Sentence
from worker.exchange.errors import LinkError
from worker.exchange.relay import RelaySettings

__all__ = ["RelayProcess"]

STOP_S = 5.0


class RelayProcess:
    """A running relay. redis_url: the address at which this worker's processes reach the farm's Redis through it."""

    def __init__(self, service: str, token: str) -> None:
        """Starts the relay. Raises LinkError if it does not start."""
        password = secrets.token_hex(16)
        command = [sys.executable, "-m", "worker.exchange.relay"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self._process.stdin is not None and self._process.stdout is not None
        port = b""
        with contextlib.suppress(OSError):
            self._process.stdin.write(RelaySettings(service, token, password).to_line())
            self._process.stdin.flush()
            port = self._process.stdout.readline()
        self._process.stdout.close()
        if not port.strip().isdigit():
            self.stop()
            raise LinkError(Sentence("relay-not-started", "the relay to the farm's queue does not start; see the log"))
        self.redis_url = f"redis://:{password}@127.0.0.1:{int(port)}/0"

    def is_running(self) -> bool:
        """Returns True if the relay has not ended."""
        return self._process.poll() is None

    def stop(self) -> None:
        """Ends the relay, and with it all connections through it."""
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()
        try:
            self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
