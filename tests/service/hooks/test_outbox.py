"""Tests that webhooks and hook programs are notified of the end of each job exactly once.

A real HTTP server receives the webhooks and gives chosen responses; the program is a real one too.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import socket
import threading
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import psutil
import pytest
from sqlalchemy import select

from service.hooks import deliver, outbox
from service.hooks.signing import headers
from service.scheduling.forecasts import deadlines
from service.store.models import Delivery, Job
from tests.grids import grid
from tests.service.conftest import Service, until

SECRET = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"


class Receiver:
    """A receiver of webhooks: stores requests and responds with the given statuses, repeating the last one."""

    def __init__(self) -> None:
        self.statuses = [204]
        self.got: list[tuple[dict[str, str], bytes]] = []
        receiver = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"]))
                receiver.got.append(({key.lower(): value for key, value in self.headers.items()}, body))
                self.send_response(receiver.statuses.pop(0) if len(receiver.statuses) > 1 else receiver.statuses[0])
                self.end_headers()

            def log_message(self, *_: Any) -> None:
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}/hook?key=of-the-receiver"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    @property
    def messages(self) -> list[dict[str, Any]]:
        return [json.loads(body) for _, body in self.got]


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    receiver = Receiver()
    yield receiver
    receiver.server.shutdown()
    receiver.server.server_close()


@pytest.fixture
def told(service: Service, receiver: Receiver, monkeypatch: pytest.MonkeyPatch) -> Service:
    """Returns a service whose webhooks go to the receiver, with short retry delays."""
    monkeypatch.setattr(outbox, "RETRIES_S", (0.1,) * 7)
    monkeypatch.setattr(outbox, "POLL_EVERY_S", 0.1)
    service.options |= {"webhooks": [receiver.url], "webhook_secret": SECRET, "public_url": "http://farm.example/"}
    service.restart()
    until(lambda: service.farm.outbox._since != {}, "the outbox has begun")
    return service


@pytest.mark.long
def test_end_of_job_is_delivered_signed_and_once(told: Service, receiver: Receiver) -> None:
    with told.worker():
        job = told.submit(told.ready_scene(), name="the night's")
        told.wait_for(job, "finished")
        # The delivery must be recorded, not only received: a service that stops in between sends it again, as it must.
        until(lambda: told.http.get("/api/hooks").json()[0]["arrived"] == 1, "the hook is told")
        told.restart()
        other = told.submit(told.ready_scene())
        told.wait_for(other, "finished")
        until(lambda: told.http.get("/api/hooks").json()[0]["arrived"] == 2, "the hook is told of the next")
    assert [message["data"]["id"] for message in receiver.messages] == [job, other]
    (sent, body), _ = receiver.got
    message = json.loads(body)
    assert (message["type"], message["data"]["name"], message["data"]["page"]) == (
        "job.finished",
        "the night's",
        f"http://farm.example/#/jobs/{job}",
    )
    signed = headers(SECRET, sent["webhook-id"], int(sent["webhook-timestamp"]), body)
    assert sent["webhook-signature"] == signed["webhook-signature"]
    (hook,) = told.http.get("/api/hooks").json()
    assert hook == {"number": 0, "hook": "http://127.0.0.1/...", "arrived": 2, "waiting": 0, "given_up": 0, "error": None}


@pytest.mark.long
def test_failing_hook_is_paused_for_all_messages(told: Service, receiver: Receiver, monkeypatch: pytest.MonkeyPatch) -> None:
    receiver.statuses = [500]
    monkeypatch.setattr(outbox, "RETRIES_S", (600.0,) * 7)
    monkeypatch.setattr(outbox, "MAX_HOOK_PAUSE_S", 3.0)
    for _ in range(20):
        told.patch(told.submit(told.upload()), state="cancelled")
    until(lambda: len(receiver.got) > 0, "the hook is tried")
    until(lambda: told.http.get("/api/hooks").json()[0]["waiting"] == 20, "all wait")
    assert len(receiver.got) <= 3
    receiver.statuses = [204]
    until(lambda: len(receiver.messages) >= 20, "once it answers it is told of all whose turn it is", 30)


@pytest.mark.long
def test_message_with_future_time_is_sent(told: Service, receiver: Receiver) -> None:
    told.patch(told.submit(told.upload()), state="cancelled")
    until(lambda: told.http.get("/api/hooks").json()[0]["arrived"] == 1, "the hook is told")
    with told.farm.sessions.begin() as session:
        row = session.scalars(select(Delivery).where(Delivery.job != "")).one()
        row.due, row.done = time.time() + 40 * 86400, None
    until(lambda: len(receiver.got) == 2, "it is sent again")


@pytest.mark.long
def test_clock_set_back_does_not_delay_messages(told: Service, receiver: Receiver, monkeypatch: pytest.MonkeyPatch) -> None:
    told.patch(told.submit(told.upload()), state="cancelled")
    until(lambda: len(receiver.got) == 1, "the hook is told")
    real = time.time
    monkeypatch.setattr(time, "time", lambda: real() - 5000.0)
    job = told.submit(told.upload())
    told.patch(job, state="cancelled")
    until(lambda: len(receiver.got) > 1, "the hook is told of the next")
    assert [message["data"]["id"] for message in receiver.messages][1:] == [job]


@pytest.mark.long
def test_failed_delivery_is_retried_with_same_id(told: Service, receiver: Receiver) -> None:
    receiver.statuses = [500, 302, 204]
    job = told.submit(told.upload())
    told.patch(job, state="cancelled")
    until(lambda: told.http.get("/api/hooks").json()[0]["arrived"] == 1, "the message arrives")
    assert [message["type"] for message in receiver.messages] == ["job.cancelled"] * 3
    assert len({sent["webhook-id"] for sent, _ in receiver.got}) == 1


@pytest.mark.long
@grid(("status", "attempts"), [(500, 8), (410, 1)], ordinary=(410,))
def test_delivery_is_abandoned_after_retries(
    told: Service, receiver: Receiver, status: int, attempts: int, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("WARNING")
    receiver.statuses = [status]
    told.patch(told.submit(told.upload()), state="cancelled")
    until(lambda: told.http.get("/api/hooks").json()[0]["given_up"] == 1, "the message is given up")
    assert len(receiver.got) == attempts
    assert str(status) in told.http.get("/api/hooks").json()[0]["error"]
    assert "127.0.0.1/..." in caplog.text and "of-the-receiver" not in caplog.text and "/hook" not in caplog.text


@pytest.mark.long
def test_new_hook_gets_no_earlier_events(service: Service, receiver: Receiver) -> None:
    service.patch(service.submit(service.upload()), state="cancelled")
    service.options |= {"webhooks": [receiver.url]}
    service.restart()
    until(lambda: service.farm.outbox._since != {}, "the outbox has begun")
    job = service.submit(service.upload())
    service.patch(job, state="cancelled")
    until(lambda: len(receiver.got) > 0, "the hook is told")
    assert [message["data"]["id"] for message in receiver.messages] == [job]
    assert service.farm.settings.webhook_secret.startswith("whsec_")


def test_test_message_reports_delivery(told: Service, receiver: Receiver) -> None:
    assert told.http.post("/api/hooks/0/test").status_code == 204
    assert receiver.messages[0]["type"] == "test"
    receiver.statuses = [404]
    refused = told.http.post("/api/hooks/0/test")
    assert (refused.status_code, "answered 404" in refused.json()["detail"]) == (503, True)
    assert told.http.post("/api/hooks/1/test").status_code == 404


@pytest.mark.long
def test_program_runs_at_end_of_job(service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RAYFARM_TOKEN", "the farm's own")
    program = tmp_path / "hook.sh"
    program.write_text("#!/bin/sh\ncd $(dirname $0)\ncat > message\nenv | grep ^RAYFARM_ > variables\nmv message said\n")
    program.chmod(0o755)
    service.options |= {"job_hook": str(program)}
    service.restart()
    until(lambda: service.farm.outbox._since != {}, "the outbox has begun")
    job = service.submit(service.upload())
    service.patch(job, state="cancelled")
    until((tmp_path / "said").exists, "the program has run")
    assert json.loads((tmp_path / "said").read_text())["data"]["id"] == job
    told = dict(line.split("=", 1) for line in (tmp_path / "variables").read_text().splitlines())
    assert (told["RAYFARM_JOB_ID"], told["RAYFARM_JOB_STATE"], told["RAYFARM_EVENT"]) == (job, "cancelled", "job.cancelled")
    assert "RAYFARM_TOKEN" not in told


def test_slow_hook_response_times_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(deliver, "ANSWER_TIMEOUT_S", 0.5)
    over = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as server:

        def trickle() -> None:
            with contextlib.suppress(OSError):
                connection, _ = server.accept()
                with connection:
                    connection.sendall(b"HTTP/1.1 200 OK\r\n")
                    while not over.wait(0.1):
                        connection.sendall(b"x: y\r\n")

        thread = threading.Thread(target=trickle)
        thread.start()
        try:
            with pytest.raises(deliver.UndeliveredError, match="within"):
                deliver.post(f"http://127.0.0.1:{server.getsockname()[1]}/", SECRET, "msg_1", {})
        finally:
            over.set()
            thread.join()


def test_program_may_leave_child_running(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(deliver, "RUN_TIMEOUT_S", 20.0)
    program = tmp_path / "hook"
    program.write_text(f"#!/bin/sh\nsleep 40 &\necho $! > {tmp_path}/left\n")
    program.chmod(0o700)
    try:
        deliver.run_program(str(program), "msg_1", {"type": "test", "data": {}})
    finally:
        os.kill(int((tmp_path / "left").read_text()), signal.SIGKILL)


def test_hanging_program_is_killed_with_children(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A hook program that hangs is killed together with its child processes.

    Otherwise up to eight of these programs would remain for each job, because of retries.
    """
    monkeypatch.setattr(deliver, "RUN_TIMEOUT_S", 1.0)
    program = tmp_path / "hook"
    program.write_text(f"#!/bin/sh\nsleep 300 &\necho $! > {tmp_path}/waited-for\nwait\n")
    program.chmod(0o700)
    with pytest.raises(deliver.UndeliveredError, match="longer than 1 s"):
        deliver.run_program(str(program), "msg_1", {"type": "test", "data": {}})
    pid = int((tmp_path / "waited-for").read_text())
    until(lambda: not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE, "it is ended")


