"""Restores the priority of threads that an encoder made real-time.

SVT-AV1 running as root gives the highest real-time priority to its own threads and to the thread that opened it, which children
inherit. Such threads keep every other program off their core while they work.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

__all__ = ["restored_priorities"]


@contextlib.contextmanager
def restored_priorities() -> Iterator[Callable[[], None]]:
    """Yields a function to be called after each step that may have raised priorities; it is called once more at the end."""
    if sys.platform != "linux":  # the encoder changes priorities on Linux only
        yield lambda: None
        return
    policy, priority = os.sched_getscheduler(0), os.sched_getparam(0)

    def restore() -> None:
        for thread in Path("/proc/self/task").iterdir():
            with contextlib.suppress(ProcessLookupError, PermissionError):
                if os.sched_getscheduler(int(thread.name)) in (os.SCHED_FIFO, os.SCHED_RR):
                    os.sched_setscheduler(int(thread.name), policy, priority)

    if policy in (os.SCHED_FIFO, os.SCHED_RR):  # the caller is real-time already
        yield lambda: None
        return
    try:
        yield restore
    finally:
        restore()
