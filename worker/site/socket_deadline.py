"""Reads from a socket with a deadline for the whole request, so that a sender of single bytes cannot keep it open."""

from __future__ import annotations

import io
import socket
import time
from typing import Any

__all__ = ["DeadlineReader"]


class DeadlineReader(io.RawIOBase):
    """Input stream of a connection. Raises TimeoutError after its deadline."""

    def __init__(self, wire: socket.socket, seconds: float) -> None:
        self._wire = wire
        self.set_deadline(seconds)

    def set_deadline(self, seconds: float) -> None:
        """Sets the deadline: this many seconds from now."""
        self._until = time.monotonic() + seconds

    def readable(self) -> bool:
        """Returns True, as the io module requires."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Reads available bytes into the buffer; returns their number, 0 at the end."""
        left_s = self._until - time.monotonic()
        if left_s <= 0.0:
            raise TimeoutError("it takes too long")
        self._wire.settimeout(left_s)
        return self._wire.recv_into(buffer)
