"""Threads that an encoder made more urgent than all else on the machine, brought back among the others.

SVT-AV1 takes the highest real-time priority where it runs as root: for its own threads, for the one that opened it, and so for
each child that is started from there. Such threads keep every other program off their core for as long as they work.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

__all__ = ["no_more_urgent"]


@contextlib.contextmanager
def no_more_urgent() -> Iterator[Callable[[], None]]:
    """Gives what is to be called after each step that may have made threads urgent; it is called once more at the end."""
    if sys.platform != "linux":  # elsewhere the encoder does no such thing
        yield lambda: None
        return
    policy, priority = os.sched_getscheduler(0), os.sched_getparam(0)

    def restore() -> None:
        for thread in Path("/proc/self/task").iterdir():
            with contextlib.suppress(ProcessLookupError, PermissionError):
                if os.sched_getscheduler(int(thread.name)) in (os.SCHED_FIFO, os.SCHED_RR):
                    os.sched_setscheduler(int(thread.name), policy, priority)

    if policy in (os.SCHED_FIFO, os.SCHED_RR):  # as somebody wanted it
        yield lambda: None
        return
    try:
        yield restore
    finally:
        restore()
