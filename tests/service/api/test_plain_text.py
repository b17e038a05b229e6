"""Tests that text with control characters or bidirectional overrides is rejected wherever the API accepts text."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.helpers import running_redis
from tests.service.conftest import OBJ, Service

HOSTILE = ("a\x1b[2Jb", "a\x9b2Jb", "txt.\u202exe", "a\u2067b")
TEXTS: list[tuple[str, str, dict[str, Any]]] = [
    ("POST", "/api/jobs", {"scene": "SCENE", "name": "*"}),
    ("POST", "/api/jobs", {"scene": "*"}),
    ("POST", "/api/jobs", {"scene": "SCENE", "needs": ["*"]}),
    ("POST", "/api/jobs", {"scene": "SCENE", "after": ["*"]}),
    ("POST", "/api/jobs", {"scene": "SCENE", "deadline": "*"}),
    ("POST", "/api/jobs", {"scene": "SCENE", "frames": "*"}),
    ("POST", "/api/jobs", {"scene": "SCENE", "environment": {"preset": "*"}}),
    ("POST", "/api/jobs/changes", {"jobs": ["JOB"], "action": "*"}),
    ("PATCH", "/api/jobs/JOB", {"name": "*"}),
    ("PATCH", "/api/jobs/JOB", {"note": "*"}),
    ("PATCH", "/api/jobs/JOB", {"needs": ["*"]}),
    ("POST", "/api/users", {"name": "*", "role": "view"}),
    ("POST", "/api/projects", {"name": "*"}),
    ("POST", "/api/tokens", {"name": "*", "role": "view"}),
    ("POST", "/api/scenes?project=*", {}),
]


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("texts") / "data", redis_server)
    shown = (service.options["data"] / "owner-token").read_text().strip()
    service.http.headers["Authorization"] = f"Bearer {shown}"
    yield service
    service.stop()


@pytest.fixture(scope="module")
def ids(service: Service) -> dict[str, str]:
    with service.worker():
        scene = service.ready_scene()
        return {"SCENE": scene, "JOB": service.submit(scene)}


def _filled(value: Any, ids: dict[str, str], text: str) -> Any:
    if isinstance(value, dict):
        return {name: _filled(each, ids, text) for name, each in value.items()}
    if isinstance(value, list):
        return [_filled(each, ids, text) for each in value]
    return text if value == "*" else ids.get(value, value)


@pytest.mark.parametrize(("method", "path", "body"), TEXTS, ids=lambda value: str(value)[:60])
def test_control_characters_are_rejected_and_shown_escaped(
    service: Service, ids: dict[str, str], method: str, path: str, body: dict[str, Any]
) -> None:
    for text in HOSTILE:
        at = path.replace("JOB", ids["JOB"])
        if at.endswith("*"):
            at = at.removesuffix("*")
            answer = service.http.post(at.partition("?")[0], params={"project": text}, files={"files": ("a.obj", OBJ)})
            assert answer.status_code == 404, "there is no project of this name"
        else:
            answer = service.http.request(method, at, json=_filled(body, ids, text))
            assert answer.status_code in (404, 422), answer.text
        detail = answer.json()["detail"]
        assert detail.endswith((".", "?")) and not any(each in detail for each in "\x1b\x9b\u202e\u2067"), detail


@pytest.mark.parametrize("text", HOSTILE)
def test_control_characters_in_file_names_are_rejected(service: Service, text: str) -> None:
    for kind in ("environments", "references"):
        answer = service.http.post(f"/api/{kind}", files={"file": (f"{text}.png", b"x")})
        assert answer.status_code == 422, answer.text
    for names in ({"name": text}, {"main": text}, {"environment": text}, {"base": text}):
        answer = service.http.post("/api/scenes", data=names, files={"files": ("a.obj", OBJ)})
        assert answer.status_code in (404, 422), answer.text
        assert not any(each in answer.json()["detail"] for each in "\x1b\x9b\u202e\u2067")
    answer = service.http.post("/api/scenes", files={"files": (f"{text}.obj", OBJ)})
    assert answer.status_code in (400, 422), answer.text


def test_line_breaks_and_other_scripts_are_accepted(service: Service, ids: dict[str, str]) -> None:
    note = "first\nsecond\twith a tab\r\nשלום мир 🏠"
    answer = service.http.patch(f"/api/jobs/{ids['JOB']}", json={"note": note, "name": "שלום 🏠"})
    assert answer.status_code == 200, answer.text
    assert answer.json()["note"] == note.replace("\r\n", "\n")


def test_audit_log_escapes_control_characters(service: Service) -> None:
    service.http.post("/api/login", json={"name": "a\u202eb", "password": "x"})
    found = service.http.get("/api/audit", params={"limit": 5}).json()
    assert any(line["who"] == "a\\u202eb" for line in found)
