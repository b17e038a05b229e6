"""A proxy that simulates a slow connection between two programs of one machine."""

from __future__ import annotations

import contextlib
import queue
import socket
import threading
import time
from collections.abc import Iterator
from urllib.parse import urlsplit

__all__ = ["held_up"]


@contextlib.contextmanager
def held_up(url: str, late_s: float = 0.0, rate: float | None = None) -> Iterator[str]:
    """Runs a proxy to the server at `url`, and yields the proxy's URL.

    late_s: latency in seconds, in both directions. rate: maximum bytes per second to the server, above which the sender is
    blocked; None: unlimited.
    """
    where = urlsplit(url)
    with socket.create_server(("127.0.0.1", 0)) as server:
        if rate is not None:
            server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        threading.Thread(target=_serve, args=(server, (where.hostname, where.port), late_s, rate), daemon=True).start()
        login = where.netloc.rpartition("@")
        yield where._replace(netloc=f"{login[0]}{login[1]}127.0.0.1:{server.getsockname()[1]}").geturl()


def _serve(server: socket.socket, to: tuple[str | None, int | None], late_s: float, rate: float | None) -> None:
    with contextlib.suppress(OSError):
        while True:
            here, _ = server.accept()
            there = socket.create_connection((to[0] or "127.0.0.1", to[1] or 6379))
            for ends, at_most in (((here, there), rate), ((there, here), None)):
                threading.Thread(target=_pass_on, args=(*ends, late_s, at_most), daemon=True).start()


def _pass_on(source: socket.socket, target: socket.socket, late_s: float, rate: float | None) -> None:
    under_way: queue.SimpleQueue[tuple[float, bytes]] = queue.SimpleQueue()
    threading.Thread(target=_arrive, args=(under_way, target), daemon=True).start()
    with contextlib.suppress(OSError):
        while data := source.recv(4096):
            if rate is not None:
                time.sleep(len(data) / rate)
            under_way.put((time.monotonic() + late_s, data))
    under_way.put((0.0, b""))


def _arrive(under_way: queue.SimpleQueue[tuple[float, bytes]], target: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while (found := under_way.get())[1]:
            time.sleep(max(found[0] - time.monotonic(), 0.0))
            target.sendall(found[1])
    with contextlib.suppress(OSError):
        target.shutdown(socket.SHUT_RDWR)
    target.close()
