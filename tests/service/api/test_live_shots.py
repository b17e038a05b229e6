"""Tests of the live connection to a shot: the states of its frames, and tiles of one frame after another."""

from __future__ import annotations

import json
import struct
import time
from typing import Any

import numpy as np
import pytest
from websockets.sync.client import connect

from renderer import film as film_math
from renderer.image import rgbe9995
from renderer.settings import Tile
from tests.service.conftest import Service
from tests.service.peer_worker import PeerWorker, expected_sums


@pytest.mark.long
def test_viewer_gets_frame_states_and_switches_frame(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.01)
    job = service.submit(service.ready_scene(), frames="0-5", spp=4)
    states: dict[float, set[str]] = {}
    heads: list[str] = []
    words: dict[int, dict[Tile, np.ndarray]] = {}
    turned = False
    with connect(f"ws{service.url[4:]}/api/jobs/{job}/live?frame=2", proxy=None) as socket:
        deadline = time.monotonic() + 30
        while time.monotonic() < deadline and len(words.get(4, {})) < 12:
            try:
                message: Any = socket.recv(timeout=2)
            except TimeoutError:
                continue
            if isinstance(message, str):
                said = json.loads(message)
                heads.append(said["type"])
                for frame in said.get("frames", []):
                    states.setdefault(frame["number"], set()).add(frame["state"])
                if said["type"] == "state" and said["job"]["state"] == "finished" and not turned:
                    turned = True
                    socket.send(json.dumps({"frame": 4}))
                continue
            _, _, number, sequence, x, y, w, h, spp = struct.unpack_from("<BBHIHHHHI", message)
            if spp == 4:
                words.setdefault(number, {})[Tile(x, y, w, h)] = np.frombuffer(message, "<u4", offset=20).reshape(h, w)
            socket.send(json.dumps({"ack": sequence}))
    assert heads[:2] == ["state", "frames"]
    assert sorted(states) == [0, 1, 2, 3, 4, 5]
    assert all("finished" in found for found in states.values())
    assert sorted(words) == [2, 4]
    for number in (2, 4):
        for tile, shown in words[number].items():
            sums = expected_sums(tile, 0, 4, 2000 * number)
            np.testing.assert_array_equal(shown, rgbe9995.pack(film_math.mean(sums, 24)))


@pytest.mark.long
def test_still_has_no_frame_messages(service: Service, worker: PeerWorker) -> None:
    job = service.submit(service.ready_scene())
    service.wait_for(job, "finished")
    with connect(f"ws{service.url[4:]}/api/jobs/{job}/live", proxy=None) as socket:
        assert json.loads(socket.recv(timeout=5))["type"] == "state"
        assert isinstance(socket.recv(timeout=5), bytes)
