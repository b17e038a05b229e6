"""Detects whether a user is at this machine.

Sources: processor time of other programs, input in terminals, the desktop's reports to logind (Wayland and X11), and the X11
screen if `xprintidle` is installed and the worker runs in that session. Not detected: a user who only reads, unless the desktop
reports it, and a program that waits.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from pathlib import Path

from worker.machine.process_tree import process_times

__all__ = ["Presence"]

BUSY_CORES = 0.5  # use by other programs above which a user counts as present
CHECK_EVERY_S = 5.0
SCREEN_TIMEOUT_S = 2.0
TICK = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100


class Presence:
    """Checks every few seconds for a user. `idle_s` returns the seconds since one was detected."""

    def __init__(self, proc: Path = Path("/proc"), dev: Path = Path("/dev")) -> None:
        self._proc, self._dev = proc, dev
        self._times: tuple[float, float, float] | None = None  # when, and processor seconds of all and of this worker
        self._present = time.time()  # time of the latest detection; initially the start
        self._looked = 0.0
        self.by: tuple[str, ...] = ()

    def idle_s(self, now: float | None = None) -> float:
        """Returns the seconds since a user was last detected."""
        now = time.time() if now is None else now
        if now - self._looked >= CHECK_EVERY_S:
            self._looked = now
            self._check(now)
        return max(now - self._present, 0.0)

    def _check(self, now: float) -> None:
        seen = []
        if (others := self._cores_used_by_others(now)) is not None:
            seen.append("load")
            if others > BUSY_CORES:
                self._present = now
        if (typed := self._last_terminal_input()) is not None:
            seen.append("terminals")
            self._present = max(self._present, min(typed, now))
        if (desktop := _desktop_idle_s(now)) is not None:
            seen.append("desktop")
            self._present = max(self._present, now - desktop)
        if (screen := _screen_idle_s()) is not None:
            seen.append("screen")
            self._present = max(self._present, now - screen)
        self.by = tuple(seen)

    def _cores_used_by_others(self, now: float) -> float | None:
        """Returns the mean number of cores that programs other than this worker used since the last check; None if unknown."""
        try:
            name, *ticks = (self._proc / "stat").read_text().split("\n", 1)[0].split()
            user, low, system, _, _, irq, soft = map(int, ticks[:7])
            every = (user + low + system + irq + soft) / TICK
            own = sum(process_times(self._proc).values()) / TICK
        except (OSError, ValueError):
            return None
        before, self._times = self._times, (now, every, own)
        if name != "cpu" or before is None or now - before[0] < 1.0:
            return None
        return max(every - before[1] - (own - before[2]), 0.0) / (now - before[0])

    def _last_terminal_input(self) -> float | None:
        """Returns the Unix time of the last input in any terminal; None if there are no terminals."""
        times = []
        for folder, pattern in ((self._dev / "pts", "[0-9]*"), (self._dev, "tty[1-9]*")):
            for path in folder.glob(pattern):
                try:
                    times.append(path.stat().st_atime)
                except OSError:
                    continue
        return max(times, default=None)


def _desktop_idle_s(now: float) -> float | None:
    """Returns for how many seconds the graphical sessions are idle, by logind's IdleHint; None if no desktop reports it.

    A desktop sets the hint some minutes after the last input, and clears it at the next. A desktop that has never set it in its
    session may not support it, and is treated as unknown.
    """
    program = shutil.which("loginctl")
    if program is None:
        return None
    idle: list[float] = []
    for session in _output_of([program, "list-sessions", "--no-legend"]).splitlines():
        if not session.split():
            continue
        asked = [option for name in ("Type", "Class", "State", "IdleHint", "IdleSinceHint") for option in ("-p", name)]
        lines = _output_of([program, "show-session", session.split()[0], *asked]).splitlines()
        properties = dict(line.partition("=")[::2] for line in lines)
        if (
            properties.get("Type") not in ("wayland", "x11", "mir")
            or properties.get("Class", "user") != "user"
            or properties.get("State") == "closing"
        ):
            continue
        since = properties.get("IdleSinceHint", "")
        if since.isdigit() and int(since) > 0:
            idle.append(max(now - int(since) / 1e6, 0.0) if properties.get("IdleHint") == "yes" else 0.0)
    return min(idle, default=None)


def _output_of(command: list[str]) -> str:
    """Returns the output of a command; empty if it fails or takes too long."""
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=SCREEN_TIMEOUT_S, check=True).stdout
    except (OSError, UnicodeError, subprocess.SubprocessError):
        return ""


def _screen_idle_s() -> float | None:
    """Returns for how many seconds keyboard and mouse of this X session are idle; None if xprintidle cannot be used."""
    program = shutil.which("xprintidle")
    if program is None or not os.environ.get("DISPLAY"):
        return None
    try:
        said = subprocess.run([program], capture_output=True, text=True, timeout=SCREEN_TIMEOUT_S, check=True).stdout
        return int(said) / 1000
    except (OSError, ValueError, subprocess.SubprocessError):
        return None
