"""Supervises processes: starts, watches, restarts and stops them. Pauses before restarts increase after repeated failures.

Every part is the leader of its own session. A Ctrl-C at the terminal therefore reaches only the supervisor, which decides the
order of stopping, and all processes that a part forks can be ended as one group. If the supervisor itself is killed, the kernel
ends the parts (worker.process.die_with_parent). Everything runs in one thread: Linux ties that guarantee to the forking thread.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from renderer.child_processes import signal_name, spawn_guard, start_line

__all__ = ["WORKER_STEADY_S", "Part", "Supervisor"]

LOG_KEPT = 5 << 20  # bytes of a log, and of its predecessor
LOGS_EVERY_S = 0.25  # seconds between checks of log sizes
WORKER_STEADY_S = 90.0  # seconds; includes compiling kernels
PAUSES_S = (0.2, 1.0, 2.0, 5.0, 10.0, 30.0)
KILLED_PAUSE_S = 1.0  # maximum after a kill from outside, which says nothing about the part's health
SERVED_PAUSE_S = 0.2  # after a part that has served
LOOK_EVERY_S = 0.05  # seconds between checks whether a new part serves
IDLE_CHECK_EVERY_S = 0.5  # seconds between checks whether the other parts are ready
SPARE_AFTER_S = 10.0  # seconds of serving before the first spare, since a starting farm and its first picture need the CPU
SPARE_LATEST_S = 30.0  # seconds of serving after which a spare starts even if other parts are busy: it takes two seconds of CPU
SPARE_PAUSE_S = 3.0  # seconds between starts of spares
SPARE_AFTER_RESTART_S = 0.3  # seconds of serving after a restart, as the same fault may strike again
KILL_SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


@dataclass
class Part:
    """A process that the supervisor starts, watches and restarts, such as the service or the worker.

    grace_s: seconds to stop gracefully before it is killed. fatal_codes: exit codes after which it is not restarted. arguments:
    options for a process that imports first and then reads them from standard input
    (renderer.child_processes.wait_for_start_line); None for other processes. spare: a replacement process that has imported and
    waits for its options. has_spare: whether there should always be one.

    serves: returns whether the part is in service; called until it returns True. If a part ends before that, the pause before
    its next restart increases. Without `serves`, the pause increases if the part ends within steady_s seconds of its start.
    """

    name: str
    command: list[str]
    log: Path
    env: dict[str, str] = field(default_factory=dict)
    grace_s: float = 5.0
    fatal_codes: tuple[int, ...] = ()
    steady_s: float = 5.0
    serves: Callable[[], bool] | None = None
    process: subprocess.Popen[bytes] | None = None
    failures: int = 0
    start_failures: int = 0  # since its process was last started
    started: float = 0.0
    restart_at: float | None = None
    has_served: bool = False
    looked: float = 0.0
    ends: int = 0  # unexpected ones
    arguments: list[str] | None = None
    has_spare: bool = False
    at_peace: Callable[[], bool] | None = None
    spare: subprocess.Popen[bytes] | None = None
    spare_started: float = 0.0

    @property
    def running(self) -> bool:
        """Returns True if the process is alive."""
        return self.process is not None and self.process.poll() is None

    def last_log_lines(self, lines: int = 12) -> str:
        """Returns the last lines of the process's log."""
        try:
            with self.log.open("rb") as file:
                file.seek(max(self.log.stat().st_size - 8192, 0))
                text = file.read().decode(errors="replace")
        except OSError:
            return ""
        return "\n".join(text.splitlines()[-lines:])


