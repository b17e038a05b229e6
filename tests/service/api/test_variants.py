"""Tests of jobs with a material variant of a glTF file, which is compiled again from the same files."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.helpers import running_redis
from tests.service.conftest import OBJ, TOKEN, Service, until


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("variants") / "data", redis_server)
    with service.worker():
        yield service
    service.stop()


def refused(answer: Any, status: int) -> str:
    assert answer.status_code == status, answer.text
    return str(answer.json()["detail"])


@pytest.mark.long
def test_variant_belongs_to_request_and_creates_no_scene(service: Service) -> None:
    """A material variant, by name or number and also with a sky, belongs to a job's request and creates no scene in the lists."""
    scene = service.upload(OBJ + b"# variants\n")
    until(lambda: service.scene(scene)["status"] == "ready", "the scene is prepared")
    assert (service.scene(scene)["variants"], service.scene(scene)["variant"]) == (["beach", "night", "night"], None)

    def lit(variant: str | None, **more: Any) -> str | None:
        job = service.job(service.submit(scene, variant=variant, **more))
        assert (job["scene"], job["variant"]) == (scene, variant)
        row = service.farm.records.job(job["id"])
        assert row is not None
        return row.lit

    shown = {"Authorization": f"Bearer {TOKEN}"}
    night = lit("night")
    assert service.http.get(f"/api/farm/scenes/{night}/manifest", headers=shown).json()["variant"] == "night"
    assert night == lit("1"), "the same variant is the same"
    assert lit("2") not in (night, None), "names may be alike"
    assert lit("") is None, "the file's own materials"
    both = lit("0", environment={"sky": {"elevation": 30}})
    found = service.http.get(f"/api/farm/scenes/{both}/manifest", headers=shown).json()
    assert (found["variant"], found["environment"], found["base"]) == ("beach", "sky:30,0", None)
    assert [each["id"] for each in service.http.get("/api/scenes").json()] == [scene]


def test_unknown_variant_error_lists_variants(service: Service) -> None:
    scene = service.ready_scene()
    with_variants = service.upload(OBJ + b"# variants\n")
    until(lambda: service.scene(with_variants)["status"] == "ready", "the scene is prepared")
    for variant in ("day", "3", "²", "-1"):
        answer = service.http.post("/api/jobs", json={"scene": with_variants, "variant": variant})
        assert "its variants are 0: beach, 1: night, 2: night" in refused(answer, 422)
    assert "it has none" in refused(service.http.post("/api/jobs", json={"scene": scene, "variant": "day"}), 422)
    refused(service.http.post("/api/jobs", json={"scene": "none", "variant": "day"}), 404)
    refused(service.http.post("/api/jobs", json={"scene": scene, "variant": 1}), 422)
