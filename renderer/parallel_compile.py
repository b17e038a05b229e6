"""Helper processes that compile parts of a kernel in parallel, since Numba compiles one function at a time per process.

Each part is compiled by the first free process, stored in the kernels' folder, and loaded from there by the other processes.
Parts that are missing because a helper was killed or failed are compiled by this process when it needs them.
"""

from __future__ import annotations

import contextlib
import gc
import os
import select
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Self

from renderer.jit import COMPILE_PATIENCE_S
from renderer.kernel.accumulate import pool_stages
from renderer.preparation_kernels import is_prepared, prepare_first
from renderer.sources import ROOT
from renderer.threads import cores
from renderer.variant_names import example_of

__all__ = ["Helpers", "main"]

MOST = 3  # helpers: more would wait for each other's parts
_NO_PART = b"\xff"
NEEDS = 640 << 20  # bytes that a helper takes while it compiles, with a margin


class Helpers:
    """A context manager for helper processes that compile parts of a kernel, and the kernels that prepare scenes.

    variant: name of the kernel variant for images, with `variant_suffix` of the settings (variant_names.py); "" compiles only the
    kernels that prepare scenes. wanted: False if nothing has to be compiled: no helpers are started.

    The helpers are forked if this process has no other threads, so a worker creates them before it starts threads. Otherwise they
    are spawned, and only when `share` is called.
    """

    def __init__(self, variant: str, wanted: bool = True) -> None:
        self._variant = variant
        self._count = _number_of_helpers() if wanted else 0
        self._forked: list[int] = []
        self._started: list[subprocess.Popen[bytes]] = []
        self._taking = self._giving = self._over = self._working = -1
        if self._count:
            self._taking, self._giving = os.pipe()
            self._over, self._working = os.pipe()
            if threading.active_count() == 1:
                self._forked = [self._fork(number) for number in range(self._count)]

    def share(self) -> None:
        """Compiles the kernel's parts in this process and in the helpers.

        Returns when no helper works any more, or COMPILE_PATIENCE_S after this process has finished."""
        if self._count == 0:
            return
        parts = _Parts(self._variant)
        if not self._forked:
            self._started = [self._start(number) for number in range(self._count)]
        _close(self._working)
        os.write(self._giving, bytes(range(len(parts))) if len(parts) else _NO_PART)
        _close(self._giving)
        self._working = self._giving = -1
        if len(parts) == 0:
            return  # a helper compiles the kernels that prepare scenes, while this process compiles another kernel
        parts.compile(self._taking)
        until = time.monotonic() + COMPILE_PATIENCE_S
        while select.select([self._over], [], [], max(until - time.monotonic(), 0.0))[0]:
            if os.read(self._over, 1) == b"":  # end of file once no helper is working
                break

    def finish(self) -> None:
        """Waits until the last helper has ended."""
        _close(self._giving)  # if nothing was shared
        self._giving = -1
        for child in self._forked:
            with contextlib.suppress(ChildProcessError):  # already reaped elsewhere
                os.waitpid(child, 0)
        for process in self._started:
            process.wait()
        self._forked, self._started = [], []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        for child in self._forked:
            with contextlib.suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
        for process in self._started:
            process.kill()
        self.finish()
        for end in (self._taking, self._over, self._working):
            _close(end)
        self._taking = self._over = self._working = -1

    def _fork(self, number: int) -> int:
        parent = os.getpid()
        child = os.fork()
        if child == 0:
            try:
                for each in (signal.SIGTERM, signal.SIGINT):
                    signal.signal(each, signal.SIG_DFL)
                _close(self._giving)
                _close(self._over)
                _run_helper(self._variant, self._taking, self._working, parent, is_first=number == 0)
            finally:
                os._exit(0)  # the parent will meet the same error and report it
        return child

    def _start(self, number: int) -> subprocess.Popen[bytes]:
        path = os.pathsep.join([str(ROOT.parent), os.environ.get("PYTHONPATH", "")])
        ends = self._taking, self._working
        return subprocess.Popen(
            [sys.executable, "-m", "renderer.parallel_compile", self._variant, *map(str, ends), str(os.getpid()), str(number)],
            env={**os.environ, "PYTHONPATH": path},
            pass_fds=ends,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )


class _Parts:
    """The parts of a kernel, numbered from 0; each is compiled by one of the processes."""

    def __init__(self, variant: str) -> None:
        self._stages = pool_stages(*example_of(variant)) if variant else []

    def __len__(self) -> int:
        return len(self._stages)

    def compile(self, taking: int, parent: int = 0) -> bool:
        """Compiles parts that no other process has taken, one by one; returns True if there were any.

        taking: the pipe from which part numbers are taken. parent: PID of the parent, or 0; stops if the parent has ended.
        """
        any_taken = False
        while (number := os.read(taking, 1)) and (parent == 0 or os.getppid() == parent):
            any_taken = True
            if number != _NO_PART:
                part, arguments = self._stages[number[0]]
                part.compile(arguments)
        return any_taken


def _run_helper(variant: str, taking: int, working: int, parent: int, is_first: bool) -> None:
    """The main function of a helper process.

    is_first: this helper also compiles the kernels that prepare scenes, while the parent links the kernel.
    """
    gc.disable()  # as in renderer.precompile
    has_worked = _Parts(variant).compile(taking, parent)
    _close(working)
    if has_worked and is_first and os.getppid() == parent and not is_prepared():
        prepare_first()


def _number_of_helpers() -> int:
    """Returns how many helpers are useful: one for each other core, as memory allows."""
    return max(min(cores() - 1, MOST, _free_memory() // NEEDS), 0)


def _free_memory() -> int:
    """Returns the free memory of this machine in bytes; if unknown, a number large enough for all helpers."""
    with contextlib.suppress(OSError, ValueError):
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) << 10
    return MOST * NEEDS


def _close(end: int) -> None:
    if end >= 0:
        os.close(end)


def main(arguments: list[str]) -> None:
    """Entry point of a spawned helper. arguments: variant, both ends of two pipes, the parent's PID, the helper's number."""
    variant, *numbers = arguments
    taking, working, parent, number = map(int, numbers)
    _run_helper(variant, taking, working, parent, is_first=number == 0)


if __name__ == "__main__":
    main(sys.argv[1:])
