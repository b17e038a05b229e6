"""Tests of requests while all threads are busy: health checks respond, and excess picture requests get 503 with Retry-After."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from service.routes import frames, scenes
from service.watching.pool import Pool
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker


@pytest.mark.long
def test_health_check_needs_no_thread(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    """Health checks respond while there are more slow requests than threads."""
    hold = threading.Event()
    monkeypatch.setattr(scenes, "find_scene", lambda id, farm: hold.wait(20))
    with ThreadPoolExecutor(60) as many:
        asked = [many.submit(service.http.get, "/api/scenes/slow") for _ in range(60)]
        time.sleep(0.5)
        begun = time.monotonic()
        assert service.http.get("/healthz").status_code == 200
        assert service.http.get("/readyz").status_code in (200, 503)
        assert time.monotonic() - begun < 5
        hold.set()
        for each in asked:
            each.result()


@pytest.mark.long
def test_excess_picture_requests_get_retry_after(service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch) -> None:
    job = service.submit(service.ready_scene())
    service.wait_for(job, "finished")
    service.farm.pictures = Pool(1 << 20, threads=1, queue_length=1, max_queue_length=1)
    hold = threading.Event()
    make = frames.picture_file
    monkeypatch.setattr(frames, "picture_file", lambda *wish: hold.wait(20) and make(*wish))
    url = f"/api/jobs/{job}/frames/0/image.png"
    with ThreadPoolExecutor(2) as many:
        waiting = [many.submit(service.http.get, url, params={"exposure": i}) for i in range(2)]
        until(lambda: service.farm.pictures.pending_count == 2, "both wait")
        answer = service.http.get(url, params={"exposure": 9})
        hold.set()
        assert [each.result().status_code for each in waiting] == [200, 200]
    assert answer.status_code == 503 and int(answer.headers["retry-after"]) > 0
    assert answer.json()["detail"].endswith(".")
