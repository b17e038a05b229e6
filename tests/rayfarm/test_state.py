"""Tests that only one farm at a time uses a data folder, and that the folder's secrets are private."""

import json
import os
import stat
from pathlib import Path

import pytest

from rayfarm.errors import CommandError
from rayfarm.local.state import FarmAddress, locked_folder, running_farm, secrets_of, write_address


def test_secrets_are_persistent_and_private(tmp_path: Path) -> None:
    first = secrets_of(tmp_path)
    assert secrets_of(tmp_path) == first
    assert stat.S_IMODE((tmp_path / "secrets.json").stat().st_mode) == 0o600
    assert len(first.token) >= 20


def test_second_farm_on_folder_is_rejected(tmp_path: Path) -> None:
    with locked_folder(tmp_path):
        write_address(tmp_path, FarmAddress("http://127.0.0.1:8123", "token", "redis://", os.getpid(), {}))
        with pytest.raises(CommandError, match=r"already runs on .* at http://127\.0\.0\.1:8123"), locked_folder(tmp_path):
            pass
    with locked_folder(tmp_path):
        assert running_farm(tmp_path) is None


def test_killed_farm_does_not_count_as_running(tmp_path: Path) -> None:
    gone = FarmAddress("http://127.0.0.1:1", "token", "redis://", 2**22 + 1, {})
    write_address(tmp_path, gone)
    assert json.loads((tmp_path / "farm.json").read_text())["pid"] == gone.pid
    assert running_farm(tmp_path) is None


def test_unusable_folder_gives_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(CommandError, match="Choose another with --data"), locked_folder(tmp_path / "file" / "data"):
        pass
