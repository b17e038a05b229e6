"""Tests of a whole farm's logs as JSON, and of its traces at an OpenTelemetry collector, from upload to tile."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from typing import Any

import psutil
import pytest

from tests.helpers import ROOT, Farm, start_farm, stop_farm, wait_until
from tests.rayfarm.otlp_receiver import Receiver

CALLER = "00-" + "ab" * 16 + "-" + "cd" * 8 + "-01"


@pytest.fixture(scope="module")
def observed_farm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Farm, Receiver, str, str]]:
    """Yields (farm, collector, job id, scene id) of a farm that was stopped after a job rendered with JSON logs and tracing."""
    settings = {"RAYFARM_LOG_FORMAT": "json", "RAYFARM_LOG_LEVEL": "debug"}
    with Receiver() as receiver:
        settings |= {"OTEL_EXPORTER_OTLP_ENDPOINT": receiver.url, "OTEL_BSP_SCHEDULE_DELAY": "200"}
        farm = start_farm(tmp_path_factory.mktemp("observed") / "data", 2, **settings)
        try:
            with farm.client() as client:
                scene = client.wait_for_scene(client.upload([ROOT / "scenes" / "cornell-box.yaml"]).id)
                client._http.headers["traceparent"] = CALLER
                job = client.wait(client.submit(scene.id, width=64, height=64, spp=32, tile_size=32).id, 120)
                assert job.state == "finished"
                # A slot is killed while rendering, and Celery logs that.
                del client._http.headers["traceparent"]
                busy = client.submit(scene.id, width=512, height=512, spp=100_000)
                wait_until(lambda: is_said_of_a_killed_slot(farm, busy.id), 120, "it is said")
                client.change(busy.id, state="cancelled")
                wait_until(lambda: {"merge", "job"} <= {span.name for span in receiver.spans}, 60, "spans come")
        finally:
            stop_farm(farm)
        yield farm, receiver, job.id, scene.id


def is_said_of_a_killed_slot(farm: Farm, job: str) -> bool:
    """Returns whether Celery has logged that a slot was killed; if not, kills the slot that rendered the job's last batch."""
    said = [
        json.loads(line)
        for line in (farm.data / "logs" / "worker.log").read_text().splitlines(keepends=True)
        if line.endswith("\n")
    ]
    slots = [line["pid"] for line in said if line.get("job") == job and line["message"] == "batch"]
    if not any("WorkerLostError" in json.dumps(line) for line in said) and slots and psutil.pid_exists(slots[-1]):
        os.kill(slots[-1], signal.SIGKILL)
    return any("WorkerLostError" in json.dumps(line) for line in said)


def lines(farm: Farm, name: str) -> list[dict[str, Any]]:
    text = (farm.data / "logs" / f"{name}.log").read_text()
    found = [json.loads(line) for line in text.splitlines()]  # every line is JSON
    assert all(
        isinstance(line, dict) and {"time", "level", "logger", "message", "process", "pid"} <= line.keys() for line in found
    )
    return found


@pytest.mark.long
def test_log_lines_are_json_with_ids(observed_farm: tuple[Farm, Receiver, str, str]) -> None:
    farm, _, job, _ = observed_farm
    service, worker = lines(farm, "service"), lines(farm, "worker")
    assert {line["process"] for line in service} == {"service"}
    assert any(line["logger"].startswith("uvicorn") for line in service)
    told = [line["message"] for line in service if line.get("job") == job]
    assert any(line.startswith("loaded: ") for line in told) and any(line.startswith("finished") for line in told)

    (name,) = {line["worker"] for line in worker if "worker" in line}
    batches = [line for line in worker if line.get("job") == job and line["message"] == "batch"]
    assert sum(line["count"] for line in batches) >= 4 * 32, "of four tiles"
    assert len({line["batch"] for line in batches}) == len(batches)
    assert all(line["seconds"] > 0 and line["worker"] == name for line in batches)
    lost = next(line for line in worker if "WorkerLostError" in line.get("exception", {}).get("trace", ""))
    assert lost["logger"].startswith("celery")
    assert any(line["logger"] == "multiprocessing" for line in worker), "billiard's"
    assert any(line["message"] == "Warm shutdown" for line in worker)


@pytest.mark.long
def test_spans_connect_upload_to_tiles(observed_farm: tuple[Farm, Receiver, str, str]) -> None:
    _, receiver, job, scene = observed_farm
    (upload,) = receiver.of("upload")
    assert (upload.attributes["rayfarm.scene"], upload.parent, upload.service) == (scene, "", "rayfarm-service")
    (prepare,) = receiver.of("prepare")
    assert (prepare.trace, prepare.parent, prepare.service) == (upload.trace, upload.id, "rayfarm-worker")
    steps = [span for span in receiver.spans if span.parent == prepare.id]
    assert len(steps) >= 2 and all(prepare.begun <= step.begun <= step.ended <= prepare.ended for step in steps)

    (root,) = [span for span in receiver.of("job") if span.attributes["rayfarm.job"] == job]
    assert root.parent == "" and root.links == [upload.id] and root.attributes["rayfarm.state"] == "finished"
    assert root.attributes["rayfarm.samples"] == 64 * 64 * 32
    (submit,) = [span for span in receiver.of("submit") if span.trace == root.trace]
    assert submit.links == ["cd" * 8], "whoever asked has a trace of their own"

    batches = {span.id: span for span in receiver.of("batch") if span.trace == root.trace}
    assert {span.parent for span in batches.values()} == {root.id}
    assert {span.service for span in batches.values()} == {"rayfarm-worker"}
    assert len({span.attributes["rayfarm.batch"] for span in batches.values()}) == len(batches) >= 4
    traced = [span for span in receiver.of("trace paths") if span.parent in batches]
    assert sum(span.attributes["rayfarm.count"] for span in traced) >= 4 * 32
    merges = [span for span in receiver.of("merge") if span.trace == root.trace]
    assert {link for span in merges for link in span.links} == batches.keys(), "each batch is followed into the film"
    assert all(root.begun <= span.begun and span.ended <= root.ended for span in merges)
    assert any(span.trace == root.trace for span in receiver.of("film"))
    (cancelled,) = [span for span in receiver.of("job") if span.attributes["rayfarm.state"] == "cancelled"]
    assert cancelled.trace != root.trace and cancelled.links == [upload.id]
