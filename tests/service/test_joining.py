"""Tests of the commands with which workers join a farm."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from service.joining import START_VARIABLE, URL_VARIABLE, joining
from service.locations import data_folder_without_variable
from service.settings import Settings


@pytest.fixture(autouse=True)
def _program(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (START_VARIABLE, URL_VARIABLE, "RAYFARM_PUBLISHED", "RAYFARM_PUBLIC_URL"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("RAYFARM_PROGRAM", "python3 farm.py")


def test_loopback_farm_is_started_again_for_other_machines(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(START_VARIABLE, "python3 farm.py up --port 9000 --host 0.0.0.0")
    found = joining(Settings.read(data=tmp_path / "a b", port=9000))
    assert (found.url, found.start) == (None, "python3 farm.py up --port 9000 --host 0.0.0.0")
    token = f"RAYFARM_DATA='{tmp_path}/a b' python3 farm.py token make NAME --role worker --days 0"
    assert found.token == f"{token} > NAME.token"
    assert found.here == (
        f"RAYFARM_TOKEN=$({token.replace('NAME', 'local')}) python3 farm.py worker --join http://127.0.0.1:9000"
    )


def test_commands_are_quoted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(URL_VARIABLE, "http://[fd00::1]:8000")
    folder = tmp_path / "my NAME $(id)"
    words = shlex.split(joining(Settings.read(data=folder, host="::")).here)
    assert words[-3:] == ["worker", "--join", "http://[fd00::1]:8000"]
    assert joining(Settings.read(data=folder)).here.startswith(
        f"RAYFARM_TOKEN=$(RAYFARM_DATA='{folder}' python3 farm.py token make local "
    )


def test_commands_for_the_default_folder_do_not_name_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(URL_VARIABLE, "https://farm.example:8443")
    found = joining(Settings.read(data=data_folder_without_variable(), host="0.0.0.0", port=8443))
    assert (found.url, found.start) == ("https://farm.example:8443", None)
    assert found.token == "python3 farm.py token make NAME --role worker --days 0 > NAME.token"


def test_containers_on_loopback_are_published() -> None:
    found = joining(Settings.read(host="0.0.0.0", published="127.0.0.1", published_port=9000))
    assert (found.url, found.start) == (None, "RAYFARM_PORT=9000 RAYFARM_BIND=0.0.0.0 docker compose up -d")
    assert found.token.startswith("docker compose exec service rayfarm token make NAME")


def test_published_containers_are_joined_by_their_name() -> None:
    found = joining(Settings.read(host="0.0.0.0", published="farm.example 0.0.0.0 127.0.0.1"))
    assert (found.url, found.start) == ("https://farm.example", None)
