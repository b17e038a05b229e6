"""Tests of live connections: the WebSocket's snapshot, tiles and acknowledgements, and the event stream."""

from __future__ import annotations

import contextlib
import json
import struct
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from renderer import film as film_math
from renderer.image import rgbe9995
from renderer.settings import Tile
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_sums


class Watcher:
    """Reads the messages of a job's live WebSocket; acknowledges each only if a test requests it."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.states: list[dict[str, Any]] = []
        self.sequences: list[int] = []
        self.spp: dict[Tile, int] = {}
        self.history: list[tuple[Tile, int]] = []
        self.words: dict[Tile, np.ndarray] = {}

    def read(self, seconds: float, acknowledge: bool = True) -> None:
        """Receives messages until none arrives for a while, the job has ended, or `seconds` have passed."""
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0:
            try:
                message = self.connection.recv(timeout=left)
            except TimeoutError:
                return
            if isinstance(message, str):
                self.states.append(json.loads(message)["job"])
                continue
            version, kind, frame, sequence, x, y, w, h, spp = struct.unpack_from("<BBHIHHHHI", message)
            assert (version, kind, frame) == (1, 1, 0)
            tile = Tile(x, y, w, h)
            self.sequences.append(sequence)
            self.spp[tile] = spp
            self.history.append((tile, spp))
            self.words[tile] = np.frombuffer(message, "<u4", offset=20).reshape(h, w)
            if acknowledge:
                self.acknowledge(sequence)

    def acknowledge(self, sequence: int) -> None:
        self.connection.send(json.dumps({"ack": sequence}))


@contextlib.contextmanager
def watch(service: Service, job: str, query: str = "", **options: Any) -> Iterator[Watcher]:
    with connect(f"ws://127.0.0.1:{service.port}/api/jobs/{job}/live{query}", max_size=None, **options) as connection:
        yield Watcher(connection)


@pytest.mark.long
def test_viewer_of_finished_job_gets_film(service: Service, worker: PeerWorker) -> None:
    job = service.submit(service.ready_scene())
    service.wait_for(job, "finished")
    with watch(service, job) as watcher:
        watcher.read(1.0)
    assert watcher.states[0]["state"] == "finished"
    assert len(watcher.words) == 12
    assert watcher.sequences == sorted(set(watcher.sequences))
    for tile, words in watcher.words.items():
        expected = film_math.mean(expected_sums(tile, 0, 8, 0), 24)
        np.testing.assert_array_equal(words, rgbe9995.pack(expected))
        assert watcher.spp[tile] == 8


@pytest.mark.long
def test_viewer_gets_growing_picture(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.01)
    job = service.submit(service.ready_scene(), spp=60)
    with watch(service, job) as watcher:
        until(lambda: (watcher.read(0.3), bool(watcher.states) and watcher.states[-1]["state"] == "finished")[1], "the job ends")
        watcher.read(0.5)
    assert {state["state"] for state in watcher.states} >= {"running", "finished"}
    assert all(spp == 60 for spp in watcher.spp.values())
    seen: dict[Tile, list[int]] = {}
    for tile, spp in watcher.history:
        seen.setdefault(tile, []).append(spp)
    assert len(seen) == 12
    assert all(counts == sorted(counts) for counts in seen.values()), "never an older picture"
    assert any(len(counts) > 1 for counts in seen.values())


@pytest.mark.long
def test_slow_viewer_gets_fewer_but_latest_pictures(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.005)
    scene = service.ready_scene()
    job = service.submit(scene, spp=60)
    with watch(service, job) as watcher:
        service.wait_for(job, "finished")
        watcher.read(1.0, acknowledge=False)
        unacknowledged = len(watcher.history)
        assert unacknowledged <= 24, "two rounds at most"
        assert min(watcher.spp.values(), default=0) < 60
        while watcher.sequences and len(watcher.history) < 200:
            before = len(watcher.history)
            watcher.acknowledge(watcher.sequences[-1])
            watcher.read(0.5, acknowledge=False)
            if len(watcher.history) == before:
                break
        assert all(watcher.spp[tile] == 60 for tile in watcher.spp)
        assert len(watcher.spp) == 12
        assert len(watcher.history) <= unacknowledged + 12, "what changed meanwhile comes once"


@pytest.mark.long
def test_invalid_viewer_messages_are_ignored(service: Service, worker: PeerWorker) -> None:
    job = service.submit(service.ready_scene())
    with watch(service, job) as watcher:
        for nonsense in ("", "[]", "{}", '{"ack": "x"}', "nonsense", '{"ack": -5}', '{"ack": 1e400}', "[" * 100_000, b"\0"):
            watcher.connection.send(nonsense)
        service.wait_for(job, "finished")
        watcher.read(1.0)
        assert len(watcher.words) == 12


def test_viewer_of_missing_or_deleted_job_is_closed(service: Service, worker: PeerWorker) -> None:
    with watch(service, "nothing") as watcher, pytest.raises(ConnectionClosed) as closed:
        watcher.read(2.0)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 4404
    job = service.submit(service.ready_scene())
    with watch(service, job) as watcher, pytest.raises(ConnectionClosed) as closed:
        service.http.delete(f"/api/jobs/{job}")
        watcher.read(7.0)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 4410


def test_foreign_origin_cannot_open_live_channel(service: Service) -> None:
    with pytest.raises(InvalidStatus), watch(service, "nothing", origin="https://elsewhere.example"):
        pass


@pytest.mark.long
def test_viewers_do_not_delay_service_stop(service: Service, worker: PeerWorker) -> None:
    job = service.submit(service.ready_scene(), spp=500)
    with watch(service, job) as watcher:
        watcher.read(0.2)
        begun = time.monotonic()
        service.stop()
        assert time.monotonic() - begun < 5
    service.start()


@pytest.mark.long
def test_event_stream_has_scenes_jobs_and_workers(service: Service, worker: PeerWorker) -> None:
    events: list[tuple[str, dict[str, Any]]] = []
    opened, done = threading.Event(), threading.Event()

    def listen() -> None:
        with service.http.stream("GET", "/api/events") as stream:
            assert stream.headers["content-type"].startswith("text/event-stream")
            kind = ""
            for line in stream.iter_lines():
                opened.set()
                if line.startswith("event: "):
                    kind = line.removeprefix("event: ")
                elif line.startswith("data: "):
                    events.append((kind, json.loads(line.removeprefix("data: "))))
                if done.is_set():
                    return

    thread = threading.Thread(target=listen, daemon=True)
    thread.start()
    opened.wait(5)
    job = service.submit(service.ready_scene())
    service.wait_for(job, "finished")
    until(lambda: any(k == "job" and d["id"] == job and d.get("state") == "finished" for k, d in events), "the end is told")
    service.http.delete(f"/api/jobs/{job}")
    until(lambda: ("job", {"id": job, "deleted": True}) in events, "the deletion is told")
    assert {"ready"} <= {d["status"] for k, d in events if k == "scene"}
    until(lambda: any(k == "worker" and d["name"] == "peer" for k, d in events), "the worker is told of")
    done.set()
    service.submit(service.ready_scene())
    thread.join(5)


def film_of(service: Service, job: str, **headers: str) -> tuple[list[int], np.ndarray, int]:
    """Requests a frame's whole film; returns (samples per pixel of each tile, RGB9E5 words (h, w), side of a tile in pixels)."""
    answer = service.http.get(f"/api/jobs/{job}/frames/0/film", headers=headers).raise_for_status()
    version, kind, frame, width, height, side = struct.unpack_from("<BBHHHI", answer.content)
    assert (version, kind, frame) == (1, 2, 0)
    tiles = -(-width // side) * -(-height // side)
    samples = np.frombuffer(answer.content, "<u4", tiles, 12)
    planes = np.frombuffer(answer.content, np.uint8, -1, 12 + 4 * tiles).reshape(4, height, width)
    return samples.tolist(), np.ascontiguousarray(np.moveaxis(planes, 0, 2)).view("<u4")[..., 0], side


def test_whole_film_is_followed_by_changed_tiles(service: Service, worker: PeerWorker) -> None:
    job = service.submit(service.ready_scene())
    service.wait_for(job, "finished")
    samples, words, side = film_of(service, job, **{"Accept-Encoding": "identity"})
    assert samples == [8] * 12
    packed = service.http.get(f"/api/jobs/{job}/frames/0/film", headers={"Accept-Encoding": "gzip"})
    assert packed.headers["Content-Encoding"] == "gzip" and packed.headers["Vary"] == "Accept-Encoding"
    assert film_of(service, job)[0] == samples
    np.testing.assert_array_equal(film_of(service, job)[1], words)
    again = service.http.get(f"/api/jobs/{job}/frames/0/film", headers={"If-None-Match": packed.headers["ETag"]})
    assert again.status_code == 304

    with watch(service, job) as watcher:
        watcher.read(1.0)
    for (x, y, w, h), of_tile in watcher.words.items():
        np.testing.assert_array_equal(words[y : y + h, x : x + w], of_tile)

    # A client with all tiles gets nothing, one without two tiles gets these, one without information gets all.
    order = sorted(watcher.words, key=lambda tile: (tile.y, tile.x))
    assert (order[1].x, order[0].w) == (side, side)
    for have, wanted in ((samples, []), ([*samples[:5], 4, *samples[6:11], 0], [order[5], order[11]]), (["?"], order)):
        with watch(service, job, query="?snapshot=false") as watcher:
            watcher.read(0.5)
            assert not watcher.words
            watcher.connection.send(json.dumps({"have": have}))
            watcher.read(1.0)
        assert sorted(watcher.words, key=lambda tile: (tile.y, tile.x)) == wanted

    with watch(service, job, query="?snapshot=false") as watcher:
        watcher.read(0.5)
        watcher.connection.send(json.dumps({"have": ["?"]}) + " " * (2 << 20))
        watcher.read(1.0)
        assert not watcher.words, "what nobody needs to say keeps nobody waiting while it is read"


@pytest.mark.long
def test_changes_before_have_message_are_sent(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.01)
    job = service.submit(service.ready_scene(), spp=60)
    with watch(service, job, query="?snapshot=false") as watcher:
        until(lambda: (watcher.read(0.3), bool(watcher.states) and watcher.states[-1]["state"] == "finished")[1], "the job ends")
        watcher.read(0.5)
    assert len(watcher.words) == 12 and set(watcher.spp.values()) == {60}
