"""Runs a real worker in a separate process. A test controls the worker through a fake service."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import psutil
import redis
from celery import Celery

from protocol.broker import celery_config
from protocol.contract import (
    PREPARE,
    PREPARE_FRAMES,
    RENDER_BATCH,
    RESULTS,
    SAMPLES_HEADER,
    VERSION_HEADER,
    WORKER_KEYS,
    BlobRef,
    FrameInfo,
    Manifest,
    PrepareFrames,
    RenderBatch,
    Result,
    WorkerReport,
    prepare_queue,
    render_queue,
)
from tests.helpers import ROOT, wait_until

__all__ = ["Bench", "FakeService", "a_worker", "processor_time", "processor_times", "rendering_slot", "slots_of"]


class FakeService(BaseHTTPRequestHandler):
    """A fake service with only the HTTP responses that a worker needs."""

    blobs: dict[str, bytes]
    manifests: dict[str, Manifest]
    films: dict[str, bytes]
    redis_url: str
    away = False
    reduces = True  # whether workers' sums go to a reducer
    sent: list[tuple[str, int]]  # (name, size) of uploaded blobs

    def do_GET(self) -> None:
        if self.headers["Authorization"] != "Bearer token":
            self._answer(401, b"{}")
        elif self.away:
            self._answer(503, b"<html>a proxy before a service that starts anew")
        elif self.path == "/api/farm/join":
            farm = {"redis_url": self.redis_url, "instance": "i", "data_dir": "", "reduces": "yes" if self.reduces else ""}
            self._answer(200, json.dumps(farm).encode())
        elif self.path.startswith(("/api/farm/films/", "/api/farm/views/")):
            means = self.films.get(self.path)
            self._answer(200 if means else 404, means or b"{}", {VERSION_HEADER: "seven", SAMPLES_HEADER: "12"})
        elif self.path.endswith("/manifest"):
            self._answer(200, json.dumps(asdict(self.manifests[self.path.split("/")[4]])).encode())
        else:
            data = self.blobs.get(self.path.rpartition("/")[2])
            self._answer(404 if data is None else 200, data or b"{}")

    def do_PUT(self) -> None:
        data = self.rfile.read(int(self.headers["Content-Length"]))
        self.blobs[self.path.rpartition("/")[2]] = data
        self.sent.append((self.path.rpartition("/")[2], len(data)))
        self._answer(201, b"{}")

    def do_POST(self) -> None:
        self._answer(204 if self.path.split("/")[4] in self.blobs else 404, b"")

    def _answer(self, status: int, body: bytes, headers: dict[str, str] | None = None) -> None:
        self.send_response(status)
        for name, value in (headers or {}).items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        pass


@dataclass
class Bench:
    """A running worker, with the fake service, the Redis server and the Celery application through which a test controls it.

    seen: the results that the worker has sent so far.
    """

    url: str
    service: type[FakeService]
    store: redis.Redis
    celery: Celery
    process: subprocess.Popen[bytes]
    seen: list[Result] = field(default_factory=list)

    def report(self) -> WorkerReport | None:
        for key in self.store.scan_iter(WORKER_KEYS):
            data = self.store.get(key)
            if not isinstance(data, bytes):
                continue  # expired meanwhile
            report = WorkerReport.from_bytes(data)
            if report.pid == self.process.pid:
                return report
        return None

    def upload(self, scene: str, files: dict[str, bytes], main: str) -> None:
        refs = []
        for path, data in files.items():
            sha256 = hashlib.sha256(data).hexdigest()
            self.service.blobs[sha256] = data
            refs.append(BlobRef(path, sha256, len(data)))
        self.service.manifests[scene] = Manifest(scene, main, refs)

    def prepare(self, scene: str) -> Result:
        """Makes the worker prepare a scene. Returns the result; if it succeeded, once the scene's thumbnail is stored too."""
        kind = self.report().kind  # type: ignore[union-attr]
        self.celery.send_task(PREPARE, kwargs={"scene": scene}, queue=prepare_queue(kind))
        outcome = self.next("prepared", "prepare-failed")
        if outcome.event["type"] == "prepared":
            self.next("thumbnail-made")
        return outcome

    def prepare_frames(self, work: PrepareFrames) -> list[FrameInfo]:
        """Makes the worker prepare frames. Returns the result of each frame, in order."""
        kind = self.report().kind  # type: ignore[union-attr]
        self.celery.send_task(PREPARE_FRAMES, kwargs={"frames": asdict(work)}, queue=prepare_queue(kind))
        return [FrameInfo.from_json(self.next("frame-prepared").event["info"]) for _ in work.frames]

    def render(self, batch: RenderBatch, message: str | None = None) -> None:
        kind = self.report().kind  # type: ignore[union-attr]
        self.celery.send_task(RENDER_BATCH, kwargs={"batch": batch.to_json()}, queue=render_queue(kind), task_id=message)

    def next(self, *types: str, seconds: float = 60.0) -> Result:
        """Waits for the worker's next result of one of the given types, and returns it. Fails after `seconds`."""
        found: list[Result] = []

        def arrived() -> bool:
            for number, fields in self.store.xrange(RESULTS):
                self.store.xdel(RESULTS, number)
                result = Result.from_fields(fields)
                self.seen.append(result)
                if result.event["type"] in types:
                    found.append(result)
                    return True
            return False

        wait_until(arrived, seconds, f"one of {types} arrives; so far {[r.event for r in self.seen]}")
        return found[0]


