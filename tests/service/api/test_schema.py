"""Requests made of the API's own description, with ids of real scenes, jobs and workers in every state.

Whatever comes in, the answer is one that the description names, in the form that it names, and no fault of the service.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import hypothesis
import pytest
import schemathesis
from hypothesis import strategies as st
from schemathesis.specs.openapi.checks import content_type_conformance, response_schema_conformance, status_code_conformance

from service.main import create_app
from service.settings import Settings
from tests.helpers import running_redis
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker

FAULTS_ALLOWED = {503, 507}  # what is away or full comes back; nothing else beyond 499 is a client's business
ENDLESS = "/api/events"


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("schema") / "data", redis_server.url, max_pixels=1 << 16, max_upload_files=8)
    yield service
    service.stop()


class Alive:
    """A service with scenes and jobs in every state there is."""

    def __init__(self, service: Service, worker: PeerWorker) -> None:
        self.service = service
        hold = threading.Event()
        worker.on_prepare = lambda scene: hold.wait(60) if scene in self.scenes.get("preparing", "") else None
        self.hold = hold
        self.scenes: dict[str, str] = {"ready": service.ready_scene(), "failed": service.upload(b"broken", "broken.obj")}
        until(lambda: service.scene(self.scenes["failed"])["status"] == "failed", "a scene fails")
        ready = self.scenes["ready"]
        self.jobs = {"finished": service.submit(ready, width=32, height=32, spp=2)}
        service.wait_for(self.jobs["finished"], "finished")

        def fail_or_wait(batch: Any) -> None:
            if batch.job == self.jobs.get("failed"):
                raise ValueError("this batch fails")
            if batch.job == self.jobs.get("running") and batch.first > 4:
                hold.wait(60)

        worker.on_batch = fail_or_wait
        self.jobs["failed"] = service.submit(ready, width=32, height=32, spp=3)
        service.wait_for(self.jobs["failed"], "failed", timeout=60)
        for state in ("cancelled", "paused"):
            self.jobs[state] = service.submit(ready, width=32, height=32, spp=1 << 16, priority=-50)
            service.patch(self.jobs[state], state=state)
        self.jobs["running"] = service.submit(ready, width=32, height=32, spp=1 << 16, priority=50)
        service.wait_for(self.jobs["running"], "running")
        self.jobs["queued"] = service.submit(ready, width=32, height=32, spp=8, priority=-100)
        self.check()

    def check(self) -> None:
        for state in ("finished", "failed", "cancelled", "paused", "running", "queued"):
            assert self.service.job(self.jobs[state])["state"] == state


@pytest.fixture(scope="module")
def alive(service: Service) -> Iterator[Alive]:
    with service.worker(slots=1) as worker:
        alive = Alive(service, worker)
        yield alive
        alive.hold.set()


@pytest.fixture(scope="module")
def schema(alive: Alive) -> Any:
    return schemathesis.openapi.from_url(f"{alive.service.url}/openapi.json")


def ids(path: str, alive: Alive) -> list[str]:
    known = list(alive.scenes.values()) if "/scenes/" in path else list(alive.jobs.values())
    return [*known, "nothing", "%00", "ü", "a" * 300]


def tried(path: str, method: str, schema: Any, alive: Alive, examples: int) -> dict[int, int]:
    """Call an operation many times; how often it answered with which status."""
    seen: dict[int, int] = {}
    operation = schema[path][method]
    live = [known for known in ids(path, alive) if len(known) == 20]

    @hypothesis.settings(
        max_examples=examples,
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=list(hypothesis.HealthCheck),
        phases=[hypothesis.Phase.generate],
    )
    @hypothesis.given(st.data())
    def attack(data: st.DataObject) -> None:
        case = data.draw(operation.as_strategy(generation_mode=data.draw(st.sampled_from(list(schemathesis.GenerationMode)))))
        for name in ("id", "job", "name"):
            if name in (case.path_parameters or {}) and data.draw(st.integers(0, 9)) < 8:
                pool = ["peer"] if "/workers/" in path else ["cornell-box"] if "/examples/" in path else ids(path, alive)
                case.path_parameters[name] = data.draw(st.sampled_from(pool))
        if isinstance(case.body, dict) and "scene" in case.body and data.draw(st.booleans()):
            case.body["scene"] = alive.scenes["ready"]
        if "/farm/" in path and data.draw(st.booleans()):
            case.headers = {**(case.headers or {}), "Authorization": f"Bearer {alive.service.options['token']}"}
        if method == "DELETE" and (case.path_parameters or {}).get("id") in live:
            return  # tested with what may go
        response = case.call(timeout=20)
        seen[response.status_code] = seen.get(response.status_code, 0) + 1
        judge(case, response)

    attack()
    return seen


def judge(case: Any, response: Any) -> None:
    status, kind = response.status_code, response.headers.get("content-type", [""])[0]
    about = f"{case.method} {case.formatted_path} {case.query} {case.body!r:.300}: {status} {response.text[:300]}"
    assert status < 500 or status in FAULTS_ALLOWED, about
    if status >= 400:
        assert kind == "application/problem+json", about
        problem = response.json()
        assert problem["status"] == status and problem["detail"].endswith("."), about
        return
    case.validate_response(response, checks=[content_type_conformance, response_schema_conformance, status_code_conformance])


def operations() -> list[tuple[str, str]]:
    paths = create_app(Settings()).openapi()["paths"]
    return [(path, method.upper()) for path, methods in paths.items() for method in methods if path != ENDLESS]


@pytest.mark.parametrize(("path", "method"), operations())
def test_every_operation_answers_as_it_is_described(path: str, method: str, schema: Any, alive: Alive) -> None:
    assert tried(path, method, schema, alive, 20)
