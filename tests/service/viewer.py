"""One who looks at a scene over the WebSocket, as the page does."""

from __future__ import annotations

import contextlib
import json
import struct
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from websockets.sync.client import ClientConnection, connect

from tests.service.conftest import Service, until

__all__ = ["SIZE", "Viewer", "look"]

HEADER, TILE = struct.Struct("<BBHIIHHHH"), struct.Struct("<HHHHI")
SIZE = {"width": 96, "height": 64}


class Viewer:
    """Reads what comes, and puts the picture together as the page does."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.acknowledges = True
        self.states: list[dict[str, Any]] = []
        self.errors: list[dict[str, Any]] = []
        self.picked: list[dict[str, Any]] = []
        self.pictures: list[tuple[int, tuple[int, int]]] = []  # whose, and their sizes
        self.seq = 0
        self.words = np.zeros((0, 0), np.uint32)
        self.samples = np.zeros((0, 0), np.uint32)

    def say(self, **message: Any) -> None:
        self.connection.send(json.dumps(message))

    def show(self, id: int, **view: Any) -> None:
        self.say(id=id, **{**SIZE, **view})

    def begin_again(self) -> None:
        """The service may forget what it has shown."""
        self.words = np.zeros((0, 0), np.uint32)

    def read(self, seconds: float = 0.05) -> None:
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0:
            try:
                message = self.connection.recv(timeout=left)
            except TimeoutError:
                return
            if isinstance(message, bytes):
                self._take(message)
                continue
            said = json.loads(message)
            {"state": self.states, "error": self.errors, "picked": self.picked}[said.pop("type")].append(said)

    def _take(self, message: bytes) -> None:
        version, kind, count, id, seq, width, height, _, _ = HEADER.unpack_from(message)
        assert (version, kind) == (1, 3)
        assert seq == self.seq + 1
        self.seq = seq
        if self.words.shape != (height, width) or (self.pictures and self.pictures[-1][0] != id):
            self.words, self.samples = np.zeros((2, height, width), np.uint32)
        self.pictures.append((id, (width, height)))
        at = HEADER.size + count * TILE.size
        for number in range(count):
            x, y, w, h, samples = TILE.unpack_from(message, HEADER.size + number * TILE.size)
            self.words[y : y + h, x : x + w] = np.frombuffer(message, "<u4", w * h, at).reshape(h, w)
            assert (self.samples[y : y + h, x : x + w] <= samples).all(), "never an older picture"
            self.samples[y : y + h, x : x + w] = samples
            at += 4 * w * h
        assert at == len(message)
        if self.acknowledges:
            self.say(ack=seq)

    def wait(self, id: int, samples: int) -> None:
        """Until the whole view has so many samples, and is seen so."""

        def has_come() -> bool:
            self.read()
            is_whole = self.pictures and self.pictures[-1][0] == id and self.words.shape == (64, 96)
            return bool(is_whole and self.samples.min() >= samples)

        until(has_come, f"view {id} has {samples} samples", say=lambda: (self.states[-2:], self.errors, self.pictures[-3:]))


@contextlib.contextmanager
def look(service: Service, scene: str) -> Iterator[Viewer]:
    address = f"ws://127.0.0.1:{service.port}/api/scenes/{scene}/viewport"
    with connect(address, max_size=None) as connection:
        yield Viewer(connection)