def delivered_counts(service: Service) -> list[int]:
    """Returns the number of messages delivered to each webhook, as the API reports it."""
    return [hook["arrived"] for hook in service.http.get("/api/hooks").json()]


@pytest.mark.long
def test_hanging_hook_does_not_delay_others(service: Service, receiver: Receiver) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:  # connections are accepted by the system, and never read
        hanging = f"http://127.0.0.1:{server.getsockname()[1]}/"
        service.options["webhooks"] = [hanging, receiver.url]
        service.restart()
        until(lambda: len(service.farm.outbox._since) == 2, "the outbox has begun")
        jobs = [service.submit(service.upload()) for _ in range(2)]
        service.patch(jobs[0], state="cancelled")
        with server.accept()[0]:
            began = time.monotonic()
            service.patch(jobs[1], state="cancelled")
            until(lambda: len(receiver.got) == 2, "the other is told")
            until(lambda: delivered_counts(service) == [0, 2], "a message that was received is written down as arrived")
            assert time.monotonic() - began < deliver.ANSWER_TIMEOUT_S


@pytest.mark.long
def test_more_ended_jobs_than_one_poll_are_all_reported(
    told: Service, receiver: Receiver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If more jobs end than one poll reads, the ends of all are delivered.

    One of the jobs also became late for its deadline, with a later time; this time must not hide the ends of the others.
    """
    monkeypatch.setattr(outbox, "AT_A_TIME", 2)
    jobs = [told.submit(told.upload()) for _ in range(6)]
    now = time.time()
    with told.farm.sessions.begin() as session:
        for at, id in enumerate(jobs):
            job = session.get(Job, id)
            assert job is not None
            if at < 5:
                job.state, job.finished = "cancelled", now + 100.0 * at
            else:
                job.late = now + 1000.0
    until(lambda: len(receiver.got) == 6, "all are told", say=lambda: receiver.messages)


@pytest.mark.long
def test_faulty_message_is_not_retried_forever(told: Service, receiver: Receiver, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outbox, "post", lambda *_: [][0])
    told.patch(told.submit(told.upload()), state="cancelled")
    until(lambda: told.http.get("/api/hooks").json()[0]["given_up"] == 1, "the message is given up")


@pytest.mark.long
def test_late_job_is_reported_while_running(told: Service, receiver: Receiver, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(deadlines, "RELIABLE_AFTER_S", 0.5)
    soon = datetime.now(UTC) + timedelta(hours=1)
    with told.worker() as worker:
        worker.on_batch = lambda batch: time.sleep(0.2 * batch.count)  # larger batches take longer
        job = told.submit(told.ready_scene(), spp=100_000, deadline=soon.isoformat())
        until(lambda: told.job(job)["late"] is not None, "it is late", 60, lambda: told.job(job))
        until(lambda: len(receiver.got) == 1, "the hook is told")
        (message,) = receiver.messages
        assert (message["type"], message["data"]["state"]) == ("job.late", "running")
        assert datetime.fromisoformat(message["data"]["deadline"]) == soon
        now = told.job(job)
        assert now["expected"] > now["deadline"] == soon.timestamp()
        assert re.fullmatch(r"It is expected to finish .*(hours|minutes|days) after its deadline.", now["warning"])
        assert "rayfarm_jobs_late 1.0" in told.http.get("/metrics").text
        assert any(event["kind"] == "late" for event in told.http.get(f"/api/jobs/{job}/history").json()["events"])
        later = (soon + timedelta(days=3600)).isoformat()
        changed = told.patch(job, deadline=later)
        assert (changed["late"], changed["warning"], changed["deadline"]) == (None, None, soon.timestamp() + 3600 * 86400)
        assert told.patch(job, deadline=None, state="cancelled")["deadline"] is None
        until(lambda: len(receiver.got) == 2, "the hook is told of its end")
    assert [message["type"] for message in receiver.messages] == ["job.late", "job.cancelled"]
    assert "rayfarm_jobs_late 0.0" in told.http.get("/metrics").text
    refused = told.http.post("/api/jobs", json={"scene": told.upload(), "deadline": "2001-01-01"})
    assert (refused.status_code, "deadline-in-past" in refused.text) == (422, True)