class Supervisor:
    """Runs and restarts parts. say: called with a sentence about every notable event."""

    def __init__(self, folder: Path, say: Callable[[str], None]) -> None:
        self.folder = folder
        self.say = say
        self.parts: list[Part] = []
        self._looked_at_logs = 0.0

    def start(self, part: Part) -> None:
        """Starts a part and supervises it from then on. Raises OSError if its program cannot be started."""
        if part not in self.parts:
            self.parts.append(part)
        spare, part.spare = part.spare, None
        if spare is not None and spare.poll() is not None:
            spare.communicate()  # closes its input
            spare = None
        part.process = spare or self._spawn(part)
        part.start_failures = 0
        if part.arguments is not None:
            _release_spare(part, part.process, part.arguments)
        part.started = time.monotonic()
        part.restart_at = None
        part.has_served = False

    def _spawn(self, part: Part) -> subprocess.Popen[bytes]:
        with _log_of(part) as log:
            return subprocess.Popen(
                part.command,
                cwd=self.folder,
                env={**os.environ, **part.env},
                stdin=subprocess.DEVNULL if part.arguments is None else subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=spawn_guard(),
            )

    def _keep_spare(self, part: Part, now: float) -> None:
        """Starts a spare process if the part has none and has been in service for a while."""
        is_there = part.spare is not None and part.spare.poll() is None
        pause = SPARE_AFTER_RESTART_S if part.ends else SPARE_AFTER_S
        is_time = now - part.started > pause and (not part.spare_started or now - part.spare_started > SPARE_PAUSE_S)
        if part.has_spare and part.has_served and not is_there and is_time and self._is_idle(part, now):
            part.spare_started = now
            with contextlib.suppress(OSError, subprocess.SubprocessError):  # tried again after SPARE_PAUSE_S
                part.spare = self._spawn(part)

    def _is_idle(self, part: Part, now: float) -> bool:
        if part.ends or part.spare_started or part.at_peace is None or now - part.started > SPARE_LATEST_S:
            return True
        if now - part.looked < IDLE_CHECK_EVERY_S:
            return False
        part.looked = now
        return part.at_peace()

    def check_parts(self) -> Part | None:
        """Checks all parts once, and restarts those that have ended.

        Returns a part that ended with a fatal exit code, or None.
        """
        now = time.monotonic()
        if now - self._looked_at_logs >= LOGS_EVERY_S:
            self._looked_at_logs = now
            for part in self.parts:
                _truncate_if_oversized(part.log)
        for part in self.parts:
            if part.running:
                if not part.has_served and part.serves and now - part.looked > LOOK_EVERY_S:
                    part.looked = now
                    part.has_served = part.serves()
                if part.has_served or now - part.started > part.steady_s:
                    part.failures = 0
                self._keep_spare(part, now)
            elif part.restart_at is None:
                code = part.process.returncode if part.process else None
                self._end_group(part)
                part.ends += 1
                if code in part.fatal_codes:
                    return part
                pause = self._restart_delay_s(part, code, now - part.started)
                part.restart_at = now + pause
                self.say(f"{part.name} ended ({_describe_exit(code)}); it starts again in {pause:g} s. Its log: {part.log}")
            elif now >= part.restart_at:
                self._start_again(part, now)
        return None

    def _start_again(self, part: Part, now: float) -> None:
        """Restarts a part that has ended. If memory, file descriptors or processes are exhausted, schedules another attempt."""
        try:
            self.start(part)
        except (OSError, subprocess.SubprocessError) as error:
            pause = PAUSES_S[min(part.start_failures + 1, len(PAUSES_S) - 1)]
            part.start_failures += 1
            part.restart_at = now + pause
            self.say(f"{part.name} cannot be started ({error}); the next try is in {pause:g} s.")

    def stop(self, hurry: Callable[[], bool] = lambda: False) -> None:
        """Stops all parts in the reverse order of their start; kills them once `hurry` returns true."""
        for part in reversed(self.parts):
            if part.spare is not None:
                part.spare.kill()
                part.spare.communicate()
            process = part.process
            if process is None:
                continue
            deadline = time.monotonic() + part.grace_s
            with contextlib.suppress(ProcessLookupError):
                process.terminate()
            while process.poll() is None and time.monotonic() < deadline and not hurry():
                time.sleep(0.02)
            self._end_group(part)
        self.parts.clear()

    def _restart_delay_s(self, part: Part, code: int | None, lived_s: float) -> float:
        """Returns the time to wait before restarting a part that has ended, in seconds. lived_s: how long it ran."""
        if part.has_served:
            return SERVED_PAUSE_S
        if lived_s > part.steady_s:
            part.failures = 0
        pause = PAUSES_S[min(part.failures, len(PAUSES_S) - 1)]
        part.failures += 1
        was_killed = code is not None and -code in KILL_SIGNALS
        return min(pause, KILLED_PAUSE_S) if was_killed else pause

    def _end_group(self, part: Part) -> None:
        """Kills the remaining processes in a part's process group."""
        if part.process is None:
            return
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(part.process.pid, signal.SIGKILL)
        part.process.wait()


def _release_spare(part: Part, process: subprocess.Popen[bytes], arguments: list[str]) -> None:
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError):  # it died just now, which the next check detects
        process.stdin.write(start_line(arguments, {**os.environ, **part.env}, part.log))
        process.stdin.close()


def _truncate_if_oversized(log: Path) -> None:
    """Moves the end of an oversized log to `*.old.log`, and truncates the log in place.

    Processes that have opened it for appending, including those of an earlier supervisor, continue at its new end. Lines written
    between the two steps are lost, and on a full disk those of `*.old.log`.
    """
    try:
        size = log.stat().st_size
        if size <= LOG_KEPT:
            return
        old = log.with_suffix(".old.log")
        try:
            with log.open("rb") as file, old.open("wb") as kept:
                file.seek(size - LOG_KEPT)
                kept.write(file.read(LOG_KEPT))
        except OSError:
            with contextlib.suppress(OSError):
                old.unlink(missing_ok=True)
        os.truncate(log, 0)
    except OSError:
        return  # missing, or the disk fails; checked again later


def _log_of(part: Part) -> IO[bytes]:
    """Opens the log that a part appends to; the null device if no log can be opened, as on a full disk."""
    try:
        part.log.parent.mkdir(parents=True, exist_ok=True)
        _truncate_if_oversized(part.log)
        return part.log.open("ab")
    except OSError:
        return Path(os.devnull).open("ab")


def _describe_exit(code: int | None) -> str:
    if code is not None and code < 0:
        return f"by {signal_name(-code)}"
    return f"exit code {code}"
