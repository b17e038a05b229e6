"""Tests that the supervisor restarts the processes ("parts") of a farm, stops them in order, and leaves none behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from rayfarm.local import supervisor as supervision
from rayfarm.local.supervisor import Part, Supervisor
from tests.helpers import ROOT, wait_until

SLEEPER = [sys.executable, "-c", "import time; print('begun', flush=True); time.sleep(100)"]
FAMILY = [
    sys.executable,
    "-c",
    "import signal, subprocess, sys, time; signal.signal(signal.SIGTERM, signal.SIG_IGN);"
    "p = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(100)']); print(p.pid, flush=True); time.sleep(100)",
]


@pytest.fixture
def reports() -> list[str]:
    return []


@pytest.fixture
def supervisor(reports: list[str]):
    made = Supervisor(ROOT, reports.append)
    yield made
    made.stop(lambda: True)


NAMELESS = pytest.param(40, "signal 40", marks=pytest.mark.skipif(sys.platform != "linux", reason="a number of Linux"))


@pytest.mark.parametrize(("number", "name"), [(signal.SIGKILL, "SIGKILL"), NAMELESS])
def test_dead_part_is_restarted_and_reported(
    supervisor: Supervisor, reports: list[str], tmp_path: Path, number: int, name: str
) -> None:
    part = Part("sleeper", SLEEPER, tmp_path / "log")
    supervisor.start(part)
    first = part.process
    assert first is not None
    first.send_signal(number)
    first.wait()
    wait_until(lambda: supervisor.check_parts() is None and part.running, 5, "the part runs again")
    assert part.process is not None
    assert part.process.pid != first.pid
    assert len(reports) == 1
    assert f"sleeper ended (by {name})" in reports[0]


@pytest.mark.long
def test_repeatedly_failing_part_is_restarted_with_growing_delay(
    supervisor: Supervisor, reports: list[str], tmp_path: Path
) -> None:
    part = Part("broken", [sys.executable, "-c", "raise SystemExit(7)"], tmp_path / "log")
    supervisor.start(part)
    deadline = time.monotonic() + 2.5
    while time.monotonic() < deadline:
        supervisor.check_parts()
        time.sleep(0.02)
    assert 2 <= len(reports) <= 4
    assert "exit code 7" in reports[0]


@pytest.mark.long
def test_repeatedly_killed_part_is_restarted_quickly(supervisor: Supervisor, tmp_path: Path) -> None:
    part = Part("sleeper", SLEEPER, tmp_path / "log")
    supervisor.start(part)
    for _ in range(6):
        assert part.process is not None
        part.process.kill()
        part.process.wait()
        supervisor.check_parts()
        assert part.restart_at is not None
        assert part.restart_at - time.monotonic() <= 1.0
        part.restart_at = 0.0  # ends the pause
        supervisor.check_parts()
        assert part.running


@pytest.mark.parametrize(
    ("steady_s", "runs"),
    [
        (None, ((1.0, "0.2"), (1.0, "1"), (1.0, "2"), (60.0, "0.2"), (1.0, "1"))),
        (90.0, ((30.0, "0.2"), (30.0, "1"), (30.0, "2"), (120.0, "0.2"))),  # a worker that fails while it compiles kernels
    ],
)
def test_only_early_failures_increase_delay(
    supervisor: Supervisor, reports: list[str], tmp_path: Path, steady_s: float | None, runs: tuple[tuple[float, str], ...]
) -> None:
    """A process that fails before it has run for `steady_s` is restarted after an increasing delay, later ones after 0.2 s."""
    command = [sys.executable, "-c", "import time; time.sleep(100)"]
    part = Part("tired", command, tmp_path / "log", **({} if steady_s is None else {"steady_s": steady_s}))
    supervisor.start(part)
    for lived, pause in runs:
        part.started -= lived
        supervisor.check_parts()  # notices that it runs
        assert part.process is not None
        part.process.send_signal(signal.SIGSEGV)
        part.process.wait()
        supervisor.check_parts()
        assert f"again in {pause} s" in reports[-1]
        part.restart_at = 0.0
        supervisor.check_parts()


def test_part_that_served_is_restarted_at_once(supervisor: Supervisor, reports: list[str], tmp_path: Path) -> None:
    """A process that has served is restarted after 0.2 s, whatever signal ended it.

    For a process that has never served, the delay increases with each restart.
    """
    serves = [True]
    part = Part("server", SLEEPER, tmp_path / "log", steady_s=90.0, serves=lambda: serves[0])
    supervisor.start(part)
    for number, served, pause in (
        *((number, True, "0.2") for number in (signal.SIGSEGV, signal.SIGABRT, signal.SIGKILL, signal.SIGSEGV)),
        *((signal.SIGSEGV, False, pause) for pause in ("0.2", "1", "2")),
        (signal.SIGSEGV, True, "0.2"),
        (signal.SIGSEGV, False, "0.2"),
    ):
        serves[0] = served
        part.looked = 0.0
        supervisor.check_parts()  # notices that it runs
        assert part.process is not None
        part.process.send_signal(number)
        part.process.wait()
        supervisor.check_parts()
        assert f"again in {pause} s" in reports[-1], (number, served)
        part.restart_at = 0.0
        supervisor.check_parts()


WAITS = [
    sys.executable,
    "-c",
    "import sys; print(sys.stdin.readline(), flush=True); sys.stdin = None; import time; time.sleep(100)",
]


@pytest.mark.long
def test_spare_replaces_dead_part(supervisor: Supervisor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervision, "SPARE_AFTER_S", 0.0)
    monkeypatch.setattr(supervision, "IDLE_CHECK_EVERY_S", 0.0)
    others: list[str] = []
    part = Part(
        "server", WAITS, tmp_path / "log", serves=lambda: True, has_spare=True, arguments=[], at_peace=lambda: bool(others)
    )
    supervisor.start(part)
    wait_until(lambda: supervisor.check_parts() is None and part.has_served, 20, "it serves")
    for _ in range(3):
        supervisor.check_parts()
    assert part.spare is None, "others are starting"
    others.append("ready")
    wait_until(lambda: supervisor.check_parts() is None and part.spare is not None, 20, "one waits")
    first, waiting = part.process, part.spare
    assert first is not None
    assert waiting is not None
    wait_until(lambda: part.last_log_lines().count("arguments") == 1, 20, "the first has begun, and the other has not")
    first.kill()
    first.wait()
    wait_until(lambda: supervisor.check_parts() is None and part.running, 20, "there is a part again")
    assert part.process is waiting
    wait_until(lambda: part.last_log_lines().count("arguments") == 2, 20, "it begins")
    wait_until(lambda: supervisor.check_parts() is None and part.spare is not None, 20, "and another waits")
    assert part.spare is not None
    part.spare.kill()
    part.spare.communicate()
    wait_until(
        lambda: supervisor.check_parts() is None and part.spare is not None and part.spare.poll() is None, 20, "which is kept up"
    )
    pids = [part.process.pid, part.spare.pid]
    supervisor.stop()
    assert not any(map(_runs, pids))


def test_killed_part_gets_spare_once_it_serves(supervisor: Supervisor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process killed before it had a spare gets one as soon as it serves, even while other processes of the farm start.

    Otherwise it would have no spare if the same fault recurred while they start.
    """
    monkeypatch.setattr(supervision, "SPARE_AFTER_S", 1000.0)
    part = Part("server", WAITS, tmp_path / "log", serves=lambda: True, has_spare=True, arguments=[], at_peace=lambda: False)
    supervisor.start(part)
    wait_until(lambda: supervisor.check_parts() is None and part.has_served, 20, "it serves")
    assert part.spare is None, "others are starting"
    first = part.process
    assert first is not None
    first.kill()
    wait_until(lambda: supervisor.check_parts() is None and part.process is not first and part.spare is not None, 20, "one waits")


