"""Child processes that end with their parent, however the parent dies.

On Linux only (prctl PR_SET_PDEATHSIG); elsewhere children end when their parent stops in order.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys

__all__ = ["die_with_parent", "share_one_heap", "signal_name", "spawn_guard"]

PR_SET_PDEATHSIG = 1
M_ARENA_MAX = -8
_prctl = ctypes.CDLL(None, use_errno=True).prctl if sys.platform == "linux" else None


def die_with_parent(parent: int | None = None) -> None:
    """Makes the kernel kill this process when its parent ends. parent: the parent's pid, if known.

    The kernel watches the thread that forked, so fork from a thread that lives as long as its process.
    """
    if _prctl is None:
        return
    _prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    # A parent that ended between the fork and the prctl is never reported.
    if parent is not None and os.getppid() != parent:
        os._exit(1)


def share_one_heap() -> None:
    """Makes the threads of this process allocate from one heap.

    Otherwise glibc reserves 64 MiB of address space for each thread, which counts towards a limit on address space even if
    unused.
    """
    if sys.platform == "linux" and (mallopt := getattr(ctypes.CDLL(None), "mallopt", None)) is not None:
        mallopt(M_ARENA_MAX, 1)


class spawn_guard:  # noqa: N801 - used like a function
    """A `preexec_fn` for subprocess.Popen that makes the new process end with this one."""

    def __init__(self) -> None:
        self.parent = os.getpid()

    def __call__(self) -> None:
        """Runs in the child, between fork and exec."""
        die_with_parent(self.parent)


def signal_name(number: int) -> str:
    """Returns a signal's name, or its number if it has no name, as real-time signals."""
    return signal.Signals(number).name if number in set(signal.Signals) else f"signal {number}"
