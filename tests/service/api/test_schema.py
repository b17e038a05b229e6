"""Tests with requests generated from the OpenAPI document, with ids of real scenes, jobs and workers in every state.

Every response is declared in the document, has the declared form, and is never an internal error.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any

import hypothesis
import pytest
from hypothesis import strategies as st

from service.errors import Unavailable
from tests.helpers import running_redis
from tests.service.conftest import OBJ, Service, until
from tests.service.peer_worker import PeerWorker

FAULTS_ALLOWED = {503, 507}  # temporarily unavailable or out of space; any other status from 500 is a bug
ENDLESS = "/api/events"
ENDLESS_SPP = 1 << 16
FAILS = 13
EXAMPLES = 60  # of requests to an operation
LONGEST_S = 3600.0  # limit for all tests of this file


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    limits = {"max_pixels": 1 << 16, "batch_deadline": LONGEST_S, "prepare_deadline": LONGEST_S}
    service = Service(tmp_path_factory.mktemp("schema") / "data", redis_server, **limits)
    yield service
    service.stop()


def _nobody(*wish: Any) -> Any:
    raise Unavailable("The worker has other things to do. Try again.")


class Alive:
    """A running service with scenes and jobs in every state, and their ids."""

    def __init__(self, service: Service, worker: PeerWorker) -> None:
        self.service = service
        self.done = threading.Event()
        self.scenes = {"ready": service.ready_scene(), "failed": service.upload(b"broken", "broken.obj")}
        until(lambda: service.scene(self.scenes["failed"])["status"] == "failed", "a scene fails")

        def fail(batch: Any) -> None:
            if batch.settings.seed == FAILS:
                raise ValueError("this batch fails")

        worker.on_batch = fail
        self.jobs: dict[str, str] = {}
        for state, request in {
            "finished": {"spp": 2},
            "failed": {"spp": 3, "seed": FAILS},
            "cancelled": {"spp": ENDLESS_SPP, "priority": -50},
            "paused": {"spp": ENDLESS_SPP, "priority": -50},
            "running": {"spp": ENDLESS_SPP, "priority": 100},
        }.items():
            self.jobs[state] = service.submit(self.scenes["ready"], width=32, height=32, **request)
            if state in ("cancelled", "paused"):
                service.patch(self.jobs[state], state=state)
            service.wait_for(self.jobs[state], state, timeout=60)
        # This scene occupies the only slot, so jobs keep their states.
        worker.on_prepare = lambda scene: bool(self.done.wait(LONGEST_S)) and None
        service.farm.engine.show_environment = _nobody  # type: ignore[method-assign]
        service.farm.explaining.explain = _nobody  # type: ignore[method-assign]
        service.farm.engine.worker_log = lambda name: None  # type: ignore[method-assign]
        service.farm.retention.carry_out = lambda items: items  # type: ignore[method-assign]
        self.scenes["preparing"] = service.upload(OBJ + b"# another")
        until(lambda: worker.prepared[-1] == self.scenes["preparing"], "the worker prepares")
        self.jobs["queued"] = service.submit(self.scenes["ready"], width=32, height=32, spp=8, priority=-100)
        self.check()

    def check(self) -> None:
        assert {state: self.service.job(id)["state"] for state, id in self.jobs.items()} == {s: s for s in self.jobs}
        assert {status: self.service.scene(id)["status"] for status, id in self.scenes.items()} == {s: s for s in self.scenes}


@pytest.fixture(scope="module")
def alive(service: Service) -> Iterator[Alive]:
    with service.worker(slots=1) as worker:
        alive = Alive(service, worker)
        try:
            yield alive
            alive.check()
        finally:
            alive.done.set()


@pytest.fixture(scope="module")
def schema(alive: Alive) -> Any:
    import schemathesis  # imported here, since it takes a second

    return schemathesis.openapi.from_url(f"{alive.service.url}/openapi.json")


def ids(path: str, alive: Alive) -> list[str]:
    known = list(alive.scenes.values()) if "/scenes/" in path else list(alive.jobs.values())
    return [*known, "nothing", "%00", "ü", "a" * 300]


def new_id(path: str, alive: Alive) -> str:
    """Returns the id of a new scene or job, depending on `path`, for a request that may change or delete it.

    The scenes and jobs of `alive` thus keep their states.
    """
    if "/scenes/" in path:
        return alive.service.upload(OBJ + f"# {time.monotonic_ns()}".encode())
    return alive.service.submit(alive.scenes["ready"], width=32, height=32, priority=-100)


def send_generated_requests(path: str, method: str, schema: Any, alive: Alive) -> dict[int, int]:
    """Sends EXAMPLES generated requests to one operation; returns the number of responses by status.

    Each response is checked against the OpenAPI document.
    """
    from schemathesis import GenerationMode

    seen: dict[int, int] = {}
    operation = schema[path][method]
    live = [known for known in ids(path, alive) if len(known) == 20]

    @hypothesis.settings(
        max_examples=EXAMPLES,
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=list(hypothesis.HealthCheck),
        phases=[hypothesis.Phase.generate],
    )
    @hypothesis.given(st.data())
    def attack(data: st.DataObject) -> None:
        case = data.draw(operation.as_strategy(generation_mode=data.draw(st.sampled_from(list(GenerationMode)))))
        for name in ("id", "job", "name"):
            if name in (case.path_parameters or {}) and data.draw(st.integers(0, 9)) < 8:
                pool = ["peer"] if "/workers/" in path else ["cornell-box"] if "/examples/" in path else ids(path, alive)
                case.path_parameters[name] = data.draw(st.sampled_from(pool))
        if isinstance(case.body, dict) and "scene" in case.body and data.draw(st.booleans()):
            case.body["scene"] = alive.scenes["ready"]
        if (case.query or {}).get("which") == "coming":
            case.query["which"] = "all"  # the other kind of stream ends only with the job
        if "/farm/" in path and data.draw(st.booleans()):
            case.headers = {**(case.headers or {}), "Authorization": f"Bearer {alive.service.options['token']}"}
        if (method in ("DELETE", "PATCH") or path.endswith("/anew")) and (case.path_parameters or {}).get("id") in live:
            case.path_parameters["id"] = new_id(path, alive)
        response = case.call(timeout=20)
        seen[response.status_code] = seen.get(response.status_code, 0) + 1
        judge(case, response)

    attack()
    return seen


def judge(case: Any, response: Any) -> None:
    from schemathesis.specs.openapi import checks

    status, kind = response.status_code, response.headers.get("content-type", [""])[0]
    about = f"{case.method} {case.formatted_path} {case.query} {case.body!r:.300}: {status} {response.content[:300]!r}"
    assert status < 500 or status in FAULTS_ALLOWED, about
    if status >= 400:
        assert kind == "application/problem+json", about
        problem = response.json()
        assert problem["status"] == status and problem["detail"].endswith("."), about
        return
    case.validate_response(
        response, checks=[checks.content_type_conformance, checks.response_schema_conformance, checks.status_code_conformance]
    )


def operations(alive: Alive, share: int) -> list[tuple[str, str]]:
    """Returns (path, method) of every eighth operation of the OpenAPI document, from the operation with index `share`."""
    paths = alive.service.http.get("/openapi.json").json()["paths"]
    return [(path, method.upper()) for path, methods in paths.items() for method in methods if path != ENDLESS][share::8]


@pytest.mark.long
@pytest.mark.parametrize("share", range(8))
def test_responses_match_openapi(share: int, schema: Any, alive: Alive) -> None:
    for path, method in operations(alive, share):
        assert send_generated_requests(path, method, schema, alive)