def test_fatal_exit_code_prevents_restart(supervisor: Supervisor, tmp_path: Path) -> None:
    part = Part("refused", [sys.executable, "-c", "raise SystemExit(3)"], tmp_path / "log", fatal_codes=(3,))
    supervisor.start(part)
    ended: list[Part | None] = []
    wait_until(lambda: ended.append(supervisor.check_parts()) or ended[-1] is part, 5, "the part is given up")


def test_stopping_ends_child_processes_of_part(supervisor: Supervisor, tmp_path: Path) -> None:
    part = Part("family", FAMILY, tmp_path / "log", grace_s=0.3)
    supervisor.start(part)
    wait_until(lambda: part.last_log_lines().strip().isdigit(), 5, "the grandchild runs")
    grandchild = int(part.last_log_lines())
    assert psutil.pid_exists(grandchild)
    supervisor.stop()
    wait_until(lambda: not _runs(grandchild), 5, "the grandchild has ended")


def test_immediate_stop_does_not_wait(supervisor: Supervisor, tmp_path: Path) -> None:
    part = Part("family", FAMILY, tmp_path / "log", grace_s=60)
    supervisor.start(part)
    wait_until(lambda: part.last_log_lines().strip().isdigit(), 5, "it runs")
    begun = time.monotonic()
    supervisor.stop(hurry=lambda: True)
    assert time.monotonic() - begun < 2


