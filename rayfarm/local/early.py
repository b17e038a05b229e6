"""Processes that `rayfarm up` and `rayfarm worker` start first: they load in parallel with the command line, and then wait.

Each begins when the supervisor writes its options to its standard input (renderer.child_processes.wait_to_begin), and ends with
this process. This module imports little, since everything that is imported before `begin` delays it.
"""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from renderer.child_processes import spawn_guard

__all__ = ["SERVICE", "WORKER", "begin", "command", "end", "take"]

SERVICE, WORKER = "service.standby", "worker.standby"
_ROOT = Path(__file__).resolve().parents[2]
_loading: dict[str, subprocess.Popen[bytes]] = {}


def command(module: str) -> list[str]:
    """Returns the command line of a process that loads and waits."""
    return [sys.executable, "-m", module]


def begin(modules: Sequence[str]) -> None:
    """Starts these processes. One that cannot be started is started by the supervisor, which reports why it cannot."""
    atexit.register(end)
    for module in modules:
        try:
            _loading[module] = subprocess.Popen(
                command(module),
                cwd=_ROOT,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
                umask=0o077,
                preexec_fn=spawn_guard(),
            )
        except (OSError, subprocess.SubprocessError):
            return


def take(module: str) -> subprocess.Popen[bytes] | None:
    """Returns the waiting process of a module, which is the caller's from now on; None if there is none."""
    return _loading.pop(module, None)


def end() -> None:
    """Ends the processes that were not taken."""
    for process in _loading.values():
        process.kill()
        process.communicate()
    _loading.clear()
