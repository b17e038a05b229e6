"""Tests of the add-on's client against substitute farms that refuse requests, hang, lose jobs, or are other servers.

Repeated uploads are tested too.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from blender.rayfarm_addon.farm.client import Client, FarmError
from blender.rayfarm_addon.farm.render_request import Failed, Light, RenderRequest
from blender.rayfarm_addon.farm.rendering import Rendering
from blender.rayfarm_addon.farm.uploads import Uploads
from blender.rayfarm_addon.farm.websocket import Socket
from blender.rayfarm_addon.scene.files import digest_of


class Answering(ThreadingHTTPServer):
    """A substitute farm with canned responses that records requests. answers: (status, body) by method and path."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.answers: dict[str, tuple[int, Any]] = {}
        self.asked: list[tuple[str, bytes, str | None]] = []
        self.hangs = threading.Event()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"


class Handler(BaseHTTPRequestHandler):
    server: Answering

    def do(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        key = f"{self.command} {self.path}"
        self.server.asked.append((key, body, self.headers.get("Authorization")))
        if key not in self.server.answers:
            self.server.hangs.wait(60)
            return
        status, said = self.server.answers[key]
        data = said if isinstance(said, bytes) else json.dumps(said).encode()
        self.send_response(status)
        if status == 302:
            self.send_header("Location", "http://127.0.0.1:9/elsewhere")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    do_GET = do_POST = do_PATCH = do_DELETE = do  # noqa: N815 -- so the standard library asks for them

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture
def server() -> Iterator[Answering]:
    farm = Answering()
    thread = threading.Thread(target=farm.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
    thread.start()
    yield farm
    farm.hangs.set()
    farm.shutdown()
    farm.server_close()
    thread.join()


def test_wrong_token_error_names_the_preference(server: Answering) -> None:
    server.answers["GET /api/info"] = 401, {"detail": "This token lets nobody in."}
    with pytest.raises(FarmError, match=r"This token lets nobody in\. Check the token in the add-on's preferences"):
        Client(server.url, "secret").check()
    assert server.asked[0][2] == "Bearer secret"
    server.answers["GET /live"] = 401, {}
    with pytest.raises(FarmError, match="Check the token"):
        Socket(Client(server.url, "secret"), "/live")


def test_other_server_is_reported_as_no_farm(server: Answering) -> None:
    server.answers["GET /api/info"] = 200, b"<html>"
    with pytest.raises(FarmError, match="is no Rayfarm"):
        Client(server.url).check()
    for url in ("", "farm:8000", "ftp://farm", "http://"):
        with pytest.raises(FarmError, match="no address of a farm"):
            Client(url)


def test_token_is_not_sent_to_redirect_targets(server: Answering) -> None:
    server.answers["GET /api/info"] = 302, {}
    with pytest.raises(FarmError):
        Client(server.url, "secret").check()
    assert len(server.asked) == 1


def test_connection_check_reports_the_workers(server: Answering) -> None:
    server.answers["GET /api/info"] = 200, {"formats": []}
    server.answers["GET /api/workers"] = 200, [{"slots": 4}, {"slots": 8}]
    server.answers["GET /api/session"] = 200, {"name": "anna"}
    assert Client(server.url).check() == "Connected as anna: 2 workers, 12 slots."


def test_known_files_are_not_uploaded_again(server: Answering) -> None:
    uploads = Uploads(Client(server.url), digest_of)
    files: dict[str, Any] = {"scene.yaml": b"{}", "a.bin": b"a" * 1000, "b.bin": b"b" * 1000}

    def sent() -> tuple[str, int]:
        found = uploads.send(files, "scene.yaml", "title", lambda done, size: None)
        return found, uploads.sent_bytes

    server.answers["POST /api/scenes"] = 201, {"id": "one"}
    assert sent() == ("one", 2002)
    assert sent() == ("one", 0)
    assert len(server.asked) == 1
    files["b.bin"] = b"c" * 1000
    server.answers["POST /api/scenes"] = 201, {"id": "two"}
    assert sent() == ("two", 1000)
    assert b'name="base"\r\n\r\none' in server.asked[-1][1]
    del files["a.bin"]
    files["d.bin"] = b"d"
    server.answers["POST /api/scenes"] = 201, {"id": "three"}
    assert sent() == ("three", 1003), "more than half of what is there is stale: all is sent anew"
    assert b'name="base"' not in server.asked[-1][1]


def test_scene_unknown_to_the_farm_is_uploaded_again(server: Answering) -> None:
    uploads = Uploads(Client(server.url), digest_of)
    server.answers["POST /api/scenes"] = 201, {"id": "one"}
    uploads.send({"scene.yaml": b"{}", "a.bin": b"a"}, "scene.yaml", "t", lambda done, size: None)
    server.answers["POST /api/scenes"] = 404, {"detail": "There is no scene one."}
    with pytest.raises(FarmError, match="no scene one"):
        uploads.send({"scene.yaml": b"{}", "a.bin": b"b"}, "scene.yaml", "t", lambda done, size: None)
    bodies = [b'name="base"' in body for _, body, _ in server.asked]
    assert bodies == [False, True, False], "once by what was there, then all of it"


def test_deleted_scene_is_uploaded_again(server: Answering) -> None:
    uploads = Uploads(Client(server.url), digest_of)
    said: list[str] = []

    def ready() -> str:
        found = uploads.upload_and_prepare(
            {"scene.yaml": b"{}"}, "scene.yaml", "t", lambda done, size: None, lambda: False, said.append
        )
        return str(found["id"])

    server.answers["POST /api/scenes"] = 201, {"id": "one"}
    server.answers["GET /api/scenes/one"] = 200, {"id": "one", "status": "ready"}
    assert ready() == "one"
    server.answers["POST /api/scenes"] = 201, {"id": "two"}
    server.answers["GET /api/scenes/one"] = 404, {"detail": "There is no scene one."}
    server.answers["GET /api/scenes/two"] = 200, {"id": "two", "status": "ready"}
    assert ready() == "two"
    server.answers["GET /api/scenes/two"] = 200, {"id": "two", "status": "failed", "error": "it is empty"}
    with pytest.raises(FarmError, match="cannot read the scene: it is empty"):
        ready()


def test_job_is_polled_without_a_live_channel(server: Answering) -> None:
    """Without a live channel, as behind some proxies, the client polls the job, and reports the error message of a failed job."""
    job = {"id": "j", "state": "failed", "error": "it is too dark", "progress": 0.0, "frames": [{"number": 0}]}
    server.answers["POST /api/scenes"] = 201, {"id": "one"}
    server.answers["GET /api/scenes/one"] = 200, {"id": "one", "status": "ready", "warnings": []}
    server.answers["POST /api/jobs"] = 201, job
    server.answers["GET /api/jobs/j/live?frame=0"] = 200, b""
    server.answers["GET /api/jobs/j"] = 200, job
    client = Client(server.url)
    asked = RenderRequest({"scene.yaml": b"{}"}, "scene.yaml", "t", Light([0.5] * 3), {"spp": 4})
    rendering = Rendering(client, Uploads(client, digest_of), asked)
    events = []
    while not events or not isinstance(events[-1], Failed):
        events.append(rendering.events.get(timeout=30))
    assert events[-1].sentence == "The farm could not render it: it is too dark"
    said = next(json.loads(body) for key, body, _ in server.asked if key == "POST /api/jobs")
    assert said == {"spp": 4, "scene": "one", "environment": {"color": [0.5] * 3}, "name": "t"}


def test_cancel_works_while_the_farm_hangs(server: Answering) -> None:
    client = Client(server.url)
    server.answers["POST /api/scenes"] = 201, {"id": "one"}
    server.answers["GET /api/scenes/one"] = 200, {"status": "preparing", "step": "Reading"}
    asked = RenderRequest({"scene.yaml": b"{}"}, "scene.yaml", "t", Light([0.0] * 3), {})
    rendering = Rendering(client, Uploads(client, digest_of), asked)
    until = time.monotonic() + 30
    while not any(key == "GET /api/scenes/one" for key, _, _ in server.asked):
        assert time.monotonic() < until
        time.sleep(0.01)
    rendering.cancel()
    events = []
    while not events or not isinstance(events[-1], Failed):
        events.append(rendering.events.get(timeout=30))
    assert events[-1].sentence is None
    rendering.join(30)
