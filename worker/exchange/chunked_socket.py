"""Redis connection for large commands on slow connections: the timeout applies to each chunk sent, not to the whole command.

Python's `sendall` applies a socket's timeout to the whole buffer. A result has hundreds of kilobytes. If sending it took longer
than the timeout of ten seconds, every attempt would fail and start again.
"""

from __future__ import annotations

import socket
from collections.abc import Iterable, Iterator
from typing import Any

import redis
from redis.connection import AbstractConnection, ConnectionPool

__all__ = ["PIECE", "chunked_redis"]

PIECE = 16 << 10  # bytes: with a timeout of ten seconds, at least 1.6 kB/s


class _InPieces(AbstractConnection):
    def send_packed_command(self, command: bytes | str | Iterable[bytes], check_health: bool = True) -> None:
        """Sends a command in chunks of at most PIECE bytes; otherwise like the base class."""
        whole = [command] if isinstance(command, (bytes, str)) else command
        super().send_packed_command(_pieces(whole), check_health)


def chunked_redis(url: str, **options: Any) -> redis.Redis:
    """Returns a client like `redis.Redis.from_url`, with the timeout applied to each chunk that is sent."""
    if (mark := getattr(socket, "TCP_NOTSENT_LOWAT", None)) is not None:  # otherwise the kernel buffers it all, and
        options |= {"socket_keepalive": True, "socket_keepalive_options": {mark: PIECE}}  # waiting for the reply would time out
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
