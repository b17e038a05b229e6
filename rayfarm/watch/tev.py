"""Sends a film to tev (https://github.com/Tom94/tev) over its TCP protocol while the film grows.

A packet is little-endian: u32 total length, u8 type, then fields; texts end with a zero byte, a bool is a byte.

    CloseImage     2  name
    CreateImage    4  grab focus, name, i32 width, height, channels, their names
    UpdateImageV3  6  grab focus, name, i32 channels, their names, i32 x, y, width, height, i64 offsets, i64 strides, floats

Source: tev's include/tev/Ipc.h and src/Ipc.cpp.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time

import numpy as np
import numpy.typing as npt

from rayfarm.errors import CommandError
from rayfarm.watch.live import LiveJob
from renderer.settings import Tile

__all__ = ["PORT", "Tev", "TevFeed", "address_of"]

F32 = npt.NDArray[np.float32]
PORT = 14158
CLOSE_IMAGE, CREATE_IMAGE, UPDATE_IMAGE_V3 = 2, 4, 6
CHANNELS = ("R", "G", "B")
PATIENCE_S = 5.0
LOOK_EVERY_S = 0.1
AGAIN_AFTER_S = 2.0
STRIP = 128  # rows at a time, of a whole picture


def address_of(text: str) -> tuple[str, int]:
    """Parses the address of tev: empty for the default, HOST, or HOST:PORT. Raises CommandError."""
    host, _, port = text.rpartition(":") if ":" in text else (text, "", str(PORT))
    if not (port.isdecimal() and 0 < int(port) < 65536):
        raise CommandError(f"--tev is {text!r}; it takes HOST:PORT, as --tev 127.0.0.1:{PORT}")
    return host.strip("[]") or "127.0.0.1", int(port)


class Tev:
    """A connection to a running tev. Methods raise OSError if it is gone."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._socket = socket.create_connection(address, timeout=PATIENCE_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def close(self) -> None:
        """Closes the connection. The image in tev stays."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)
        self._socket.close()

    def create(self, name: str, width: int, height: int) -> None:
        """Creates a black image in tev; replaces an image of the same name."""
        self._send(CLOSE_IMAGE, _text(name))
        self._send(CREATE_IMAGE, b"\1", _text(name), struct.pack("<iii", width, height, len(CHANNELS)), *map(_text, CHANNELS))

    def update(self, name: str, x: int, y: int, rgb: F32) -> None:
        """Updates a rectangle at x, y with linear Rec.709 radiance of shape (h, w, 3)."""
        count = len(CHANNELS)
        for top in range(0, rgb.shape[0], STRIP):
            strip = rgb[top : top + STRIP]
            height, width = strip.shape[:2]
            self._send(
                UPDATE_IMAGE_V3,
                b"\0",
                _text(name),
                struct.pack("<i", count),
                *map(_text, CHANNELS),
                struct.pack("<iiii", x, y + top, width, height),
                struct.pack(f"<{2 * count}q", *range(count), *[count] * count),
                np.ascontiguousarray(strip, "<f4").tobytes(),
            )

    def _send(self, kind: int, *fields: bytes) -> None:
        body = b"".join(fields)
        self._socket.sendall(struct.pack("<IB", 5 + len(body), kind) + body)


class TevFeed:
    """Sends the changes of a job's film to tev, in a thread. If tev was restarted, sends the whole film."""

    def __init__(self, live: LiveJob, address: tuple[str, int]) -> None:
        """Connects to tev. Raises CommandError if no tev answers."""
        self._live = live
        self._address = address
        try:
            self._tev: Tev | None = Tev(address)
        except OSError as error:
            raise CommandError(
                f"No tev answers at {address[0]}:{address[1]} ({error.strerror or error}). "
                "Start tev first, or name it by --tev HOST:PORT."
            ) from None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="tev", daemon=True)
        self._life = -1
        self._known: dict[Tile, int] = {}  # tiles, and which of their versions was sent

    def __enter__(self) -> TevFeed:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Sends the remaining changes and ends the thread."""
        self._stop.set()
        self._thread.join(PATIENCE_S)
        if self._tev is not None:
            self._tev.close()

    def finish(self, film: F32) -> None:
        """Sends the final film to tev as a whole: the values of the job's EXR file."""
        self._stop.set()
        self._thread.join(PATIENCE_S)
        with contextlib.suppress(OSError):
            tev = self._tev or Tev(self._address)
            self._tev = tev
            if self._life < 0:
                tev.create(self._name, film.shape[1], film.shape[0])
            tev.update(self._name, 0, 0, film)

    @property
    def _name(self) -> str:
        job = self._live.job
        shot = f" frame {self._live.frame:g}" if job.shot is not None else ""
        return f"{job.name or 'Rayfarm'}{shot} ({job.id})"

    def _run(self) -> None:
        again_at = 0.0
        while True:
            ends = self._stop.is_set()
            if self._tev is None and time.monotonic() >= again_at:
                with contextlib.suppress(OSError):
                    self._tev, self._life = Tev(self._address), -1
            if self._tev is not None:
                try:
                    self._send(self._tev)
                except OSError:
                    self._tev.close()
                    self._tev = None
            if self._tev is None:
                again_at = max(again_at, time.monotonic() + AGAIN_AFTER_S)
            if ends:
                return
            self._stop.wait(LOOK_EVERY_S)

    def _send(self, tev: Tev) -> None:
        life, film, versions = self._live.versions()
        if film is None:
            return
        if life != self._life:
            tev.create(self._name, film.shape[1], film.shape[0])
            self._life, self._known = life, {}
        for tile, version in versions.items():
            if self._known.get(tile) != version:
                tev.update(self._name, tile.x, tile.y, film[tile.y : tile.y + tile.h, tile.x : tile.x + tile.w])
                self._known[tile] = version


def _text(text: str) -> bytes:
    return text.encode(errors="replace").replace(b"\0", b" ") + b"\0"
