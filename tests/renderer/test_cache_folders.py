"""Tests of the checks on folders and files of code: owned by this user or root, and not writable by others."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import Any

import pytest

from renderer import cache_folders, jit
from renderer.cache_folders import make_private, private_folder, read_private, reason_to_distrust
from renderer.machine_code import _Files

KEY = ("int64",), "target", "hashes"


@pytest.fixture(autouse=True)
def anew(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Gives each test a cache of its own, with no warnings logged yet."""
    monkeypatch.setenv("RAYFARM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(cache_folders.tempfile, "tempdir", str(tmp_path))
    cache_folders._warn.cache_clear()


def owned_by(user: int, mode: int = 0o700) -> os.stat_result:
    return os.stat_result((stat.S_IFDIR | mode, 0, 0, 1, user, 0, 0, 0, 0, 0))


def test_foreign_or_writable_files_are_not_trusted() -> None:
    me = os.geteuid()
    for user, mode in ((me, 0o700), (me, 0o755), (0, 0o755), (0, 0o555)):
        assert reason_to_distrust(owned_by(user, mode)) == "", (user, mode)
    assert "belongs to user 4242" in reason_to_distrust(owned_by(4242))
    for mode in (0o775, 0o757, 0o777):
        assert f"{mode:04o}" in reason_to_distrust(owned_by(me, mode))


def test_cache_folders_are_private(tmp_path: Path) -> None:
    make_private(tmp_path / "a" / "b")
    assert [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("a", "a/b")] == [0o700, 0o700]


@pytest.mark.parametrize("open_to_others", ["", "kernels", "kernels/00"])
def test_writable_cache_folder_is_replaced_by_a_private_one(
    open_to_others: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    home = tmp_path / "cache"
    make_private(home / "kernels" / "00")
    assert private_folder("kernels/00") == home / "kernels/00"
    (home / open_to_others).chmod(0o777)
    chosen = private_folder("kernels/00")
    assert chosen == home / f"private-{os.geteuid()}" / "kernels/00"
    assert reason_to_distrust(chosen.parent.parent.stat()) == ""
    assert private_folder("kernels/00") == chosen
    (said,) = caplog.messages  # logged once
    assert str(home / open_to_others) in said
    assert "0777" in said


def test_private_folder_of_another_user_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home = tmp_path / "cache"
    for folder in (home, home / f"private-{os.geteuid()}"):
        folder.mkdir(parents=True, exist_ok=True)
        folder.chmod(0o777)
    assert private_folder("kernels") == tmp_path / f"rayfarm-private-{os.geteuid()}" / "kernels"
    (tmp_path / f"rayfarm-private-{os.geteuid()}").chmod(0o777)
    cache_folders._own_temporary.cache_clear()
    last = private_folder("kernels")
    assert last.parent.parent == tmp_path
    assert stat.S_IMODE(last.parent.stat().st_mode) == 0o700


def test_kernel_writable_by_others_is_recompiled(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = tmp_path / "module"
    files = _Files(folder, "function", "stamp")
    files.save(KEY, "code")
    (path,) = folder.iterdir()
    assert stat.S_IMODE(path.stat().st_mode) & 0o022 == 0
    assert files.load(KEY) == "code"
    path.chmod(0o666)
    assert files.load(KEY) is None
    path.chmod(0o600)
    folder.chmod(0o777)
    assert files.load(KEY) is None
    files.save(("other", *KEY[1:]), "code")  # no file is written where others could change it
    assert [*folder.iterdir()] == [path]
    assert [said.split(" ")[1] for said in caplog.messages] == ["file", "folder"]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file away")
def test_kernel_of_another_user_is_not_loaded(tmp_path: Path) -> None:
    files = _Files(tmp_path, "function", "stamp")
    files.save(KEY, "code")
    (path,) = tmp_path.glob("function*")
    os.chown(path, 4242, 4242)
    assert files.load(KEY) is None
    assert read_private(path) is None


def test_read_only_kernel_folder_is_used_without_writing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "kernels"
    files = _Files(folder / "module", "function", "stamp")
    files.save(KEY, "code")
    (folder / "here.done").touch()
    monkeypatch.setattr(jit, "cache_folder", lambda: folder)

    def refused(*_: object, **__: object) -> None:
        raise OSError(30, "Read-only file system")

    reads = Path.open

    def opened(path: Path, mode: str = "r", **more: Any) -> Any:
        return refused() if "w" in mode else reads(path, mode, **more)

    monkeypatch.setattr(Path, "open", opened)
    for name in ("mkdir", "touch", "write_bytes", "write_text", "unlink"):
        monkeypatch.setattr(Path, name, refused)
    with jit.compiling("here") as is_cold:
        assert not is_cold
        assert files.load(KEY) == "code"
    with jit.compiling("absent") as is_cold:
        assert is_cold
        files.save(("other", *KEY[1:]), "code")
    assert not jit.is_cached("absent")
