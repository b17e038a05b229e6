"""Tests of precompiled kernels in a read-only folder of a container image."""

from __future__ import annotations

import logging
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from renderer import jit, precompile, render
from renderer.shipped_kernels import FOLDER, copy_finished_kernels, copy_shipped_kernels


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Returns a folder with shipped kernels of the source digest `abc`, laid out as by renderer.precompile."""
    folder = tmp_path / "shipped" / "abc"
    (folder / "kernel.x").mkdir(parents=True)
    (folder / "kernel.x" / "a.code").write_bytes(b"code")
    (folder / "kernel.x" / "part.code").write_bytes(b"a part, which no list names")
    (folder / "plain.done").write_text("kernel.x/a.code\n")
    monkeypatch.setenv(FOLDER, str(folder.parent))
    return folder


def test_listed_files_are_copied_once(shipped: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache" / "abc"
    copy_shipped_kernels(cache)
    copied = sorted(path.relative_to(cache).as_posix() for path in cache.rglob("*") if path.is_file())
    assert copied == ["kernel.x/a.code", "plain.done"]
    assert (cache / "kernel.x" / "a.code").read_bytes() == b"code"
    assert {stat.S_IMODE(path.stat().st_mode) for path in cache.rglob("*")} == {0o600, 0o700}
    assert copy_finished_kernels(shipped, cache) == 0


def test_kernels_of_other_sources_are_ignored(shipped: Path, tmp_path: Path) -> None:
    copy_shipped_kernels(tmp_path / "cache" / "def")
    assert not (tmp_path / "cache").exists()


def test_wheel_kernels_are_the_default(shipped: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(FOLDER)
    monkeypatch.setattr("renderer.shipped_kernels.IN_WHEEL", shipped.parent)
    copy_shipped_kernels(tmp_path / "cache" / "abc")
    assert (tmp_path / "cache" / "abc" / "plain.done").exists()


def test_shipped_kernel_is_used_instead_of_compiling(shipped: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A kernel that is shipped in the image is copied to the cache instead of compiled, also by `rayfarm render`."""
    taken: list[Path] = []

    def stop(cache: Path) -> None:
        taken.append(cache)
        raise InterruptedError

    monkeypatch.setattr(render, "copy_shipped_kernels", stop)
    monkeypatch.setattr(render.jit, "is_cached", lambda name: False)
    with pytest.raises(InterruptedError):
        render.warm_up()
    assert taken == [jit.cache_folder()]


def test_unknown_kernel_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        precompile.main(["--kernels", "plain,fast"])
    assert "there is no kernel fast; known are plain, full," in capsys.readouterr().err


def test_compilation_prints_its_progress(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    ran: list[tuple[str, ...]] = []
    monkeypatch.setattr(precompile, "_compile_in_process", lambda *job: ran.append(job))
    monkeypatch.setattr(precompile.jit, "is_cached", lambda name: False)
    monkeypatch.setattr(precompile, "copy_shipped_kernels", lambda cache: None)
    precompile.main(["--kernels", "plain,full"])
    assert sorted(ran) == [("full",), ("full", "--prepares"), ("plain",), ("plain", "--prepares"), ("preparing",)]
    first, *lines, last = capsys.readouterr().out.splitlines()
    assert first.startswith("compiling 3 kernels, ")
    assert [line.partition(" after")[0] for line in lines] == ["1 of 3", "2 of 3", "3 of 3"]
    assert "kernels ready after" in last


def test_number_of_parallel_jobs_by_cores_and_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(precompile, "cores", lambda: 8)
    for memory, count in ((64 << 30, 8), (3 * precompile.MEMORY, 3), (0, 1)):
        monkeypatch.setattr(precompile, "available_memory", lambda memory=memory: memory)
        assert precompile._max_parallel_jobs(20) == count
    assert precompile._max_parallel_jobs(1) == 1


def test_kernels_for_cards_are_built_on_request(monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[tuple[str, ...]] = []
    monkeypatch.setattr(precompile, "_compile_in_process", lambda *job: ran.append(job))
    monkeypatch.setattr(precompile.jit, "is_cached", lambda name: not name.startswith("cuda-"))
    monkeypatch.setattr(precompile, "copy_shipped_kernels", lambda cache: None)
    for cards, count in (("", 0), ("plain,full", 2), ("all", len(precompile.KERNEL_VARIANTS))):
        ran.clear()
        precompile.main(["--kernels", "plain", "--cards", cards])
        assert len({job for job in ran if job[0].startswith(precompile.FOR_CARD)}) == count
        assert ("plain", "--prepares") in ran


def test_files_writable_by_others_are_not_copied(shipped: Path, tmp_path: Path) -> None:
    (shipped / "kernel.x" / "a.code").chmod(0o666)
    copy_shipped_kernels(tmp_path / "cache" / "abc")
    assert not (tmp_path / "cache" / "abc" / "kernel.x" / "a.code").exists()


def test_unwritable_cache_is_a_warning(
    shipped: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refused(_: Path) -> None:
        raise OSError("Read-only file system")

    monkeypatch.setattr("renderer.shipped_kernels.make_private", refused)
    with caplog.at_level(logging.WARNING):
        copy_shipped_kernels(tmp_path / "cache" / "abc")
    assert "compiled: Read-only file system" in caplog.text


@pytest.mark.long
def test_compilation_with_read_only_sources(tmp_path: Path) -> None:
    """Compiling works with read-only source folders; Numba's own cache locator would try to write a file there, and fail."""
    program = (
        "import numpy as np\n"
        "from renderer.kernel.mesh.vertices import place_points\n"
        "placed = np.zeros((2, 3), np.float32)\n"
        "place_points(np.ones((2, 3), np.float32), np.eye(3, 4, dtype=np.float32), 0, 2, placed)\n"
        "assert placed.tolist() == [[1, 1, 1], [1, 1, 1]], placed\n"
    )
    (tmp_path / "cache").write_text("no folder")
    environment = {**os.environ, "RAYFARM_CACHE": str(tmp_path / "cache")}
    subprocess.run([sys.executable, "-c", program], env=environment, check=True)
