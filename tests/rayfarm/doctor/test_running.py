"""Tests of what `rayfarm doctor` reports about Redis, workers, and a machine without a farm."""

from __future__ import annotations

import json
import socket
from pathlib import Path

import pytest
import redis

from rayfarm.doctor.finding import Finding
from rayfarm.doctor.running import check_redis, check_running_farm
from renderer import __version__
from service.settings import Settings
from tests.helpers import running_redis
from tests.rayfarm.program import rayfarm
from tests.service.conftest import Service


def findings_text(found: list[Finding], level: str) -> str:
    return "\n".join(each.says for each in found if each.level == level)


def test_redis_persistence_memory_and_workers_are_checked(service: Service, redis_server: running_redis) -> None:
    with redis.Redis.from_url(redis_server.url) as store, service.worker(name="old"):
        found = list(check_redis(redis_server.url))
        assert findings_text(found, "fault") == ""
        assert f"Of another release than {__version__}: old" in findings_text(found, "note"), "its kind says so"
        before = store.config_get("maxmemory*")
        try:
            store.config_set("maxmemory-policy", "allkeys-lru")
            store.set("much", bytes(16_000_000))  # large compared with the clients' buffers
            store.config_set("maxmemory", int(1.1 * store.info()["used_memory"]))
            found = list(check_redis(redis_server.url))
            assert "it forgets work (maxmemory-policy allkeys-lru)" in findings_text(found, "fault")
            assert "results wait to be merged" in findings_text(found, "note")
        finally:
            store.delete("much")
            for name, value in before.items():
                store.config_set(name, value)


@pytest.mark.parametrize(("verify", "is_noted"), [(0.0, True), (0.05, False)])
def test_unverified_workers_over_https_are_noted(
    service: Service, redis_server: running_redis, verify: float, is_noted: bool
) -> None:
    with service.worker(name="home", transport="https"):
        found = list(check_redis(redis_server.url, verify))
    assert ("Over HTTPS: home." in findings_text(found, "note")) is is_noted


def test_wrong_password_and_unreachable_redis_are_reported(redis_server: running_redis) -> None:
    wrong = redis_server.url.replace(redis_server.password, "wrong")
    assert "refuses the password" in findings_text(list(check_redis(wrong)), "fault")
    found = list(check_redis("redis://:secret@127.0.0.1:1/0"))
    assert "127.0.0.1:1/0 does not answer" in findings_text(found, "fault")
    assert "secret" not in str(found)


def test_ability_to_start_a_farm_is_checked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RAYFARM_REDIS_URL", raising=False)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        found = list(check_running_farm(Settings(data=tmp_path), other.getsockname()[1]))
    assert "No farm runs on" in findings_text(found, "note")
    assert "in use by another program" in findings_text(found, "fault")
    assert any(each.about == "Redis" and each.level == "fine" for each in found)


def test_exit_code_is_1_if_there_is_a_fault(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir(0o700)
    (tmp_path / "data" / "token").write_text("known to all")
    (tmp_path / "data" / "token").chmod(0o604)
    done = rayfarm("doctor", "--data", tmp_path / "data", "--json", "--port=0", COLUMNS="160")
    assert done.returncode == 2, "no port is 0"
    done = rayfarm("doctor", "--data", tmp_path / "data", "--json", COLUMNS="160")
    assert done.returncode == 1, done.stdout
    found = {each["about"]: each for each in json.loads(done.stdout)}
    assert found["Secrets"]["level"] == "fault"
    assert found["Secrets"]["do"].startswith("chmod 600")
    assert found["Python"]["level"] == "fine"
    (tmp_path / "data" / "token").chmod(0o600)
    done = rayfarm("doctor", "--data", tmp_path / "data", "--port=1", COLUMNS="160")
    assert "fault" in done.stdout.splitlines()[-1]
    assert "-> " in done.stdout
