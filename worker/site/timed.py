"""Reads from a socket with a deadline for the whole, so that a sender of one byte now and then is waited for no longer than a
silent one."""

from __future__ import annotations

import io
import socket
import time
from typing import Any

__all__ = ["Timed"]


class Timed(io.RawIOBase):
    """What comes over a connection. Raises TimeoutError once its time is over."""

    def __init__(self, wire: socket.socket, seconds: float) -> None:
        self._wire = wire
        self.allow(seconds)

    def allow(self, seconds: float) -> None:
        """Let what comes from now on take so long."""
        self._until = time.monotonic() + seconds

    def readable(self) -> bool:
        """It is."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Bytes as they come; 0 at their end."""
        left_s = self._until - time.monotonic()
        if left_s <= 0.0:
            raise TimeoutError("it takes too long")
        self._wire.settimeout(left_s)
        return self._wire.recv_into(buffer)
