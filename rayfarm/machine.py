"""What the commands that keep processes running need to know of this machine."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

from renderer.threads import cores

__all__ = ["StopSignals", "cores", "has_screen"]


def has_screen() -> bool:
    """Whether a browser could be shown; without this, Linux would open one that draws into the terminal."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


class StopSignals:
    """Ctrl-C, SIGTERM and SIGHUP, counted: the first asks to stop, the second to stop at once."""

    def __init__(self) -> None:
        self.count = 0
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._take)

    def _take(self, number: int, frame: FrameType | None) -> None:
        self.count += 1

    def stop(self) -> bool:
        """Whether to stop."""
        return self.count >= 1

    def hurry(self) -> bool:
        """Whether to stop at once."""
        return self.count >= 2
