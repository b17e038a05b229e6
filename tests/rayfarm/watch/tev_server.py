"""A server in place of tev that stores received images; packets are decoded as in tev's src/Ipc.cpp."""

from __future__ import annotations

import socket
import struct
import threading

import numpy as np

__all__ = ["TevServer"]


class TevServer:
    """A substitute for tev, as a context manager. images: the received images (h, w, 3) by name."""

    def __init__(self, port: int = 0) -> None:
        self._server = socket.create_server(("127.0.0.1", port))
        self.address = f"127.0.0.1:{self._server.getsockname()[1]}"
        self.images: dict[str, np.ndarray] = {}
        self.updates = 0
        self._threads = [threading.Thread(target=self._serve, daemon=True)]

    def __enter__(self) -> TevServer:
        self._threads[0].start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()
        for thread in self._threads:
            thread.join(10)

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._server.accept()
            except OSError:
                return
            thread = threading.Thread(target=self._read, args=(connection,), daemon=True)
            self._threads.append(thread)
            thread.start()

    def _read(self, connection: socket.socket) -> None:
        with connection, connection.makefile("rb") as stream:
            while len(head := stream.read(4)) == 4:
                (length,) = struct.unpack("<I", head)
                self._take(_Fields(stream.read(length - 4)))

    def _take(self, fields: _Fields) -> None:
        kind = fields.number("b")
        if kind == 2:
            self.images.pop(fields.text(), None)
        elif kind == 4:
            assert fields.number("b") == 1
            name, width, height, count = fields.text(), *(fields.number("i") for _ in range(3))
            assert [fields.text() for _ in range(count)] == ["R", "G", "B"]
            self.images[name] = np.zeros((height, width, 3), np.float32)
            assert fields.is_empty()
        elif kind == 6:
            fields.number("b")
            name, count = fields.text(), fields.number("i")
            channels = ["RGB".index(fields.text()) for _ in range(count)]
            x, y, w, h = (fields.number("i") for _ in range(4))
            offsets = [fields.number("q") for _ in range(count)]
            strides = [fields.number("q") for _ in range(count)]
            size = max(o + (w * h - 1) * s + 1 for o, s in zip(offsets, strides, strict=True))
            data = np.frombuffer(fields.rest(), "<f4")
            assert data.size == size
            for channel, offset, stride in zip(channels, offsets, strides, strict=True):
                self.images[name][y : y + h, x : x + w, channel] = data[offset::stride].reshape(h, w)
            self.updates += 1
        else:
            raise AssertionError(f"packet of type {kind}")


class _Fields:
    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def number(self, format: str) -> int:
        (value,) = struct.unpack_from(f"<{format}", self._data, self._at)
        self._at += struct.calcsize(format)
        return int(value)

    def text(self) -> str:
        end = self._data.index(b"\0", self._at)
        found, self._at = self._data[self._at : end].decode(), end + 1
        return found

    def rest(self) -> bytes:
        found, self._at = self._data[self._at :], len(self._data)
        return found

    def is_empty(self) -> bool:
        return self._at == len(self._data)
