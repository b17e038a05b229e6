"""Tests of a job's log: it is limited in size, preserved over a restart, and deleted together with its job."""

import logging
import re
from pathlib import Path

import pytest

from service.scheduling.jobs.job_log import KEPT_BYTES, MAX_FILE_BYTES, JobLogs
from service.scheduling.jobs.tile_log import TILES, TileLogs
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker


def test_batch_counts_are_logged_before_next_line(tmp_path: Path) -> None:
    logs = JobLogs(tmp_path / "logs")
    log = logs.log_of("job")
    log.count_dispatched(2)
    log.count_returned("a", 4096, 0.25)
    log.count_returned("a", 4096, 0.25)
    log.add_line("an error", "first\nsecond")
    log.count_dispatched(1)
    logs.flush()
    lines = logs.text("job").decode().splitlines()
    assert all(line[10] == "T" and line[23] == "Z" for line in lines)
    assert [line[25:] for line in lines] == [
        "handed out: 2 batches",
        "back from a: 2 batches, 8,192 samples in 0.50 s of its slots",
        "an error",
        "    first",
        "    second",
        "handed out: 1 batch",
    ]


def test_long_log_keeps_latest_lines(tmp_path: Path) -> None:
    logs = JobLogs(tmp_path)
    for number in range(20_000):
        logs.log_of("job").add_line(f"line {number} {'x' * 40}")
        if number % 500 == 0:
            logs.flush()
    logs.flush()
    lines = logs.text("job").decode().splitlines()
    assert lines[-1].split()[2] == "19999" and lines[0].split()[1] == "line"
    assert KEPT_BYTES / 2 < len(logs.text("job")) <= KEPT_BYTES
    assert (tmp_path / "job.log").stat().st_size <= MAX_FILE_BYTES + 2000 * 100
    assert len(list(tmp_path.iterdir())) == 1


def test_log_lines_are_escaped_and_write_errors_ignored(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    logs = JobLogs(tmp_path / "file")  # a path where no folder can be created
    logs.log_of("job").add_line("here")
    logs.flush()
    assert logs.text("job") == b""
    logs = JobLogs(tmp_path)
    logs.log_of("job").add_line("one\x1b[31m\nline" + "x" * 5000)
    logs.flush()
    assert logs.text("job").count(b"\n") == 1 and b"\x1b" not in logs.text("job") and len(logs.text("job")) < 1100


@pytest.mark.long
def test_job_log_names_workers_and_survives_restart(service: Service, worker: PeerWorker) -> None:
    failed: list[str] = []

    def fail_once(batch):  # fails the first batch once
        if not failed:
            failed.append(batch.batch)
            about = {"batch": batch.batch, "job": batch.job, "frame": 0, "tile": list(batch.tile), "first": batch.first}
            event = {
                "type": "batch-failed",
                **about,
                "count": batch.count,
                "worker": "peer",
                "error": "ValueError: no",
                "trace": "File x\nNo",
            }
            worker.send(event)
            return False
        return None

    worker.on_batch = fail_once
    job = service.submit(service.ready_scene())
    service.wait_for(job, "finished")

    def text() -> str:
        return service.http.get(f"/api/jobs/{job}/log").raise_for_status().text

    until(lambda: "finished: " in text(), "the end is told", say=text)
    said = text()
    for part in (
        "loaded: 64 x 48, 8 samples per pixel",
        "back from peer",
        "handed out",
        "peer could not render samples 0",
        "    File x",
        "peer renders it",
    ):
        assert part in said, part
    answer = service.http.get(f"/api/jobs/{job}/log")
    assert answer.headers["content-type"].startswith("text/plain")
    assert service.http.get(f"/api/jobs/{job}/log", headers={"If-None-Match": answer.headers["etag"]}).status_code == 304
    service.restart()
    assert text() == said
    assert service.http.get("/api/jobs/none/log").status_code == 404
    file = service.options["data"] / "logs-of-jobs" / f"{job}.log"
    assert file.exists()
    service.http.delete(f"/api/jobs/{job}")
    until(lambda: not file.exists(), "the log goes with its job")


@pytest.mark.long
def test_tile_log_has_workers_and_warnings(service: Service, worker: PeerWorker) -> None:
    send = worker.send

    def tell(event, sums=None):
        if event["type"] == "batch" and event["tile"][:2] == [16, 0]:
            event |= {"lines": ["warning: the disk is slow"], "took": {"open scene": 1.25, "trace paths": 0.5, "kernel": 0.0}}
        send(event, sums)

    worker.send = tell  # type: ignore[method-assign]
    job = service.submit(service.ready_scene())
    service.wait_for(job, "finished")

    def of(x: int, y: int) -> list[str]:
        return service.http.get(f"/api/jobs/{job}/frames/0/log", params={"x": x, "y": y}).raise_for_status().text.splitlines()

    told = [line.partition(" ")[2] for line in of(20, 5)]
    assert any(re.match("peer: samples? 0 ", line) and "(open scene 1.25 s); warning: the disk is slow" in line for line in told)
    assert any(line.startswith("peer, samples 0 to ") and "tile 1, frame 0: warning: the disk is slow" in line for line in told)
    assert not any("slow" in line for line in of(0, 0)) and of(0, 0)
    assert "the disk is slow" in service.http.get(f"/api/jobs/{job}/log").text
    assert service.http.get(f"/api/jobs/{job}/frames/0/log?x=64&y=0").status_code == 422
    service.http.delete(f"/api/jobs/{job}").raise_for_status()
    until(lambda: not service.farm.engine.logs.tiles.text(job, 0, 1), "it is forgotten")


def test_tile_logs_are_bounded() -> None:
    logs = TileLogs()
    for number in range(40):
        logs.add_line("job", 0, 7, f"batch {number}")
        logs.add_line(f"job {number}", 0, 0, "x")
    assert logs.text("job 0", 0, 0) == "" and logs.text("job 39", 0, 0)
    for tile in range(TILES + 5):
        for number in range(20):
            logs.add_line("many", 0, tile, f"batch {number}") if tile < 2 or number == 0 else None
    assert logs.text("many", 0, 0) == "" and logs.text("many", 0, TILES)
    for number in range(40):
        logs.add_line("last", 0, 7, f"batch {number}")
    assert [line.split()[-1] for line in logs.text("last", 0, 7).splitlines()] == [str(n) for n in range(24, 40)]


def test_service_log_has_job_counts_once_a_minute(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    logs = JobLogs(tmp_path)
    with caplog.at_level(logging.INFO):
        for _ in range(5):
            logs.log_of("job").count_dispatched(2)
            logs.flush()
        logs.log_of("job").add_line("something happened")
        logs.flush()
    assert [record.getMessage() for record in caplog.records] == ["handed out: 2 batches", "something happened"]
    assert logs.text("job").count(b"handed out: 2 batches") == 5, "the job's own log has all"