@contextmanager
def a_worker(redis_url: str, folder: Path, slots: int, options: Sequence[str] = ()) -> Iterator[Bench]:
    """Context manager that starts a worker and yields it once it is ready; stops it at the end unless it has ended before.

    folder: for the worker's files. options: further command line options.
    """
    handler = type("Handler", (FakeService,), {"blobs": {}, "manifests": {}, "films": {}, "sent": [], "redis_url": redis_url})
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    url = f"http://127.0.0.1:{server.server_port}"
    command = [sys.executable, "-m", "worker", f"--service={url}", f"--slots={slots}", f"--cache={folder / 'blobs'}"]
    command += ["--gpu=none", *options]  # without this machine's own graphics cards
    told = {"RAYFARM_TOKEN": "token", "RAYFARM_PREPARE_MEMORY_MB": "2000", "TMPDIR": str(folder)}
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen(command, cwd=ROOT, stdout=log, stderr=log, env=os.environ | told)
    celery = Celery("test", set_as_current=False)
    celery.conf.update(celery_config(redis_url))
    with redis.Redis.from_url(redis_url) as store:
        store.delete(RESULTS)  # those of tests before, which share the server
        made = Bench(url, handler, store, celery, process)

        def ready() -> bool:
            assert process.poll() is None, (folder / "log").read_text()
            report = made.report()
            return report is not None and report.state == "ready"

        try:
            wait_until(ready, 240, "the worker is ready")  # may compile its kernels first
            yield made
            process.terminate()
            assert process.wait(60) == 0, (folder / "log").read_text()
            assert made.report() is None
            assert not [*folder.glob("rayfarm-sums-*")]
        finally:
            process.kill()
            process.wait()
    celery.close()
    server.shutdown()
    server.server_close()


def slots_of(parent: int) -> list[psutil.Process]:
    """Returns the slot processes of the worker whose main process has the id `parent`."""
    found = []
    for child in psutil.Process(parent).children():
        with suppress(psutil.NoSuchProcess):
            if any(argument.startswith("--slots=") for argument in child.cmdline()):
                found.append(child)
    return found


def processor_time(slot: psutil.Process) -> float:
    """Returns a slot's processor time in seconds; -1 if it has ended."""
    try:
        return sum(slot.cpu_times()[:2])
    except psutil.NoSuchProcess:
        return -1.0


def processor_times(parent: int) -> dict[psutil.Process, float]:
    """Returns the slots of the worker with process id `parent`, each with its processor time in seconds."""
    return {slot: processor_time(slot) for slot in slots_of(parent)}


def rendering_slot(before: dict[psutil.Process, float]) -> psutil.Process:
    """Waits until one of a worker's slots uses its core, and returns the slot that has used it most.

    before: `processor_times` when the work was handed out: reports of it may come when most of it is done.
    """
    wait_until(lambda: any(processor_time(slot) - then > 0.4 for slot, then in before.items()), 30, "a slot uses its core")
    return max(before, key=lambda slot: processor_time(slot) - before[slot])
