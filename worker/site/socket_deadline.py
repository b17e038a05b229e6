"""Reads from a socket with a deadline for the whole, so that a sender of single bytes cannot hold it open."""

from __future__ import annotations

import io
import socket
import time
from typing import Any

__all__ = ["DeadlineReader"]


class DeadlineReader(io.RawIOBase):
    """The input of a connection. Raises TimeoutError after its deadline."""

    def __init__(self, wire: socket.socket, seconds: float) -> None:
        self._wire = wire
        self.allow(seconds)

    def allow(self, seconds: float) -> None:
        """Sets the deadline, in seconds from now."""
        self._until = time.monotonic() + seconds

    def readable(self) -> bool:
        """True, as io expects."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Reads available bytes; returns 0 at the end."""
        left_s = self._until - time.monotonic()
        if left_s <= 0.0:
            raise TimeoutError("it takes too long")
        self._wire.settimeout(left_s)
        return self._wire.recv_into(buffer)
