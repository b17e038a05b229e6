"""A job under a variant of a glTF file's materials: another compiled scene of the same files."""

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


def test_a_variant_makes_the_scene_another_one(service: Service) -> None:
    """By its name or its number, from the scene itself or from another of its variants; and under a sky as well."""
    scene = service.upload(OBJ + b"# variants\n")
    until(lambda: service.scene(scene)["status"] == "ready", "the scene is prepared")
    assert (service.scene(scene)["variants"], service.scene(scene)["variant"]) == (["beach", "night", "night"], None)

    def scene_of(of: str, variant: str, **more: Any) -> str:
        return str(service.job(service.submit(of, variant=variant, **more))["scene"])

    shown = {"Authorization": f"Bearer {TOKEN}"}
    night = scene_of(scene, "night")
    assert night != scene
    assert service.scene(night)["variant"] == "night"
    assert service.scene(night)["files"] == service.scene(scene)["files"]
    assert service.http.get(f"/api/farm/scenes/{night}/manifest", headers=shown).json()["variant"] == "night"
    until(lambda: service.scene(night)["status"] == "ready", "the variant is prepared")
    assert scene_of(scene, "1") == scene_of(night, "night") == night, "the same variant is the same scene"
    assert service.scene(scene_of(scene, "2"))["variant"] == "2", "names may be alike"
    assert scene_of(night, "") == scene, "and back to the file's own materials"
    assert service.job(service.submit(night))["scene"] == night
    both = service.scene(scene_of(night, "0", environment={"sky": {"elevation": 30}}))
    assert both["variant"] == "beach"
    lit = service.job(service.submit(night, environment={"sky": {"elevation": 30}}))["scene"]
    assert service.scene(lit)["variant"] == "night", "a sky leaves the materials as they are"
    assert [service.scene(id)["environment"] for id in (both["id"], lit, night)] == ["sky:30,0", "sky:30,0", None]


def test_an_unknown_variant_is_told_which_there_are(service: Service) -> None:
    scene = service.ready_scene()
    with_variants = service.upload(OBJ + b"# variants\n")
    until(lambda: service.scene(with_variants)["status"] == "ready", "the scene is prepared")
    for variant in ("day", "3", "²", "-1"):
        answer = service.http.post("/api/jobs", json={"scene": with_variants, "variant": variant})
        assert "its variants are 0: beach, 1: night, 2: night" in refused(answer, 422)
    assert "it has none" in refused(service.http.post("/api/jobs", json={"scene": scene, "variant": "day"}), 422)
    refused(service.http.post("/api/jobs", json={"scene": "none", "variant": "day"}), 404)
    refused(service.http.post("/api/jobs", json={"scene": scene, "variant": 1}), 422)
