"""No process is left behind: a child that dies with its parent, however the parent dies.

Linux only (prctl PR_SET_PDEATHSIG); elsewhere the parent's orderly stop is what ends its children.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys

__all__ = ["die_with_parent", "share_one_heap", "spawn_guard"]

PR_SET_PDEATHSIG = 1
M_ARENA_MAX = -8
_prctl = ctypes.CDLL(None, use_errno=True).prctl if sys.platform == "linux" else None


def die_with_parent(parent: int | None = None, sig: int = signal.SIGKILL) -> None:
    """Ask the kernel to send `sig` to this process when its parent ends. `parent`: the parent's pid, where known.

    The kernel watches the thread that forked, so fork from a thread that lives as long as its process.
    """
    if _prctl is None:
        return
    _prctl(PR_SET_PDEATHSIG, sig, 0, 0, 0)
    # A parent that ended between the fork and the prctl is never reported.
    if parent is not None and os.getppid() != parent:
        os._exit(1)


def share_one_heap() -> None:
    """Lets this process' threads allocate from one heap.

    Else glibc reserves 64 MiB of address space for each thread, which a limit on address space counts though nobody uses it.
    """
    if sys.platform == "linux" and (mallopt := getattr(ctypes.CDLL(None), "mallopt", None)) is not None:
        mallopt(M_ARENA_MAX, 1)


class spawn_guard:  # noqa: N801 - used like a function
    """A `preexec_fn` for subprocess.Popen that ties the new process to this one."""

    def __init__(self) -> None:
        self.parent = os.getpid()

    def __call__(self) -> None:
        """Run in the child, between fork and exec."""
        die_with_parent(self.parent)
