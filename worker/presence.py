"""Whether somebody works at this machine: by what its other programs take of the processors, by what was typed in its terminals,
and by the screen where `xprintidle` is installed and the worker runs in that session (X11 alone).

What is not seen: somebody who reads, on a machine without xprintidle or with Wayland, and a program that waits.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from pathlib import Path

from worker.family import family

__all__ = ["Presence"]

BUSY_CORES = 0.5  # of other programs: more is somebody at work
LOOK_EVERY_S = 5.0
SCREEN_PATIENCE_S = 2.0
TICK = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100


class Presence:
    """Looks about every few seconds; `idle_s` says since when nobody was there."""

    def __init__(self, proc: Path = Path("/proc"), dev: Path = Path("/dev")) -> None:
        self._proc, self._dev = proc, dev
        self._times: tuple[float, float, float] | None = None  # when, and processor seconds of all and of this worker
        self._present = time.time()  # when somebody was there last: at the begin nobody knows better
        self._looked = 0.0
        self.by: tuple[str, ...] = ()

    def idle_s(self, now: float | None = None) -> float:
        """For how long nobody has worked here, as far as that is known."""
        now = time.time() if now is None else now
        if now - self._looked >= LOOK_EVERY_S:
            self._looked = now
            self._look(now)
        return max(now - self._present, 0.0)

    def _look(self, now: float) -> None:
        seen = []
        if (others := self._others(now)) is not None:
            seen.append("load")
            if others > BUSY_CORES:
                self._present = now
        if (typed := self._typed()) is not None:
            seen.append("terminals")
            self._present = max(self._present, min(typed, now))
        if (screen := _screen()) is not None:
            seen.append("screen")
            self._present = max(self._present, now - screen)
        self.by = tuple(seen)

    def _others(self, now: float) -> float | None:
        """Cores that other programs took since the last look; None where that is not known."""
        try:
            name, *ticks = (self._proc / "stat").read_text().split("\n", 1)[0].split()
            user, low, system, _, _, irq, soft = map(int, ticks[:7])
            every = (user + low + system + irq + soft) / TICK
            own = sum(family(self._proc).values()) / TICK
        except (OSError, ValueError):
            return None
        before, self._times = self._times, (now, every, own)
        if name != "cpu" or before is None or now - before[0] < 1.0:
            return None
        return max(every - before[1] - (own - before[2]), 0.0) / (now - before[0])

    def _typed(self) -> float | None:
        """When something was last typed into a terminal; None where there are none."""
        times = []
        for folder, pattern in ((self._dev / "pts", "[0-9]*"), (self._dev, "tty[1-9]*")):
            for path in folder.glob(pattern):
                try:
                    times.append(path.stat().st_atime)
                except OSError:
                    continue
        return max(times, default=None)


def _screen() -> float | None:
    """For how long nobody has touched keyboard or mouse of this X session; None where that cannot be had."""
    program = shutil.which("xprintidle")
    if program is None or not os.environ.get("DISPLAY"):
        return None
    try:
        said = subprocess.run([program], capture_output=True, text=True, timeout=SCREEN_PATIENCE_S, check=True).stdout
        return int(said) / 1000
    except (OSError, ValueError, subprocess.SubprocessError):
        return None
