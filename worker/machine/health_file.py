"""A file that says how this worker is, for the health check of its container: worker/healthy.py reads it.

$RAYFARM_ALIVE names it. It holds the worker's pid and its state, and its age says when the event loop last came by.
"""

from __future__ import annotations

import contextlib
import os
from enum import StrEnum
from pathlib import Path

__all__ = ["ALIVE", "State", "say"]

ALIVE = "RAYFARM_ALIVE"


class State(StrEnum):
    """What a worker does."""

    STARTING = "starting"  # loads its kernels, waits for the service
    WORKING = "working"  # its event loop runs, and says so every second
    AWAY = "away"  # waits for Redis, or ends


def say(state: State, pid: int | None = None) -> None:
    """Write the state, where a file is named. What cannot be written is left: the check then fails, and says why."""
    if not (named := os.environ.get(ALIVE, "")):
        return
    path, text = Path(named), f"{os.getpid() if pid is None else pid} {state}\n"
    with contextlib.suppress(OSError):
        if path.exists() and path.read_text() == text:
            os.utime(path)
        else:
            beside = path.with_name(f"{path.name}.part")
            beside.write_text(text)
            beside.replace(path)