def test_parts_end_with_killed_supervisor(tmp_path: Path) -> None:
    program = f"""
import sys, time
from pathlib import Path
from rayfarm.local.supervisor import Part, Supervisor
s = Supervisor(Path("."), print)
part = Part("sleeper", {SLEEPER!r}, Path({str(tmp_path / "log")!r}))
s.start(part)
print(part.process.pid, flush=True)
time.sleep(100)
"""
    parent = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, cwd=ROOT)
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    os.kill(parent.pid, signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    wait_until(lambda: not _runs(child), 5, "the part has ended")


def _runs(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def test_resource_exhaustion_does_not_end_farm(
    supervisor: Supervisor, reports: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "logs").write_text("a file where the folder of logs should be")
    part = Part("sleeper", SLEEPER, tmp_path / "logs" / "sleeper.log")
    supervisor.start(part)
    assert part.process is not None
    first = part.process.pid
    real, failures = subprocess.Popen, iter([OSError(24, "Too many open files"), OSError(12, "Cannot allocate memory")])

    def popen(*arguments: object, **options: object) -> object:
        if (error := next(failures, None)) is not None:
            raise error
        return real(*arguments, **options)  # type: ignore[call-overload]

    part.process.kill()
    part.process.wait()
    monkeypatch.setattr(supervision.subprocess, "Popen", popen)
    wait_until(lambda: supervisor.check_parts() is None and part.running and part.process.pid != first, 30, "the part runs again")
    assert any("Too many open files" in sentence and "next try" in sentence for sentence in reports)


WRITER = [
    sys.executable,
    "-c",
    "import itertools, os\nfor i in itertools.count(): os.write(1, b'line %09d %s\\n' % (i, b'x' * 100))",
]


@pytest.mark.parametrize("is_full", [False, True])
def test_log_size_is_limited(supervisor: Supervisor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_full: bool) -> None:
    monkeypatch.setattr(supervision, "LOG_KEPT", 200_000)
    monkeypatch.setattr(supervision, "LOGS_EVERY_S", 0.0)
    part = Part("writer", WRITER, tmp_path / "writer.log")
    old = tmp_path / "writer.old.log"
    if is_full:
        old.symlink_to("/dev/full")
    supervisor.start(part)
    first = part.process
    with part.log.open("ab") as log:
        writer = subprocess.Popen(WRITER, stdout=log)  # started by an earlier supervisor
    emptied: list[int] = []

    def has_shrunk_often() -> bool:
        before = part.log.stat().st_size
        supervisor.check_parts()
        if part.log.stat().st_size < before:
            emptied.append(before)
        return len(emptied) >= 5

    try:
        wait_until(has_shrunk_often, 60, "the log is emptied again and again")
    finally:
        writer.kill()
        writer.wait()
    assert part.process is first and part.running
    if not is_full:
        assert old.stat().st_size == 200_000
        assert all(line.startswith("line ") for line in old.read_text().splitlines()[1:-1])
    part.log.write_bytes(b"")
    wait_until(lambda: part.log.stat().st_size > 0, 60, "the part goes on writing")
    assert part.log.read_bytes()[:5] != b"\0" * 5, "no hole at its begin"
