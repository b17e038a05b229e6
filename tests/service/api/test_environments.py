"""Tests of environments: presets, and uploaded images, which are validated, stored once, shown, used and deleted."""

from __future__ import annotations

from collections.abc import Iterator

import httpx
import pytest

from renderer.presets import PRESETS
from tests.helpers import running_redis
from tests.service.conftest import TOKEN, Service, until
from tests.service.peer_worker import PeerWorker

IMAGE = b"an image of all directions"
SHOWN = {"Authorization": f"Bearer {TOKEN}"}


@pytest.fixture(scope="module")
def service_and_worker(
    tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis
) -> Iterator[tuple[Service, PeerWorker]]:
    service = Service(tmp_path_factory.mktemp("environments") / "data", redis_server, max_upload_bytes=100_000)
    with service.worker() as worker:
        yield service, worker
    service.stop()


def post(service: Service, name: str, content: bytes) -> httpx.Response:
    return service.http.post("/api/environments", files={"file": (name, content)})


def blobs(service: Service) -> int:
    return sum(each.is_file() for each in (service.options["data"] / "blobs").rglob("*"))


@pytest.mark.long
def test_presets_are_listed_with_thumbnails(service_and_worker: tuple[Service, PeerWorker]) -> None:
    service, _ = service_and_worker
    listed = service.http.get("/api/environments").json()
    assert [each["id"] for each in listed[: len(PRESETS)]] == list(PRESETS)
    scene = service.ready_scene()
    for each in listed[: len(PRESETS)]:
        picture = service.http.get(each["thumbnail"])
        assert (picture.headers["content-type"], picture.content[:2]) == ("image/jpeg", b"\xff\xd8")
        service.submit(scene, environment=each["environment"], spp=1)
    assert service.http.delete("/api/environments/studio").status_code == 409


@pytest.mark.long
def test_environment_image_is_validated_and_stored_once(service_and_worker: tuple[Service, PeerWorker]) -> None:
    service, worker = service_and_worker
    made = post(service, "folder/window.exr", IMAGE)
    assert made.status_code == 201, made.text
    assert (made.json()["name"], made.json()["kind"], made.json()["bytes"]) == ("window.exr", "image", len(IMAGE))
    looked = len(worker.shown)
    assert post(service, "again.exr", IMAGE).json() == made.json()
    assert len(worker.shown) == looked
    assert service.http.get(made.json()["thumbnail"]).content == IMAGE[::-1]
    assert made.json() in service.http.get("/api/environments").json()

    scene = service.ready_scene()
    waits = service.submit(scene, environment={**made.json()["environment"], "rotation": 30}, spp=4000, priority=-100)
    job = service.job(waits)
    assert (job["scene"], job["environment"]["name"], job["settings"]["environment_rotation"]) == (scene, "window.exr", 30)
    row = service.farm.records.job(waits)
    assert row is not None
    manifest = service.http.get(f"/api/farm/scenes/{row.lit}/manifest", headers=SHOWN).json()
    assert manifest["environment"] in [file["path"] for file in manifest["files"]]
    assert service.http.delete(f"/api/environments/{made.json()['id']}").status_code == 409, "a job needs it"
    service.patch(waits, state="cancelled")
    assert service.http.delete(f"/api/environments/{made.json()['id']}").status_code == 204
    assert service.http.get(made.json()["thumbnail"]).status_code == 404
    assert service.job(waits)["environment"]["name"] == "window.exr", "a job still says what lit it"
    gone = service.http.post("/api/jobs", json={"scene": scene, "environment": made.json()["environment"]})
    assert (gone.status_code, "there is no image" in gone.json()["detail"]) == (422, True)


@pytest.mark.parametrize(
    ("name", "content", "status", "says"),
    [
        ("broken.exr", b"black", 422, "broken.exr: is black all over"),
        ("scene.glb", b"glTF", 422, "best an .exr or .hdr"),
        ("empty.exr", b"", 422, "is empty"),
        ("large.exr", bytes(200_000), 413, "larger than"),
        (
            "larger.exr",
            bytes(1_200_000),
            413,
            "larger than the 100000 bytes",
        ),  # limited by the environment limit, not by that of other bodies
    ],
)
def test_unusable_environment_leaves_no_files(
    service_and_worker: tuple[Service, PeerWorker], name: str, content: bytes, status: int, says: str
) -> None:
    service, _ = service_and_worker
    until(lambda: service.farm.engine.snapshot.roster.environment_kind() is not None, "a worker is ready")
    before = blobs(service)
    answer = post(service, name, content)
    assert (answer.status_code, says in answer.json()["detail"]) == (status, True), answer.text
    assert blobs(service) == before


def test_older_workers_get_no_environment_requests(service_and_worker: tuple[Service, PeerWorker]) -> None:
    service, worker = service_and_worker
    worker.views = False
    try:
        until(lambda: service.farm.engine.snapshot.roster.environment_kind() is None, "the service sees it")
        until(lambda: bool(service.http.get("/api/workers").json()), "the worker reports")
        answer = post(service, "sky.exr", b"an image that nobody knows")
        assert answer.status_code == 503 and "older release" in answer.text
    finally:
        worker.views = True
