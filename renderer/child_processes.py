"""Child processes that end with their parent, and processes that load modules before they receive their options.

On Linux, children end even if the parent is killed (prctl PR_SET_PDEATHSIG); elsewhere they end only if the parent ends normally.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import signal
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

__all__ = [
    "delayed_command",
    "die_with_parent",
    "share_one_heap",
    "signal_name",
    "spawn_guard",
    "start_line",
    "wait_for_start_line",
]

PR_SET_PDEATHSIG = 1
M_ARENA_MAX = -8
_BEGUN_LATER = """
import runpy, sys, time
time.sleep(float(sys.argv.pop(1)))
runpy.run_module(sys.argv.pop(1), run_name="__main__", alter_sys=True)
"""
_prctl = ctypes.CDLL(None, use_errno=True).prctl if sys.platform == "linux" else None


def die_with_parent(parent: int | None = None) -> None:
    """Makes the operating system kill this process when its parent ends. parent: the parent's PID, if known.

    The operating system watches the thread that forked, so that thread must live as long as its process.
    """
    if _prctl is None:
        return
    _prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    # A parent that ended between the fork and the prctl is never reported.
    if parent is not None and os.getppid() != parent:
        os._exit(1)


def share_one_heap() -> None:
    """Makes all threads of this process allocate from one heap.

    Otherwise glibc reserves 64 MiB of address space per thread, which counts towards a limit on address space even if unused.
    """
    if sys.platform == "linux" and (mallopt := getattr(ctypes.CDLL(None), "mallopt", None)) is not None:
        mallopt(M_ARENA_MAX, 1)


class spawn_guard:  # noqa: N801 - used like a function
    """A `preexec_fn` for subprocess.Popen that makes the new process end when this one ends."""

    def __init__(self) -> None:
        self.parent = os.getpid()

    def __call__(self) -> None:
        """Makes the new process end with its parent; `Popen` calls this in the child, between fork and exec."""
        die_with_parent(self.parent)


def signal_name(number: int) -> str:
    """Returns a signal's name, or its number if it has no name, such as a real-time signal."""
    return signal.Signals(number).name if number in set(signal.Signals) else f"signal {number}"


def delayed_command(module: str, seconds: float) -> list[str]:
    """Returns a command line like `python -m MODULE` that first waits some seconds, to leave the CPU to other processes."""
    return [sys.executable, "-c", _BEGUN_LATER, str(seconds), module]


def start_line(arguments: Sequence[str], environment: Mapping[str, str], log: Path) -> bytes:
    """Returns the line of input that starts a process which waits in `wait_for_start_line`.

    arguments, environment: of the process; log: the file for its output.
    """
    return json.dumps({"arguments": [*arguments], "environment": {**environment}, "log": str(log)}).encode() + b"\n"


def wait_for_start_line() -> list[str] | None:
    """Waits for a `start_line` on standard input; returns its arguments, or None at the end of the input.

    Adds the line's variables to the environment, and redirects standard output and error to the end of its log.
    """
    line = sys.stdin.readline()
    if not line:
        return None
    begin = json.loads(line)
    os.environ |= begin["environment"]
    _redirect(os.devnull, os.O_RDONLY, 0)
    with contextlib.suppress(OSError):  # as on a full disk: the output stays where it went before
        _redirect(begin["log"], os.O_WRONLY | os.O_APPEND | os.O_CREAT, 1, 2)
    return list(begin["arguments"])


def _redirect(path: str, flags: int, *descriptors: int) -> None:
    """Redirects these file descriptors to a file. Raises OSError if the file cannot be opened."""
    opened = os.open(path, flags, 0o600)
    for each in descriptors:
        os.dup2(opened, each)
    os.close(opened)
