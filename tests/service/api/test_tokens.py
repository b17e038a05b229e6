"""Tests of which tokens may list, create and revoke tokens."""

from __future__ import annotations

from collections.abc import Iterator

import httpx
import pytest

from tests.helpers import running_redis
from tests.service.conftest import Service


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("tokens") / "data", redis_server)
    yield service
    service.stop()


def test_read_only_token_revokes_only_itself(service: Service) -> None:
    """A read-only token, which may be widely shared, can revoke itself but none of its owner's other tokens."""
    path = service.options["data"] / "owner-token"
    owner = {"Authorization": f"Bearer {path.read_text().strip()}"}

    def made(role: str) -> dict[str, str]:
        answer: dict[str, str] = service.http.post("/api/tokens", json={"name": role, "role": role}, headers=owner).json()
        return answer

    def withdraw(token: dict[str, str], shown: dict[str, str]) -> httpx.Response:
        return service.http.delete(f"/api/tokens/{token['id']}", headers={"Authorization": f"Bearer {shown['secret']}"})

    looks, looks_too, submits = made("view"), made("view"), made("submit")
    refused = withdraw(submits, looks)
    assert (refused.status_code, "This token is read-only: it can withdraw itself, but no other" in refused.text) == (403, True)
    assert withdraw(looks, looks).status_code == 204
    assert withdraw(looks_too, submits).status_code == 204


@pytest.mark.parametrize("name", ["t\x1b]52;c;cHduZWQ=\x07", "two\nlines", "turned\u202e"])
def test_token_name_with_control_characters_is_rejected(service: Service, name: str) -> None:
    shown = {"Authorization": f"Bearer {(service.options['data'] / 'owner-token').read_text().strip()}"}
    answer = service.http.post("/api/tokens", json={"name": name, "role": "view", "days": 1}, headers=shown)
    assert answer.status_code == 422
    assert "control characters" in answer.json()["detail"]
