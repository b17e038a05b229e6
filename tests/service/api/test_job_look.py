"""Tests of a job's default name and look (exposure, tone curve): stored and shown; the API's pictures do not change."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from service.intake.picture import picture_hash
from service.store.models import Job
from tests.helpers import running_redis
from tests.service.conftest import OBJ, Service

LOOK = {"exposure": 0.8, "tonemap": "agx"}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("look") / "data", redis_server)
    with service.worker():
        yield service
    service.stop()


def test_look_is_stored_and_changes_no_picture(service: Service) -> None:
    scene = service.ready_scene()
    plain, looked = service.submit(scene), service.submit(scene, **LOOK)
    for job in (plain, looked):
        service.wait_for(job, "finished")
    assert {name: service.job(looked)[name] for name in LOOK} == LOOK
    assert {name: service.job(plain)[name] for name in LOOK} == {"exposure": 0.0, "tonemap": "neutral"}
    with service.farm.sessions() as session:
        assert len({picture_hash(session.get_one(Job, job)) for job in (plain, looked)}) == 1, (
            "one can reuse samples of the other"
        )
    image = lambda job, **query: service.http.get(f"/api/jobs/{job}/frames/0/image.png", params=query).content  # noqa: E731
    assert image(plain) == image(looked) != image(looked, **LOOK)


def test_default_look_is_not_stored(service: Service) -> None:
    """A repeated request compares equal to one of an older release, which has no such fields."""
    request = {"scene": service.ready_scene(), "width": 16, "height": 16, "spp": 1}
    said = {**request, "exposure": 0.0, "tonemap": "neutral"}
    first, second = (service.http.post("/api/jobs", json=each, headers={"Idempotency-Key": "look"}) for each in (request, said))
    assert first.raise_for_status().json()["id"] == second.raise_for_status().json()["id"]


def test_jobs_without_a_name_are_numbered(service: Service) -> None:
    """Otherwise the jobs of a scene could not be told apart in lists. Names of other jobs are kept."""
    scene = service.upload(OBJ + b"# one\n")
    name = service.scene(scene)["name"]
    wanted = (None, None, f"{name} 7", f"{name} at night", None, name)
    given = [service.job(service.submit(scene, name=each))["name"] for each in wanted]
    assert given == [name, f"{name} 2", f"{name} 7", f"{name} at night", f"{name} 8", name]
    assert service.job(service.submit(service.upload(OBJ + b"# another\n")))["name"] == name, "of another scene"


@pytest.mark.parametrize("look", [{"exposure": 33}, {"exposure": "bright"}, {"tonemap": "sepia"}, {"tonemap": "ocio:None/None"}])
def test_invalid_look_is_rejected(service: Service, look: dict[str, object]) -> None:
    answer = service.http.post("/api/jobs", json={"scene": service.ready_scene(), **look})
    assert answer.status_code == 422
    assert str(next(iter(look.values()))) in answer.json()["detail"] or next(iter(look)) in answer.json()["detail"]
