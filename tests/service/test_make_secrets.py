"""Tests of generating the secrets of a farm in containers."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from service import make_secrets
from service.make_secrets import SECRETS


@pytest.fixture(autouse=True)
def _nothing_given(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in SECRETS.values():
        monkeypatch.delenv(variable, raising=False)


def made(folder: Path) -> dict[str, str]:
    make_secrets.make_secrets(folder)
    return {name: (folder / name).read_text().strip() for name in SECRETS}


def test_secrets_are_random_and_created_once(tmp_path: Path) -> None:
    first = made(tmp_path)
    assert len(set(first.values())) == len(SECRETS)
    assert all(len(value) == 64 for value in first.values())
    assert {stat.S_IMODE((tmp_path / name).stat().st_mode) for name in SECRETS} == {0o600}
    assert made(tmp_path) == first


def test_given_secrets_are_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = made(tmp_path)
    monkeypatch.setenv("RAYFARM_TOKEN", "one of our own")
    assert made(tmp_path) == {**before, "token": "one of our own"}
    monkeypatch.setenv("RAYFARM_TOKEN", "")
    assert made(tmp_path)["token"] == "one of our own"


def test_empty_secret_file_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "token").touch()
    assert made(tmp_path)["token"]


def test_unwritable_folder_gives_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["make_secrets", str(tmp_path / "none")])
    assert make_secrets.main() == 1
    assert str(tmp_path / "none") in capsys.readouterr().err
