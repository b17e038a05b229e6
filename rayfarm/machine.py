"""Machine-dependent functions for commands that run processes: cores, signals, the screen."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

from renderer.threads import cores

__all__ = ["StopSignals", "cores", "has_screen"]


def has_screen() -> bool:
    """Returns True if a graphical browser can be shown. Otherwise Linux would open a text browser in the terminal."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


class StopSignals:
    """Counts Ctrl-C, SIGTERM and SIGHUP: the first requests a stop, the second an immediate one."""

    def __init__(self) -> None:
        self.count = 0
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._on_signal)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self.count += 1

    def stop(self) -> bool:
        """Returns True if a stop was requested."""
        return self.count >= 1

    def is_immediate(self) -> bool:
        """Returns True if an immediate stop was requested."""
        return self.count >= 2
