"""A client that views a scene over the WebSocket, as the page does."""

from __future__ import annotations

import contextlib
import json
import struct
import time
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from websockets.sync.client import ClientConnection, connect

from protocol.pictures import DRAFT, DraftHead
from renderer.image import rgbe9995
from tests.service.conftest import Service, until

__all__ = ["SIZE", "Viewer", "body_of", "look", "unpacked"]

HEADER, TILE = struct.Struct("<BBHIIHHHH"), struct.Struct("<HHHHI")
EXACT = 1 << 31
SIZE = {"width": 96, "height": 64}


class Viewer:
    """A client of a live view: receives its messages, and assembles the picture from tiles as the page does."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.acknowledges = True
        self.states: list[dict[str, Any]] = []
        self.errors: list[dict[str, Any]] = []
        self.picked: list[dict[str, Any]] = []
        self.people: list[dict[str, Any]] = []
        self.take_changes: list[dict[str, Any]] = []
        self.pictures: list[tuple[int, tuple[int, int]]] = []  # view id and size of each picture
        self.drafts: list[tuple[DraftHead, bytes]] = []
        self.seq = 0
        self.words = np.zeros((0, 0), np.uint32)
        self.samples = np.zeros((0, 0), np.uint32)
        self.is_exact = np.zeros((0, 0), bool)

    def say(self, **message: Any) -> None:
        self.connection.send(json.dumps(message))

    def show(self, id: int, **view: Any) -> None:
        self.say(id=id, **{**SIZE, **view})

    def begin_again(self) -> None:
        """Resets the picture, since the service may start it again from no samples."""
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
            lists = {"state": self.states, "error": self.errors, "picked": self.picked, "people": self.people}
            lists["takes"] = self.take_changes
            lists[said.pop("type")].append(said)

    def read_take_changes(self) -> list[dict[str, Any]]:
        """Reads what has arrived; returns all messages about takes."""
        self.read()
        return self.take_changes

    def _take(self, message: bytes) -> None:
        if message[1] == DRAFT.kind:
            head = DRAFT.unpack(message)
            assert head.seq == self.seq + 1
            self.seq = head.seq
            self.drafts.append((head, message[DRAFT.size :]))
            if self.acknowledges:
                self.say(ack=head.seq)
            return
        version, kind, count, id, seq, width, height, _, _ = HEADER.unpack_from(message)
        assert (version, kind) == (2, 3)
        assert seq == self.seq + 1
        self.seq = seq
        if self.words.shape != (height, width) or (self.pictures and self.pictures[-1][0] != id):
            self.words, self.samples = np.zeros((2, height, width), np.uint32)
            self.is_exact = np.zeros((height, width), bool)
        self.pictures.append((id, (width, height)))
        heads = [TILE.unpack_from(message, HEADER.size + number * TILE.size) for number in range(count)]
        for (x, y, w, h, told), words in zip(heads, unpacked(heads, body_of(message)), strict=True):
            samples = told & ~EXACT
            self.words[y : y + h, x : x + w] = words
            assert (self.samples[y : y + h, x : x + w] <= samples).all(), "never an older picture"
            self.samples[y : y + h, x : x + w] = samples
            self.is_exact[y : y + h, x : x + w] = bool(told & EXACT)
        if self.acknowledges:
            self.say(ack=seq)

    def wait(self, id: int, samples: int) -> None:
        """Waits until the full-size picture of view `id` has at least `samples` samples per pixel."""

        def has_come() -> bool:
            self.read()
            is_whole = self.pictures and self.pictures[-1][0] == id and self.words.shape == (64, 96)
            return bool(is_whole and self.samples.min() >= samples)

        until(has_come, f"view {id} has {samples} samples", say=lambda: (self.states[-2:], self.errors, self.pictures[-3:]))


def body_of(message: bytes) -> np.ndarray:
    """Returns the decompressed bytes that follow a message's tile headers."""
    (count,) = struct.unpack_from("<H", message, 2)
    return np.frombuffer(zlib.decompress(message[HEADER.size + count * TILE.size :], -15), np.uint8)


def unpacked(heads: list[tuple[int, int, int, int, int]], body: np.ndarray) -> list[np.ndarray]:
    """Returns the pixels of each tile as RGB9E5 words (h, w), decoded from a message's body.

    heads: (x, y, w, h, flags) of each tile; tiles without the flag EXACT are encoded with reduced precision.
    """
    rough = [(w, h) for _, _, w, h, told in heads if not told & EXACT]
    exact = [(w, h) for _, _, w, h, told in heads if told & EXACT]
    pixels, fours = sum(w * h for w, h in rough), sum(-(-w // 2) * -(-h // 2) for w, h in rough)
    low, high, red, green, planes = np.split(body, np.cumsum([pixels, pixels, fours, fours]))
    folded = low.astype(int) | high.astype(int) << 8
    codes = np.cumsum(folded >> 1 ^ -(folded & 1))
    bright = np.where(codes > 0, 2.0 ** ((codes - 1) // 32 - 24) * (1 + (codes - 1) % 32 / 32), 0) / 255
    hues = np.stack([np.cumsum(plane) & 255 for plane in (red, green)])
    rough_words, exact_words, of_exact = [], [], planes.reshape(4, -1).T.copy().view("<u4")[:, 0]
    for w, h in rough:
        (brightness, bright), wide = np.split(bright, [w * h]), -(-w // 2)
        here, hues = np.split(hues, [wide * -(-h // 2)], axis=1)
        r, g = here.reshape(2, -1, wide).repeat(2, 1).repeat(2, 2)[:, :h, :w]
        rgb = brightness.reshape(h, w, 1) * np.stack([r, g, np.maximum(0, 255 - r - g)], -1)
        rough_words.append(rgbe9995.pack(rgb.astype(np.float32)))
    for w, h in exact:
        here, of_exact = np.split(of_exact, [w * h])
        exact_words.append(here.reshape(h, w))
    assert not (bright.size or hues.size or of_exact.size)
    left = iter(rough_words), iter(exact_words)
    return [next(left[bool(told & EXACT)]) for *_, told in heads]


@contextlib.contextmanager
def look(service: Service, scene: str) -> Iterator[Viewer]:
    address = f"ws://127.0.0.1:{service.port}/api/scenes/{scene}/viewport"
    with connect(address, max_size=None) as connection:
        yield Viewer(connection)
