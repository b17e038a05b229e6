"""Tests of atomic file writes."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from service.settings import Settings
from service.store.atomic_files import rename_synced, write_atomically, write_if_missing


def test_file_is_synced_before_rename(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    temporary, target = tmp_path / "temporary", tmp_path / "target"
    temporary.write_bytes(b"content")
    synced = []
    fsync = os.fsync

    def see(handle: int) -> None:
        path = Path(f"/proc/self/fd/{handle}").readlink() if Path("/proc/self/fd").is_dir() else None
        synced.append((path, target.exists()))
        fsync(handle)

    monkeypatch.setattr(os, "fsync", see)
    rename_synced(temporary, target)
    assert synced in ([(temporary, False), (tmp_path, True)], [(None, False), (None, True)])
    assert target.read_bytes() == b"content"


def test_failed_write_keeps_old_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file"
    write_atomically(path, b"old")

    def full(handle: int) -> None:
        raise OSError("no room")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="no room"):
        write_atomically(path, b"new")
    assert path.read_bytes() == b"old"
    assert [each.name for each in tmp_path.iterdir()] == ["file"]
    assert path.stat().st_mode & 0o777 == 0o600


def test_existing_file_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "file"
    for content in (b"first", b"second"):
        write_if_missing(path, content)
    assert path.read_bytes() == b"first"
    assert [each.name for each in tmp_path.iterdir()] == ["file"]
    assert path.stat().st_mode & 0o777 == 0o600


def test_concurrent_services_read_same_id(tmp_path: Path) -> None:
    """Services started at once on a new folder read the same id; otherwise a standby would take the folder for another farm's."""
    for number in range(10):
        settings = [
            Settings(data=tmp_path / str(number), redis_url="redis://nowhere", token="t", owner_token="o") for _ in "12345678"
        ]
        settings[0].make_folders()
        ready, ids = threading.Barrier(len(settings)), []

        def begin(each: Settings, ready: threading.Barrier = ready, ids: list[str] = ids) -> None:
            ready.wait()
            ids.append(each.instance_id())

        threads = [threading.Thread(target=begin, args=(each,)) for each in settings]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(ids) == len(settings)
        assert len(set(ids)) == 1
