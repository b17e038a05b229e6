"""Tests of GET /api/jobs/{id}/explain, which asks a worker for the light paths of a pixel.

The worker's answer is validated. Without a worker that can explain pixels, the response is an error.
"""

from __future__ import annotations

from typing import Any

import httpx
import pytest

from protocol.explained import ExplainPixel
from renderer.film import COLOR, SAMPLES
from renderer.settings import RenderSettings, Tile
from service.viewing import explaining
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_sums

VERTEX = {
    "kind": "surface",
    "object": 0,
    "material": 0,
    "model": "diffuse",
    "bounce": None,
    "pdf": None,
    "survival": None,
    "distance": 1.0,
    "point": [0, 0, 0],
    "normal": [0, 0, 1],
    "direction": [0, 0, -1],
    "throughput": [1, 1, 1],
    "emitted": [0, 0, 0],
    "emitted_weight": None,
    "direct": [0, 0, 0],
    "sky": [0, 0, 0],
    "light": None,
    "spot": [1, 2, 1],
}
PATH = {"chosen": ["first"], "sample": 0, "value": [1, 1, 1], "end": "depth", "time": 0.0, "vertices": [VERTEX]}


def explained(work: ExplainPixel) -> list[dict[str, Any]]:
    """Returns a worker's answer to a request to explain a pixel, with the same samples as the film."""
    sums = expected_sums(Tile(work.x, work.y, 1, 1), 0, work.count, work.settings.seed)[:, 0, 0]
    told = {"samples": work.count, "sums": [int(v) for v in sums[COLOR]], "finite": int(sums[SAMPLES]), "paths": [PATH]}
    return [{"type": "begun"}, {"type": "done", "explained": told}]


def ask(service: Service, job: str, **query: Any) -> httpx.Response:
    return service.http.get(f"/api/jobs/{job}/explain", params={"x": 5, "y": 7, **query})


@pytest.fixture
def job(service: Service, worker: PeerWorker) -> str:
    id = service.submit(service.ready_scene())
    service.wait_for(id, "finished")
    return id


@pytest.mark.long
def test_explanation_uses_job_settings_and_is_compared_with_film(service: Service, worker: PeerWorker, job: str) -> None:
    worker.on_explain = explained
    found = ask(service, job, sample=3).raise_for_status().json()
    (work,) = worker.explained
    assert (work.x, work.y, work.count, work.sample, work.moment) == (5, 7, 8, 3, None)
    assert work.settings == RenderSettings.from_json(service.farm.records.job(job).settings or {})
    assert found["equals_film"] is True
    assert (found["samples"], found["worker"]) == (8, "peer")
    pixel = service.http.get(f"/api/jobs/{job}/frames/0/pixel", params={"x": 5, "y": 7}).json()
    assert found["mean"] == pytest.approx(pixel["color"], rel=1e-6)
    brought = service.http.get(f"/api/jobs/{job}/frames/0/workers").raise_for_status().json()
    assert brought["workers"] == [{"name": "peer", "samples": 64 * 48 * 8}]
    assert brought["unknown"] == 0
    assert {(tile["samples"], *tile["shares"]) for tile in brought["tiles"]} == {(8, 8)}
    worker.on_explain = lambda work: [*explained(work)[:1], {**explained(work)[1], "explained": _other(work)}]
    assert ask(service, job).json()["equals_film"] is False


def _other(work: ExplainPixel) -> dict[str, Any]:
    told = explained(work)[1]["explained"]
    return {**told, "sums": [told["sums"][0] + 1, *told["sums"][1:]]}


@pytest.mark.long
def test_impossible_explanations_give_error(
    service: Service, worker: PeerWorker, job: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def said(status: int, words: str, **query: Any) -> None:
        answer = ask(service, job, **query)
        assert answer.status_code == status, answer.text
        assert words in answer.json()["detail"]

    said(422, "There is no pixel 64, 7", x=64)
    said(404, "no frame 3", frame=3)
    assert ask(service, "none").status_code == 404
    monkeypatch.setattr(explaining, "COMPILE_S", 0.1)
    for answers, status, words in (
        ([{"type": "failed", "error": "pixel 1,2 lies elsewhere"}], 502, "lies elsewhere"),
        (
            [{"type": "begun"}, {"type": "compiling"}],
            503,
            "is compiling the kernel for it; this takes a minute or two, once. Try again then",
        ),
        ([{"type": "returned", "error": "the disk is full"}], 503, "the disk is full"),
        ([{"type": "done", "explained": None}], 502, "cannot be read"),
        ([{"type": "done", "explained": {}}], 502, "cannot be read"),
        ([{"type": "done", "explained": {"paths": [7], "sums": [1, 2, 3], "finite": 1, "samples": 8}}], 502, "cannot be read"),
        ([{"type": "done", "explained": {"paths": [], "sums": "abc", "finite": 1e999, "samples": 8}}], 502, "cannot be read"),
    ):
        worker.on_explain = lambda work, answers=answers: answers
        said(status, words)
    worker.on_explain = lambda work: []
    monkeypatch.setattr(explaining, "START_TIMEOUT_S", 0.1)
    said(504, "No worker was free; all slots are busy")
    monkeypatch.undo()
    worker.stop()
    until(lambda: not service.farm.engine.snapshot.roster.reports, "the service sees that the worker is gone")
    said(503, "none is ready")


@pytest.mark.long
def test_older_workers_get_no_explain_requests(service: Service) -> None:
    with service.worker(explains=False):
        job = service.submit(service.ready_scene())
        service.wait_for(job, "finished")
        answer = ask(service, job)
        assert (answer.status_code, "older release" in answer.json()["detail"]) == (503, True)


@pytest.mark.long
def test_animated_frame_is_prepared_again(service: Service, worker: PeerWorker) -> None:
    worker.on_frame = lambda frame: b"frame" + str(frame).encode()
    worker.on_explain = explained
    job = service.submit(service.ready_scene(), frames="0-2")
    service.wait_for(job, "finished")
    ask(service, job, frame=2)
    (work,) = worker.explained
    assert work.moment is not None
    assert work.moment.frames == [4]
    assert work.moment.base == work.compiled
