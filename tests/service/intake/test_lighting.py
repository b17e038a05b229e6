"""Tests of jobs whose request gives the lighting.

Each lighting has one compiled scene, which is in no list of scenes, and is deleted when no job uses it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from service.intake.lighting import MAX_UNUSED
from service.store.models import Scene
from tests.helpers import running_redis
from tests.service.conftest import OBJ, TOKEN, Service, until
from tests.service.peer_worker import PeerWorker

SHOWN = {"Authorization": f"Bearer {TOKEN}"}


@pytest.fixture(scope="module")
def service_and_worker(
    tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis
) -> Iterator[tuple[Service, PeerWorker]]:
    service = Service(tmp_path_factory.mktemp("lighting") / "data", redis_server)
    with service.worker() as worker:
        yield service, worker
    service.stop()


@pytest.fixture
def service(service_and_worker: tuple[Service, PeerWorker]) -> Service:
    return service_and_worker[0]


def render_with_environment(service: Service, scene: str, **environment: Any) -> tuple[dict[str, Any], str | None]:
    """Renders a job; returns the finished job, and the derived scene that it was rendered from."""
    id = service.submit(scene, environment=environment)
    service.wait_for(id, "finished")
    row = service.farm.records.job(id)
    assert row is not None
    return service.job(id), row.lit


def scene_of(service: Service, more: bytes) -> str:
    scene = service.upload(OBJ + more)
    until(lambda: service.scene(scene)["status"] == "ready", "the scene is prepared")
    return scene


@pytest.mark.long
def test_lighting_creates_no_listed_scene(service: Service) -> None:
    scene = scene_of(service, b"# light\n")
    job, lit = render_with_environment(service, scene, sky={"elevation": 30, "azimuth": -240}, strength=2)
    assert job["scene"] == scene
    assert job["settings"]["environment_strength"] == 2
    assert job["environment"]["sky"] == {"elevation": 30, "azimuth": -240}
    assert render_with_environment(service, scene, sky={"elevation": 30.0, "azimuth": 120})[1] == lit, (
        "the same sky is prepared once"
    )
    assert render_with_environment(service, scene, sky={"elevation": 31})[1] not in (lit, None)
    assert render_with_environment(service, scene, color=[1, 0.5, 0.25])[1] is None, "a colour needs nothing else prepared"
    assert service.http.get("/api/scenes").headers["X-Total-Count"] == str(len(service.http.get("/api/scenes").json()))
    assert [each["id"] for each in service.http.get("/api/scenes").json() if each["name"] == "scene"].count(lit) == 0
    assert service.http.get(f"/api/scenes/{lit}").status_code == 404
    assert service.http.post("/api/jobs", json={"scene": lit}).status_code == 404
    manifest = service.http.get(f"/api/farm/scenes/{lit}/manifest", headers=SHOWN).json()
    assert manifest["environment"] == "sky:30,120"
    own = service.http.get(f"/api/farm/scenes/{scene}/manifest", headers=SHOWN).json()
    assert (manifest["files"], own["base"]) == (own["files"], None)
    with service.farm.sessions() as session:
        assert manifest["base"] == session.get_one(Scene, scene).info, "so that only the environment need be made"
    files = {"files": ("scene.obj", OBJ + b"# light\n")}
    uploaded = service.http.post("/api/scenes", files=files, data={"environment": "sky:30,120"}).json()
    assert uploaded["id"] == lit, "as older releases made it: so its digests are the same"
    assert service.http.get(f"/api/scenes/{lit}").status_code == 200, "uploaded so, it is a scene"


def test_view_holds_derived_scene_without_job(service_and_worker: tuple[Service, PeerWorker]) -> None:
    service, worker = service_and_worker
    scene = scene_of(service, b"# view\n")
    lighting = service.farm.lighting
    assert lighting.scene_for(scene, {}, worker.kind).status == "ready"
    wanted = {"preset": "studio"}
    found = lighting.scene_for(scene, {"environment": wanted}, worker.kind)
    assert found.status == "preparing" or found.compiled
    with lighting.holding(found.id):
        until(lambda: lighting.scene_for(scene, {"environment": wanted}, worker.kind).status == "ready", "the light is prepared")
        ready = lighting.scene_for(scene, {"environment": wanted}, worker.kind)
        assert ready.compiled in ready.blobs
        lighting.delete_unused(max_kept=0)
        assert service.farm.blobs.exists(ready.compiled or "")
    lighting.delete_unused(max_kept=0)
    with service.farm.sessions() as session:
        assert session.get(Scene, found.id) is None
    elsewhere = lighting.scene_for(scene, {}, "another kind")
    assert (elsewhere.status, elsewhere.compiled) == ("preparing", None)


@pytest.mark.long
def test_deleted_derived_scene_is_recreated_for_job(service: Service) -> None:
    scene = scene_of(service, b"# again\n")
    job, lit = render_with_environment(service, scene, sky={"elevation": 20})
    service.farm.lighting.delete_unused(max_kept=0)
    with service.farm.sessions() as session:
        assert session.get(Scene, lit) is None
    service.patch(job["id"], more=4)
    assert service.wait_for(job["id"], "finished")["spp"] == job["spp"] + 4


@pytest.mark.long
def test_unused_derived_scenes_are_limited(service: Service) -> None:
    scene = scene_of(service, b"# many\n")
    before = {each.name for each in (service.options["data"] / "blobs").rglob("*") if each.is_file()}
    for elevation in range(MAX_UNUSED + 3):
        service.farm.lighting.row(scene, {"environment": {"sky": {"elevation": elevation}}})
    service.farm.lighting.delete_unused()
    with service.farm.sessions() as session:
        rows = session.query(Scene).filter(Scene.of.is_not(None)).count()
    assert rows == MAX_UNUSED
    _, lit = render_with_environment(service, scene, sky={"elevation": 77})
    waiting = service.submit(scene, environment={"sky": {"elevation": 77}}, spp=4000)
    assert service.http.delete(f"/api/scenes/{scene}").status_code == 409, "a job needs it"
    service.patch(waiting, state="cancelled")
    assert service.http.delete(f"/api/scenes/{scene}").status_code == 204
    with service.farm.sessions() as session:
        assert session.query(Scene).filter(Scene.of == scene).count() == 0
        assert session.get(Scene, lit) is None
    left = {each.name for each in (service.options["data"] / "blobs").rglob("*") if each.is_file()}
    assert left < before
