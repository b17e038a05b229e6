"""Health file of a worker, read by the health check of its container (worker/healthy.py).

$RAYFARM_ALIVE is its path. It contains the worker's pid and state. The worker's event loop rewrites it regularly, so an old
file means that the loop hangs.
"""

from __future__ import annotations

import contextlib
import os
from enum import StrEnum
from pathlib import Path

__all__ = ["HEALTH_FILE_VARIABLE", "WorkerState", "write_state"]

HEALTH_FILE_VARIABLE = "RAYFARM_ALIVE"


class WorkerState(StrEnum):
    """State of a worker as written to the health file."""

    STARTING = "starting"  # loads its kernels, waits for the service
    WORKING = "working"  # the event loop runs, and updates the file every second
    AWAY = "away"  # waits for Redis, or ends


def write_state(state: WorkerState, pid: int | None = None) -> None:
    """Writes the state if a health file is configured. Ignores errors: the health check then fails and reports them."""
    if not (named := os.environ.get(HEALTH_FILE_VARIABLE, "")):
        return
    path, text = Path(named), f"{os.getpid() if pid is None else pid} {state}\n"
    with contextlib.suppress(OSError):
        if path.exists() and path.read_text() == text:
            os.utime(path)
        else:
            beside = path.with_name(f"{path.name}.part")
            beside.write_text(text)
            beside.replace(path)
