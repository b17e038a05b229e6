"""Resets the priority of threads to which a video encoder has given real-time priority.

SVT-AV1, when run as root, sets the highest real-time priority for its own threads and for the thread that opened it; child
processes inherit it. Such threads take their core from every other program.
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
    """Context manager that resets the threads' priorities on exit.

    Yields a function that resets them too, to be called after each step that may have raised them.
    """
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
