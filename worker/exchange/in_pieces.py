"""A connection to Redis over which what is large may take as long as the line needs, as long as some of it gets through.

Python's `sendall` takes a socket's time limit for the whole of what it is given. A result has hundreds of kilobytes, so over a
line of less than that in ten seconds none would ever arrive: each try is broken off, and begins anew. In pieces the limit is
for each of them.
"""

from __future__ import annotations

import socket
from collections.abc import Iterable, Iterator
from typing import Any

import redis
from redis.connection import AbstractConnection, ConnectionPool

__all__ = ["PIECE", "patient_redis"]

PIECE = 16 << 10  # bytes: within the ten seconds of a result's connection that is 1.6 kB a second


class _InPieces(AbstractConnection):
    def send_packed_command(self, command: bytes | str | Iterable[bytes], check_health: bool = True) -> None:
        """As the class it is mixed into."""
        whole = [command] if isinstance(command, (bytes, str)) else command
        super().send_packed_command(_pieces(whole), check_health)


def patient_redis(url: str, **options: Any) -> redis.Redis:
    """As `redis.Redis.from_url`, with a time limit for each piece of what is sent."""
    if (mark := getattr(socket, "TCP_NOTSENT_LOWAT", None)) is not None:  # else the kernel takes all of it at once, and the
        options |= {"socket_keepalive": True, "socket_keepalive_options": {mark: PIECE}}  # answer is what would take too long
    pool = ConnectionPool.from_url(url, **options)
    pool.connection_class = type("Connection", (_InPieces, pool.connection_class), {})
    connection = redis.Redis(connection_pool=pool)
    connection.auto_close_connection_pool = True
    return connection


def _pieces(items: Iterable[bytes | str]) -> Iterator[bytes]:
    for item in items:
        data = item.encode() if isinstance(item, str) else item
        for at in range(0, len(data), PIECE):
            yield data[at : at + PIECE]
