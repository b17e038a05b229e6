"""Tests of uploads with `strict`: a scene with warnings fails and lists them, and is not shared with a non-strict upload."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from rayfarm.client import Client, ClientError
from tests.service.conftest import OBJ, Service, until

GUESSED = OBJ + b"# guessed\n"
ERROR = "strict turns the scene's 2 warnings into errors: 2 materials were guessed. The file x.png is missing."
WARNINGS = ["2 materials were guessed.", "The file x.png is missing."]


def upload_strict(service: Service, content: bytes = GUESSED, query: str = "", **fields: str) -> dict[str, Any]:
    files = {"files": ("scene.obj", content)}
    answer = service.http.post(f"/api/scenes{query}", data=fields, files=files)
    assert answer.status_code == 201, answer.text
    found: dict[str, Any] = answer.json()
    return found


def prepared(service: Service, scene: dict[str, Any]) -> dict[str, Any]:
    until(lambda: service.scene(scene["id"])["status"] != "preparing", "the scene is prepared")
    return service.scene(scene["id"])


def job(service: Service, scene: str, **request: Any) -> Any:
    return service.http.post("/api/jobs", json={"scene": scene, "width": 16, "height": 16, "spp": 1, **request})


def test_warnings_fail_only_strict_scenes(service: Service) -> None:
    with service.worker():
        strict, lenient = upload_strict(service, strict="true"), upload_strict(service)
        assert (strict["strict"], lenient["strict"]) == (True, False)
        assert strict["id"] != lenient["id"]
        refused = prepared(service, strict)
        assert (refused["status"], refused["error"], refused["warnings"]) == ("failed", ERROR, WARNINGS)
        taken = prepared(service, lenient)
        assert (taken["status"], taken["error"], taken["warnings"]) == ("ready", None, WARNINGS)
        answer = job(service, strict["id"])
        assert (answer.status_code, answer.json()["detail"]) == (409, f"The scene cannot be rendered: {ERROR}")
        again = upload_strict(service, strict="true")
        assert again["id"] == strict["id"]
        assert prepared(service, again)["warnings"] == WARNINGS, "once, although it was prepared again"
        added = service.http.post("/api/scenes", data={"base": strict["id"]}, files={"files": ("x.mtl", b"newmtl a")}).json()
        assert added["strict"], "a strict scene with more files is strict too"
        freed = {"base": strict["id"], "strict": "false"}
        added = service.http.post("/api/scenes", data=freed, files={"files": ("x.mtl", b"newmtl a")}).json()
        assert not added["strict"]


def test_strict_scene_without_warnings_is_rendered(service: Service) -> None:
    with service.worker():
        scene = upload_strict(service, OBJ, query="?strict=true")
        assert scene["strict"]
        assert prepared(service, scene)["status"] == "ready"
        made = job(service, scene["id"], strict=True).json()
        service.wait_for(made["id"], "finished")
        lit = job(service, scene["id"], environment={"preset": "studio"}).json()
        service.wait_for(lit["id"], "finished")


def test_job_waiting_for_strict_scene_fails_with_warnings(service: Service) -> None:
    scene = upload_strict(service, strict="1")
    plain, lit = (job(service, scene["id"], **more).json()["id"] for more in ({}, {"environment": {"preset": "studio"}}))
    with service.worker():
        for id in (plain, lit):
            service.wait_for(id, "failed")
            assert service.job(id)["error"] == ERROR


def test_strict_job_of_non_strict_scene(service: Service) -> None:
    scene = upload_strict(service)
    waits = job(service, scene["id"], strict=True).json()["id"]
    with service.worker():
        service.wait_for(waits, "failed")
        assert service.job(waits)["error"] == ERROR
        answer = job(service, scene["id"], strict=True)
        assert (answer.status_code, answer.json()["detail"]) == (422, ERROR)
        assert job(service, scene["id"]).status_code == 201


def test_frame_with_warnings_fails_in_strict_shot(service: Service) -> None:
    with service.worker() as worker:
        worker.frame_warnings = ["1 light was dropped."]
        scene = upload_strict(service, OBJ)
        prepared(service, scene)
        ids = [job(service, scene["id"], frames="0-1", strict=strict).json()["id"] for strict in (True, False)]
        service.wait_for(ids[0], "failed")
        frames = service.http.get(f"/api/jobs/{ids[0]}").json()["frames"]
        assert {frame["error"] for frame in frames} == {"strict turns the scene's warning into an error: 1 light was dropped."}
        service.wait_for(ids[1], "finished")


@pytest.mark.parametrize("value", ["yes", "2"])
def test_non_boolean_strict_is_rejected(service: Service, value: str) -> None:
    answer = service.http.post("/api/scenes", data={"strict": value}, files={"files": ("a.obj", OBJ)})
    assert answer.status_code == 422
    assert answer.json()["detail"] == f"strict is {value!r}; it must be true or false."


def test_client_and_openapi_support_strict(service: Service, tmp_path: Path) -> None:
    (tmp_path / "scene.obj").write_bytes(GUESSED)
    with Client(service.url) as farm, service.worker():
        scene = farm.upload(tmp_path / "scene.obj", strict=True)
        assert scene.strict
        with pytest.raises(ClientError, match="2 materials were guessed"):
            farm.wait_for_scene(scene.id)
    described = service.http.get("/openapi.json").json()["paths"]["/api/scenes"]["post"]
    form = described["requestBody"]["content"]["multipart/form-data"]["schema"]["properties"]
    assert form["strict"]["type"] == "boolean"
    assert any(each["name"] == "strict" and each["in"] == "query" for each in described["parameters"])
