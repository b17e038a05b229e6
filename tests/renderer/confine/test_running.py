"""Tests of confined reader processes: what they can access, and how each way in which they can end is reported."""

from __future__ import annotations

import ast
import errno
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from renderer.confine import rules, running
from renderer.confine.reader import error_message
from renderer.confine.running import Bounds, run
from renderer.errors import MachineError, SceneError
from renderer.scene.load import Shot
from renderer.scene.readers import by_format
from tests.helpers import ROOT
from tests.renderer.confine import jobs

BOUNDS = Bounds(512 << 20, 60.0, "truck.glb")


@pytest.mark.skipif(sys.platform != "linux", reason="Landlock and seccomp are Linux's")
def test_reader_cannot_access_its_caller(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RAYFARM_TOKEN", "secret")
    said: list[dict[str, Any]] = []
    found = run(jobs.probe, [], [tmp_path], BOUNDS, said.append)
    assert said == [{"step": "probing"}]
    assert "secret" not in str(found["environment"])
    assert not [
        each
        for each in found["environment"]
        if each not in ALLOWED and not each.startswith("NUMBA_") and "_NUM_THREADS" not in each
    ]
    assert all(each.startswith(("/dev/null", "pipe:")) for each in found["descriptors"])
    assert found["status"] == {"NoNewPrivs": "1", "Seccomp": "2"}
    assert found["refused"] == dict.fromkeys(found["refused"], True)
    assert (tmp_path / "own").read_text() == "written"


ALLOWED = {
    *(
        "LANG",
        "RAYFARM_CACHE",
        "PYTHONDONTWRITEBYTECODE",
        "MALLOC_ARENA_MAX",
        "TMPDIR",
        "HOME",
        "TZ",
        "OpenImageIO_ROOT",
        "RAYFARM_AVX512",
    ),
    *("LD_LIBRARY_PATH", "NUMBA_THREADING_LAYER", "LC_CTYPE"),
}


@pytest.mark.parametrize(
    ("job", "kind", "sentence"),
    [
        (jobs.crash, SceneError, r"truck.glb cannot be read: its importer crashed \(signal 11"),
        (jobs.abort, SceneError, r"truck.glb cannot be read: its importer crashed \(signal 6"),
        (jobs.hungry, MachineError, "truck.glb needs more than the 0.5 GiB"),
        (jobs.wrong, SceneError, "the buffer ends early"),
    ],
)
def test_every_failure_is_an_error_message(tmp_path: Path, job: Any, kind: type[Exception], sentence: str) -> None:
    with pytest.raises(kind, match=sentence):
        run(job, [], [tmp_path], BOUNDS)


@pytest.mark.skipif(sys.platform != "linux", reason="address space is counted in /proc")
def test_crash_under_low_address_space_limit_is_a_machine_error(tmp_path: Path) -> None:
    """A crash under a low limit on address space is reported as a fault of the machine, not of the file.

    Importers seldom check for failed allocations.
    """

    def limited(job: str, limit: int) -> str:
        command = [sys.executable, "-m", "tests.renderer.confine.limited", job, str(limit), str(tmp_path)]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    (tmp_path / "a.cob").write_bytes(bytes(1 << 20))  # an importer may need 712 MiB for this file
    size = ast.literal_eval(limited("size", 0))["size"]
    for job, number in (("crash", 11), ("abort", 6)):
        sentence = limited(job, size + (300 << 20))
        assert sentence.startswith(f"MachineError a.cob cannot be read on this machine: its importer crashed (signal {number}, ")
        assert " MiB of memory, and may need 0.7 GiB. Raise its limit on address space (ulimit -v) of " in sentence
    assert limited("crash", size + (4 << 30)).startswith("SceneError a.cob cannot be read: its importer crashed (signal 11")


def test_hanging_reader_is_killed(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"truck.glb took longer than 1 seconds"):
        run(jobs.slow, [], [tmp_path], Bounds(512 << 20, 1.0, "truck.glb"))


@pytest.mark.parametrize("what", [OSError(errno.EMFILE, "Too many open files", "t.png"), RuntimeError("can't start new thread")])
def test_machine_errors_are_not_reported_as_damaged_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: Exception
) -> None:
    """An error caused by missing resources of the machine is not reported as a damaged file.

    A parser that lacks memory, for example, may raise nearly any exception, which otherwise counts as damage.
    """

    def lacking(*_: Any, **__: Any) -> None:
        raise what

    (tmp_path / "a.ply").write_bytes(b"ply\n")
    monkeypatch.setattr(by_format, "import_module", lambda name: SimpleNamespace(read=lacking))
    with pytest.raises(type(what)) as raised:
        Shot(tmp_path, "a.ply").scene_at()
    assert "machine" in error_message(raised.value)


def test_confinement_is_described(monkeypatch: pytest.MonkeyPatch) -> None:
    has, lacks = rules.available_features()
    sentence, is_whole = running.confinement()
    assert sorted(name.split()[0] for name in [*has, *lacks]) == ["Landlock", "seccomp"]
    assert is_whole == (lacks == [])
    assert all(name in sentence for name in [*has, *lacks])
    monkeypatch.setattr(rules, "_libc", None)
    sentence, is_whole = running.confinement()
    assert sentence == (
        "files are read in processes of their own, confined by limits and an empty environment; "
        "this system lacks Landlock and seccomp"
    )
    assert not is_whole


@pytest.mark.skipif(sys.platform != "linux", reason="Linux")
def test_available_features_take_effect() -> None:
    """The restrictions that this machine is found to support take effect in a process.

    They are tested in a separate process, since a process cannot undo its restrictions.
    """
    has, _ = rules.available_features()
    program = "from renderer.confine import rules; print(rules.restrict_files([('/', rules.READ)]), rules.filter_calls())"
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    names = [name.split()[0] for name in has]
    assert done.stdout.split() == [str("Landlock" in names), str("seccomp" in names)]
